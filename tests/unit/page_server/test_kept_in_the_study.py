"""What the page keeps in a study's file: one key, without touching anything else in it."""

from pathlib import Path

import numpy as np
import pytest
import yaml

import lumbar
from column_files import write_columns
from lumbar.base.errors import InputError
from lumbar.interface.importing import import_recordings
from lumbar.interface.reading import read_listed
from lumbar.page_server.keeping import keep_effects, keep_records
from lumbar.page_server.study_change import Change, with_value
from lumbar.study.load_study import load_study
from lumbar.study.study import record_set, set_layout
from lumbar.twin.examples import example_records

EFFECTS = ("improvement", "effects")
OF_SECOND = ("improvement", "record_sets", 1, "effects")
NEW_SET = ("improvement", "record_sets", 2)
SETS = ("improvement", "record_sets")
ENTRY = {"name": "own", "records": [{"name": "a", "file": "own/a: b #1.csv"}]}
NESTED = (
    "improvement:\n  record_sets:   # two\n    - {name: tissue}\n    - name: other   # mine\n      base: pendulum\n"
    "      records:\n        - {name: a, file: a.csv}   # first\n        - {name: b, file: b.csv}\nstudy: a\n"
)
FLOW = "study: a\nimprovement: {record_sets: [{name: tissue}, {name: other, base: KB}]}   # all\n"
WITH = "improvement:\n  record_sets:\n  - name: tissue\n  - effects: [delay]  # once\n    name: other\nstudy: a\n"
FILES = {
    "absent section": ("# a study\nstudy: a\n", EFFECTS),
    "section without the key": (
        "study: a\nimprovement:  # see below\n  train: noise   # the longest\n\nsurvey: {file: x.csv}\n",
        EFFECTS,
    ),
    "section whose first key is long": ("improvement:\n  train:\n    - noise\n  base: KB\n", EFFECTS),
    "empty section": ("improvement:\nstudy: a\n", EFFECTS),
    "null section": ("improvement: null\nstudy: a\n", EFFECTS),
    "list in brackets": ("improvement:\n  effects: [hysteresis, delay]  # once\n  train: noise\n", EFFECTS),
    "list in lines": (
        "improvement:\n  effects:\n    - hysteresis   # once\n    - delay\n  train: noise\nstudy: a\n",
        EFFECTS,
    ),
    "empty list": ("improvement: \n  effects: []\n", EFFECTS),
    "last key, no end of line": ("study: a\nimprovement:\n  train: noise\n  effects: [delay]", EFFECTS),
    "section in braces": ("study: a\nimprovement: {train: noise, effects: [delay]}\n", EFFECTS),
    "braces without the key": ("study: a\nimprovement: {train: noise}   # all\n", EFFECTS),
    "empty file": ("", EFFECTS),
    "entry in lines": (NESTED, OF_SECOND),
    "entry in braces": (FLOW, OF_SECOND),
    "entry with the key": (WITH, OF_SECOND),
    "entry more in lines": (NESTED, NEW_SET),
    "entry more in brackets": (FLOW, NEW_SET),
    "list that is absent": ("improvement:\n  train: noise   # the longest\nstudy: a\n", SETS),
    "list for a list": (NESTED.replace("  # two", ""), SETS),
}


def value_for(way):
    return {
        EFFECTS: ["coulomb_friction", "delay"],
        OF_SECOND: [],
        NEW_SET: ENTRY,
        SETS: [ENTRY, {"name": "b"}],
    }[way]


@pytest.mark.parametrize("name", FILES)
def test_only_the_key_changes(tmp_path, name):
    text, way = FILES[name]
    path = tmp_path / "study.yaml"
    path.write_text(text, encoding="utf-8")
    change = with_value(path, way, value_for(way))
    assert path.read_text(encoding="utf-8") == text
    assert change.diff
    change.write()
    before, after = yaml.safe_load(text) or {}, yaml.safe_load(path.read_text(encoding="utf-8"))
    holder = after
    for step in way[:-1]:
        holder = holder[step]
    assert holder[way[-1]] == value_for(way)
    for content in (before, after):
        content.pop("improvement", None)
    assert after == before
    comments = {
        line.split("#")[1] for line in text.splitlines() if "#" in line and "- hysteresis" not in line
    }
    written = path.read_text(encoding="utf-8")
    assert way == SETS or all(f"#{comment}" in written for comment in comments)
    assert with_value(path, way, value_for(way)).diff == ""


@pytest.mark.parametrize(
    "text",
    ["a: &shared {train: noise}\nimprovement: *shared\n", "improvement: [1, 2]\n", "improvement: noise\n"],
)
def test_what_cannot_be_changed_alone_is_refused(tmp_path, text):
    path = tmp_path / "study.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="by hand"):
        with_value(path, EFFECTS, ["delay"])


def test_nothing_is_written_over(tmp_path):
    path, beside = tmp_path / "study.yaml", tmp_path / "own" / "a.csv"
    path.write_text("study: a\n", encoding="utf-8")
    change = with_value(path, EFFECTS, ["delay"])
    with_files = Change(path, change.before, change.after, {beside: "time_s\n"})
    assert "new file" in with_files.diff and "a.csv" in with_files.diff
    beside.parent.mkdir()
    beside.symlink_to(tmp_path / "elsewhere.csv")
    with pytest.raises(InputError, match="not written over"):
        with_files.write()
    assert not (tmp_path / "elsewhere.csv").exists()
    path.write_text("study: b\n", encoding="utf-8")
    with pytest.raises(InputError, match="changed since"):
        change.write()
    assert path.read_text(encoding="utf-8") == "study: b\n"


TWO_SETS = "  record_sets:\n    - {name: tissue}\n    - {name: other, base: KB}\n"
STUDY = """study: kept
title: kept
data: recordings
data_root: data
data_source: {name: examples, licence: none, obtain: here}
chapters: [tissue, improvement]
tissue:
  records: [{name: multisine, file: multisine.csv}]
  training: [multisine]
improvement:
  propose_law: false   # quick
  most_effects: 1
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Folder of two recordings as a machine may write them."""
    folder = tmp_path_factory.mktemp("files")
    for record in example_records():
        values = {"t [ms]": 1e3 * record.time, "pos [m]": record["input"] / 1e3, "F [N]": record["output"]}
        write_columns(folder / f"{record.name}.csv", **values)
    return folder


@pytest.fixture
def study(tmp_path, project, files):
    """Return a function that writes a study's file and loads the study."""
    (tmp_path / "data").mkdir()
    (tmp_path / "config").mkdir()
    (tmp_path / "config" / "artefacts.tsv").symlink_to(project / "config" / "artefacts.tsv")
    n = np.arange(300)
    write_columns(tmp_path / "data" / "multisine.csv", time_s=0.01 * n, position_mm=n % 7, force_N=n % 5)

    def load(text: str | None = None):
        path = tmp_path / "study.yaml"
        if text is not None:
            path.write_text(text, encoding="utf-8")
        return path, load_study(yaml.safe_load(path.read_text(encoding="utf-8")), tmp_path, [path])

    return load


def test_each_set_has_its_own_effects(study):
    path, loaded = study(STUDY + TWO_SETS)
    for name, effects in (("tissue", ["delay"]), ("other", ["coulomb_friction", "delay"]), ("other", [])):
        keep_effects(path, loaded.settings, name, effects).write()
        _, loaded = study()
        assert record_set(loaded.settings, name).effects == tuple(effects)
    assert loaded.settings.improvement.effects == ("delay",)
    assert keep_effects(path, loaded.settings, "tissue", ["delay"]).diff == ""


def test_a_study_with_the_sets_of_the_defaults_gets_the_list(study):
    path, loaded = study(STUDY.replace("  most_effects: 1\n", "  most_effects: 1\n" + TWO_SETS))
    path.write_text(STUDY, encoding="utf-8")  # the list stands in another file, below this one
    keep_effects(path, loaded.settings, "other", ["inertia"]).write()
    written = yaml.safe_load(path.read_text(encoding="utf-8"))["improvement"]
    assert written["record_sets"] == [
        {"name": "tissue"},
        {"name": "other", "effects": ["inertia"], "base": "KB"},
    ]
    assert "# quick" in path.read_text(encoding="utf-8")


def test_effects_of_a_set_are_checked(study):
    with pytest.raises(InputError, match=r"record_sets.1.effects.0: 'freind' is no effect"):
        study(STUDY + TWO_SETS.replace("base: KB", "base: KB, effects: [freind]"))
    with pytest.raises(InputError, match=r"record_sets.1.train: 'chirp' is no record; records: multisine"):
        study(STUDY + TWO_SETS.replace("base: KB", "train: chirp"))


def test_recordings_are_kept_so_that_the_workflow_finds_the_same_numbers(study, files, tmp_path):
    imported = import_recordings(sorted(files.glob("*.csv")))
    shown = lumbar.refine(imported.records, ["coulomb_friction"], train=["other"], base="KB")
    path, loaded = study(STUDY + TWO_SETS)
    change = keep_records(path, loaded, "own", imported, ["other"], shown.effects)
    assert not (tmp_path / "data" / "own").exists()
    change.write()
    _, loaded = study()
    entry = record_set(loaded.settings, "own")
    paths = [loaded.recording(item.file) for item in entry.records]
    assert all(Path(item).is_relative_to(tmp_path / "data" / "own") for item in paths)
    records = read_listed(paths, entry.records, *set_layout(loaded.settings, "own"))
    again = lumbar.refine(records, entry.effects, train=entry.train, base="KB")
    assert again.rows() == shown.rows()
    update = keep_records(path, loaded, "own", imported, ["other"], ["delay"])
    assert update.beside == {} and "[delay]" in update.diff
    with pytest.raises(InputError, match="another record set 'other'"):
        keep_records(path, loaded, "other", imported, ["other"], [])


def test_recordings_stay_inside_the_data_root(study, files, tmp_path):
    imported = import_recordings(sorted(files.glob("*.csv")))
    path, loaded = study(STUDY + TWO_SETS)
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "data" / "own").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="leads out of the study's data root"):
        keep_records(path, loaded, "own", imported, ["other"], [])
    path.write_text(
        path.read_text(encoding="utf-8").replace("data: recordings", "data: twin"), encoding="utf-8"
    )
    _, twin = study()
    with pytest.raises(InputError, match="made by the workflow"):
        keep_records(path, twin, "mine", imported, ["other"], [])
