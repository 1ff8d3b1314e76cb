"""How many jobs a second Snakemake may start: a limit that no study reaches, and whose price is a processor kept busy."""

from __future__ import annotations

SNAKEMAKES_OWN = (100, 1)
"""Jobs and seconds, where nobody asks for another limit; a study has fewer than a hundred jobs."""


def lift_limit(scheduler) -> None:
    """Start jobs as soon as a core is free, unless the user set another limit than Snakemake's own.

    With a limit, every job that ends begins a chain of looks at all inputs of all waiting jobs, once a second until the run
    ends (`JobScheduler._schedule_reevalutation`): after twenty jobs they take a tenth of a core, and the end waits for the last.

    Parameters
    ----------
    scheduler : snakemake.scheduling.job_scheduler.JobScheduler
        Of a run that begins.
    """
    limit = scheduler.workflow.scheduling_settings.max_jobs_per_timespan
    if limit is not None and (limit.max_jobs, limit.timespan) == SNAKEMAKES_OWN:
        scheduler.job_rate_limiter = None
