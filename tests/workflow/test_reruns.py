"""A changed key re-runs the jobs that depend on it, and no others."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from running import copy_project

ALWAYS = {"run_config": 1, "report_page": 1, "all": 1}
CLAIMS = {"examine_claims": 1}
EXPORTED = {"export_fmus": 1, "render_models": 1, **CLAIMS}
IDENTIFIED = {"identify_tissue": 1, **EXPORTED}
DIAGNOSED = {"diagnose_records": 3, **IDENTIFIED}
EXCITED = {
    "design_signals": 1,
    "twin_tissue": 1,
    "check_tissue_recordings": 1,
    "diagnose_records": 1,
    **IDENTIFIED,
}
LIFT_PAGES = {"lifting_figures": 1, "measure_movement": 1, "show_lifts": 1}
TABLES = {"stability_tables": 1, **CLAIMS}


def lifts(count: int) -> dict[str, int]:
    """Jobs after a change of some lifts."""
    return {"lift": count, "basins_of_lift": count, **LIFT_PAGES, **TABLES}


KEYS = {
    "title": ("another", {}),
    "surgeon.bandwidth.resamples": (2001, {"surgeon_motion": 1, **EXCITED}),
    "signals.band_factor": (2.5, EXCITED),
    "tissue.segment_s": ([0, 3], IDENTIFIED),
    "improvement.most_effects": (1, DIAGNOSED),
    "runtime.check_samples": (300, {"export_fmus": 1}),
    "survey.resamples": (2001, {"analyse_survey": 1, **CLAIMS}),
    "lifting.filter.cutoff_Hz": (5.0, lifts(4)),
    "stability.attack.starts": (77, {"basins_of_lift": 4, **TABLES}),
    "stability.measures.functional_share": (0.7, {"measure_movement": 1, "show_lifts": 1}),
    "stability.sensitivity_factor": (3.0, TABLES),
    "stability.limits.foot_ahead_m": (0.19, {"show_lifts": 1}),
}
PERSONS = ("expert", "novice")


@pytest.fixture(scope="module")
def plans(tmp_path_factory):
    """Planned jobs by the change before them, of a study whose results exist."""
    folder, changes = copy_project(tmp_path_factory.mktemp("reruns")), {}
    for key, (value, _) in KEYS.items():
        for name in reversed(key.split(".")):
            value = {name: value}
        arguments = ["--configfile", "change.yaml"]
        changes[key] = {"file": "change.yaml", "text": json.dumps(value), "arguments": arguments}
    for person in PERSONS:
        file = f"config/subjects/{person}.yaml"
        heavier = (folder / file).read_text(encoding="utf-8").replace("  mass_kg: 7", "  mass_kg: 8")
        changes[person] = {"file": file, "text": heavier, "arguments": []}
    command = [sys.executable, str(Path(__file__).with_name("plan_changes.py")), str(folder)]
    run = subprocess.run(command, input=json.dumps(changes), capture_output=True, check=False, text=True)
    assert run.returncode == 0, run.stderr[-3000:]
    return json.loads(run.stdout)


def test_finished_study_has_no_job(plans):
    assert plans["nothing"] == {}


@pytest.mark.parametrize("key", KEYS)
def test_changed_key_reruns_its_dependents(plans, key):
    assert plans[key] == {**ALWAYS, **KEYS[key][1]}


@pytest.mark.parametrize("person", PERSONS)
def test_mass_reruns_the_same_jobs_for_every_person(plans, person):
    assert plans[person] == {**ALWAYS, **lifts(2)}
