"""Snakemake's limit of job starts is lifted where nobody asked for one."""

from __future__ import annotations

import inspect
from types import SimpleNamespace

import pytest
from snakemake.cli import get_argument_parser
from snakemake.scheduling.job_scheduler import JobScheduler
from snakemake.settings.types import MaxJobsPerTimespan


@pytest.fixture
def lift_limit(project, monkeypatch):
    monkeypatch.syspath_prepend(str(project / "workflow"))
    from run.job_starts import lift_limit

    return lift_limit


def scheduler(limit):
    settings = SimpleNamespace(max_jobs_per_timespan=limit)
    return SimpleNamespace(job_rate_limiter=limit, workflow=SimpleNamespace(scheduling_settings=settings))


def test_snakemakes_own_limit_is_lifted(lift_limit):
    own = get_argument_parser().parse_args([]).max_jobs_per_timespan
    begun = scheduler(own if isinstance(own, MaxJobsPerTimespan) else MaxJobsPerTimespan.parse_choice(own))
    lift_limit(begun)
    assert begun.job_rate_limiter is None
    assert "if self.job_rate_limiter is not None:" in inspect.getsource(JobScheduler.schedule)


@pytest.mark.parametrize("asked", ["100/1m", "5/1s"])
def test_a_limit_of_the_user_stays(lift_limit, asked):
    limit = MaxJobsPerTimespan.parse_choice(asked)
    begun = scheduler(limit)
    lift_limit(begun)
    assert begun.job_rate_limiter is limit


def test_no_limit_stays_none(lift_limit):
    begun = scheduler(None)
    lift_limit(begun)
    assert begun.job_rate_limiter is None
