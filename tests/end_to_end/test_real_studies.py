"""The studies of real recordings run to their end."""

import json

import pandas as pd
import pytest

from running import ZIG_CACHE, copy_project, snakemake


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = copy_project(tmp_path_factory.mktemp("real"))
    # Whether a law is found in these recordings is asked among the public records (tests/real_records).
    overlay = (
        f"runtime: {{compiler_cache: {ZIG_CACHE}, check_samples: 200}}\nimprovement: {{propose_law: false}}\n"
    )
    overlay += "tissue: {bootstrap: {resamples: 100}}\n"
    (made / "config" / "overlay.yaml").write_text(overlay, encoding="utf-8")
    # A file with dynamics of each kind: none, linear, with an effect; that all models become files the default study shows.
    fewer = "runtime: {models: [IL, Maxwell, KB+hysteresis]}\n"
    (made / "config" / "fewer_fmus.yaml").write_text(fewer, encoding="utf-8")
    return made


# How fine a grid must be is a matter of the unit tests; here the study's own rules meet its recording.
COARSE_BASINS = """
stability:
  knots: 250
  regulator: {control_weight: 10.0} # a loop as slow as so few knots resolve
  attack: {starts: 20}
  checks: []
  lyapunov_shares: [0.0, 1.0]
  fewer_knots: 200
"""


def run_study(folder, shared, study, *overlays):
    files = (f"config/studies/{study}.yaml", "config/overlay.yaml", *overlays)
    snakemake(
        folder, *("--cores", "2", "--configfile", *files), env={"LUMBAR_DATA": str(shared / "real")}
    ).whole()
    return folder / "results" / study


@pytest.mark.nightly
def test_davinci_tool(folder, shared):
    results = run_study(folder, shared, "davinci_tool", "config/fewer_fmus.yaml")
    table = pd.read_csv(results / "tables" / "table_3_1.csv")
    assert not table["data"].str.contains("synthetic").any()
    assert {"MW", "Maxwell", "KB", "HO"} <= set(table.model)
    assert list((results / "fmu").glob("*_fmi3.fmu"))
    # Known of this tool from published work: friction with presliding (Dahl) explains what linear models do not.
    diagnosis = json.loads(
        (results / "improvement" / "tissue" / "diagnosis.json").read_text(encoding="utf-8")
    )
    assert (diagnosis["verdict"], diagnosis["selected"]) == ("named", ["hysteresis"])
    assert diagnosis["train"] == "sine_0.1Hz+sine_0.3Hz"
    assert diagnosis["ladder"][1]["test_rms"] < 0.2 * diagnosis["ladder"][0]["test_rms"]
    refined = table[(table.model == "KB+hysteresis") & (table.trained_on == "sine_0.1Hz")].iloc[0]
    linear = table[(table.model == "KB") & (table.trained_on == "sine_0.1Hz")]
    assert refined.vaf_test_1_percent > linear.vaf_test_1_percent.max() + 10


@pytest.mark.nightly
def test_box_transfer(folder, shared):
    (folder / "config" / "coarse.yaml").write_text(COARSE_BASINS, encoding="utf-8")
    results = run_study(folder, shared, "box_transfer", "config/coarse.yaml")
    areas = pd.read_csv(results / "stability" / "boa.csv")
    assert set(areas.com) == {"thorax", "abdomen", "pelvis"}
    assert (areas.mean_area > 0).all()
    table = pd.read_csv(results / "tables" / "table_4_1.csv")
    assert table.lateral_bending_percent.isna().all()
    assert table.status.str.contains("not testable").all()
