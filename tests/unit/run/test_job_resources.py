"""What jobs ask of a cluster: enough for what they were measured to need, and more when tried again."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

PROJECT = Path(__file__).resolve().parents[3]


@pytest.fixture
def measured(monkeypatch):
    monkeypatch.syspath_prepend(str(PROJECT / "workflow"))
    from run.job_resources import measured

    return measured


def test_a_job_asks_for_head_room_and_for_more_with_every_attempt(measured):
    resources = measured(peak_mb=100.5, seconds=12)
    # 400 MB of two Snakemakes and twice 101; 60 s to begin and ten times 12.
    assert [resources["mem_mb"](None, attempt=attempt) for attempt in (1, 2, 3)] == [602, 1204, 1806]
    assert [resources["runtime"](None, attempt=attempt) for attempt in (1, 2)] == [3, 6]


def test_every_rule_with_a_script_says_what_it_needs_and_groups_in_profiles_exist():
    rules = [path.read_text(encoding="utf-8") for path in (PROJECT / "workflow" / "rules").glob("*.smk")]
    for text in rules:
        assert text.count("**measured(") == len(re.findall(r"^ +script:", text, flags=re.M))
    groups = set(re.findall(r'group:\n +"(\w+)"', "\n".join(rules)))
    for profile in ("slurm", "kubernetes"):
        settings = yaml.safe_load(
            (PROJECT / "profiles" / profile / "config.yaml").read_text(encoding="utf-8")
        )
        assert {entry.split("=")[0] for entry in settings["group-components"]} <= groups
