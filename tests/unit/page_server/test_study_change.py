"""A key is set in a study's file without touching anything else in it."""

from __future__ import annotations

import pytest
import yaml

from lumbar.base.errors import InputError
from lumbar.page_server.study_change import Change, with_value

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
    [
        "a: &shared {train: noise}\nimprovement: *shared\n",
        "improvement: [1, 2]\n",
        "improvement: noise\n",
    ],
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
