"""A study of lifts: other labels call for no basin, unknown ones end it before it starts, a lift without a deposit does not."""

import re
from pathlib import Path

import pandas as pd
import pytest

from refusing import has_tokens
from running import copy_project, snakemake

pytestmark = pytest.mark.nightly
STUDY = """
study: groups
chapters: [lifting, stability]
lifting: {points: 200}
stability:
  knots: 51
  regulator: {control_weight: 10.0} # a loop as slow as so few knots resolve
  attack: {starts: 2}
  checks: []
  lyapunov_shares: [1.0]
  fewer_knots: 50
"""
NAMED = "  compare: {groups: [trained, untrained]}\n"


def relabel(folder: Path, name: str, label: str) -> None:
    path = folder / "config" / "subjects" / f"{name}.yaml"
    text = path.read_text(encoding="utf-8")
    path.write_text(re.sub(r"experience: \w+", f"experience: {label}", text), encoding="utf-8")


def plan(folder: Path, *arguments: str):
    return snakemake(folder, "--cores", "1", *arguments, "--configfile", "config/groups.yaml")


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A study that has run, and whose people have other labels since."""
    folder = copy_project(tmp_path_factory.mktemp("groups"))
    (folder / "config" / "groups.yaml").write_text(STUDY, encoding="utf-8")
    plan(folder, "stability").whole()
    table = pd.read_csv(folder / "results" / "groups" / "tables" / "table_4_1.csv")
    assert set(table["status"]) == {"computed"}
    relabel(folder, "expert", "trained")
    relabel(folder, "novice", "untrained")
    return folder


def test_unknown_groups_end_the_run_before_any_job(study):
    run = plan(study, "stability")
    assert run.status != 0
    assert has_tokens(run.text, "stability.compare.groups: …'expert'…'novice'…trained, untrained")


def test_other_labels_recompute_no_basin(study):
    (study / "config" / "groups.yaml").write_text(STUDY + NAMED, encoding="utf-8")
    planned = set(plan(study, "--dry-run", "stability").jobs)
    assert planned == {"stability", "stability_tables", "measure_movement"}


def test_added_subject_recomputes_only_its_lifts(study):
    """The twin moves the third person as of the label; what is pooled is made again, nobody's lift is."""
    people = study / "config" / "subjects"
    text = (people / "expert.yaml").read_text(encoding="utf-8").replace("expert", "third")
    (people / "third.yaml").write_text(text.replace("trained", "novice"), encoding="utf-8")
    more = "lifting: {subjects: [expert, novice, third]}\ntwin: {lifting: {people: {third: {mass_kg: 78, height_m: 1.75}}}}\n"
    (study / "config" / "groups.yaml").write_text(STUDY + NAMED, encoding="utf-8")
    (study / "config" / "third_person.yaml").write_text(more, encoding="utf-8")
    files = ("--configfile", "config/groups.yaml", "config/third_person.yaml")
    run = snakemake(study, "--cores", "1", "--dry-run", "stability", *files)
    own = dict.fromkeys(("twin_lift", "lift", "basins_of_lift"), 2)
    pooled = ("check_lifting_recordings", "stability_tables", "measure_movement", "show_lifts")
    assert run.jobs == own | dict.fromkeys((*pooled, "stability"), 1), run.text[-3000:]
    assert "third_23kg: " in run.text and "expert_23kg: " not in run.text


def test_lift_without_deposit_keeps_basins_of_others(study):
    """The window of one trial ends while the box is carried: its rows say why they are empty, the run goes on."""
    (study / "config" / "groups.yaml").write_text(STUDY + NAMED, encoding="utf-8")
    path = study / "config" / "subjects" / "novice.yaml"
    text = path.read_text(encoding="utf-8")
    trial = "markers: lifting/novice_15kg.c3d,"
    assert trial in text
    path.write_text(text.replace(trial, f"{trial} window_s: [0, 5],"), encoding="utf-8")
    plan(study, "lifting", "stability").whole()
    tables = study / "results" / "groups" / "tables"
    missing = pd.read_csv(tables / "missing_basins.csv")
    # So coarse a grid may cost the sensitivity runs of other lifts a basin.
    missing = missing[missing["basin"] == "trajectory"]
    assert missing["box_mass_kg"].tolist() == [15] * 6
    assert missing["reason"].str.contains("5.00 s", regex=False).all()
    table = pd.read_csv(tables / "table_4_1.csv").set_index("comparison")["status"]
    computed, other, without = (
        "trained_vs_untrained",
        "decrease_in_mass_trained",
        "decrease_in_mass_untrained",
    )
    assert table.index.unique().tolist() == [computed, other, without]
    assert set(table[computed]) == set(table[other]) == {"computed"}
    assert table[without].str.contains("untrained 15 kg").all()
    assert (study / "results" / "groups" / "figures" / "lifting_events_novice_15kg.svg").is_file()
    areas = pd.read_csv(study / "results" / "groups" / "stability" / "boa.csv")
    experience = dict(zip(areas["subject"], areas["experience"], strict=True))
    assert experience == {"expert": "trained", "novice": "untrained"}
