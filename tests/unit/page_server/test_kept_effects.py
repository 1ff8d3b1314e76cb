"""Effects are written into a study's file without touching anything else in it."""

from __future__ import annotations

import pytest
import yaml

from lumbar.errors import InputError
from lumbar.page_server.kept_effects import keep_effects

FILES = {
    "absent section": "# a study\nstudy: a\n",
    "section without the key": "study: a\nimprovement:  # see below\n  train: noise   # the longest\n\nsurvey: {file: x.csv}\n",
    "empty section": "improvement:\nstudy: a\n",
    "null section": "improvement: null\nstudy: a\n",
    "list in brackets": "improvement:\n  effects: [hysteresis, delay]  # once\n  train: noise\n",
    "list in lines": "improvement:\n  effects:\n    - hysteresis   # once\n    - delay\n  train: noise\nstudy: a\n",
    "empty list": "improvement: \n  effects: []\n",
    "last key, no end of line": "study: a\nimprovement:\n  train: noise\n  effects: [delay]",
    "section in braces": "study: a\nimprovement: {train: noise, effects: [delay]}\n",
    "empty file": "",
}


@pytest.mark.parametrize("name", FILES)
def test_only_the_effects_change(tmp_path, name):
    path = tmp_path / "study.yaml"
    path.write_text(FILES[name], encoding="utf-8")
    change = keep_effects(path, ["coulomb_friction", "delay"])
    assert path.read_text(encoding="utf-8") == FILES[name]
    assert "coulomb_friction" in change.diff
    change.write()
    before, after = yaml.safe_load(FILES[name]) or {}, yaml.safe_load(path.read_text(encoding="utf-8"))
    assert after.pop("improvement")["effects"] == ["coulomb_friction", "delay"]
    before.pop("improvement", None)
    assert after == before
    for comment in ("# a study", "# see below", "# the longest"):
        assert (comment in FILES[name]) == (comment in path.read_text(encoding="utf-8"))
    assert keep_effects(path, ["coulomb_friction", "delay"]).diff == ""


def test_what_cannot_be_changed_alone_is_refused(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text("a: &shared {train: noise}\nimprovement: *shared\n", encoding="utf-8")
    with pytest.raises(InputError, match="by hand"):
        keep_effects(path, ["delay"])


def test_a_file_that_somebody_else_changed_is_not_written(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text("study: a\n", encoding="utf-8")
    change = keep_effects(path, ["delay"])
    path.write_text("study: b\n", encoding="utf-8")
    with pytest.raises(InputError, match="changed since"):
        change.write()
    assert path.read_text(encoding="utf-8") == "study: b\n"
