"""A study of drawn people: from marker files to what tells the groups apart; who is added makes nobody anew."""

import pandas as pd
import pytest

from running import copy_project, snakemake

pytestmark = pytest.mark.nightly
SMALL = """
stability: {fewer_knots: 84}
twin:
  lifting:
    rate_Hz: 50
    cohort: {trials: 1, box_masses_kg: [15], groups: {expert: {persons: 3}, novice: {persons: %d}}}
"""


def run_study(folder, novices: int, *arguments: str):
    (folder / "config" / "small.yaml").write_text(SMALL % novices, encoding="utf-8")
    files = ("--configfile", "config/studies/cohort.yaml", "config/small.yaml")
    return snakemake(folder, "--cores", "1", *arguments, *files)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = copy_project(tmp_path_factory.mktemp("cohort"))
    run_study(folder, 3).whole()
    return folder


def test_groups_of_drawn_people_are_compared(study):
    results = study / "results" / "cohort"
    table = pd.read_csv(results / "tables" / "measure_comparison.csv")
    assert set(table["comparison"]) == {"expert_vs_novice"} and set(table["data"]) == {"synthetic twin"}
    assert table["low"].notna().all() and table["df"].between(2, 4).all()
    # What the distributions say most clearly, 60 against 82 degrees, is seen with three persons already.
    inclination = table[table["measure"] == "trunk_inclination_peak"].iloc[0]
    assert inclination["difference"] < -10
    long = pd.read_csv(results / "population" / "measures.csv")
    # The twin's sets have no knees: what needs them says so.
    assert long["person"].nunique() == 6 and (long["value"].notna() | long["reason"].notna()).all()
    missing = long.loc[long["value"].isna(), "measure"]
    assert set(missing.str.partition("_")[0]) <= {"hip", "knee", "shoulder", "l5s1"}
    assert {"basin_area_pelvis_inverted", "margin_of_stability", "l5s1_moment_peak"} <= set(long["measure"])
    assert (results / "figures" / "measure_comparison.svg").is_file()


def test_one_person_more_is_all_that_is_made(study):
    planned = run_study(study, 4, "--dry-run").whole()
    made = {name: count for name, count in planned.jobs.items() if name not in ("all", "total")}
    assert made == dict.fromkeys(("twin_person", "measure_person", "compare_people"), 1)
