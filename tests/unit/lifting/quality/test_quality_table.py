"""The table of a study says what was found in each recording, and what could not be checked."""

from __future__ import annotations

import lumbar
from lumbar.lifting.quality.quality_table import quality_table
from lumbar.twin.examples import example_lift


def test_nothing_found_is_not_said_of_what_was_not_checked(tmp_path):
    somebody = example_lift(tmp_path / "lift.c3d")
    measured = lumbar.inspect(tmp_path / "lift.c3d", height_m=somebody.height_m).sheet
    unknown = lumbar.inspect(tmp_path / "lift.c3d").sheet
    sheets = [{"lift": name, **sheet.as_dict()} for name, sheet in (("a", measured), ("b", unknown))]
    rows = quality_table(sheets, "synthetic twin").frame
    assert rows["findings"].tolist() == ["none", "none"]
    assert rows["not_checked"].tolist() == [
        ", ".join(measured.unchecked) or "none",
        ", ".join(unknown.unchecked),
    ]
    assert "stature" in rows["not_checked"][1] and "stature" not in rows["not_checked"][0]
