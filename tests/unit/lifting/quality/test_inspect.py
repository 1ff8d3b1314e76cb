"""``lumbar inspect``: what is in a file, what is wrong with it, what the pipeline makes of it."""

import json

import numpy as np
import pytest
from quality_corruptions import changed

import lumbar
from column_files import write_columns
from lumbar.base.errors import InputError
from lumbar.lifting.quality.sheet import quality_table
from lumbar.records.markers import read_markers
from lumbar.settings.layout import MarkerLayout
from lumbar.twin.examples import example_lift
from lumbar.twin.lifting_recordings import write_markers


@pytest.fixture(scope="module")
def lift_file(twin_lift):
    return twin_lift("expert_23kg")


def test_a_sound_lift_is_described_and_analysed(lift_file):
    found = lumbar.inspect(lift_file, height_m=1.75)
    text = str(found)
    assert text.startswith("expert_23kg.c3d: 950 frames at 100 Hz, 0.00 to 9.50 s, ")
    assert "findings: none" in text
    assert found.prefixes == ("box", "expert")
    assert "as a lift: analysed" in text
    assert "deposit_start: 5.8" in text
    assert found._repr_html_().count("<li>") == len(found.lines())


def test_the_numbers_of_gaps_are_those_of_the_file(lift_file):
    found = lumbar.inspect(lift_file)
    points = read_markers(lift_file, MarkerLayout(check_axes=False)).positions
    missing = {label: np.isnan(positions[:, 0]).mean() for label, positions in points.items()}
    assert {gap.marker: gap.missing_share for gap in found.sheet.gaps} == {
        label: share for label, share in missing.items() if share
    }
    assert found.sheet.missing_share == pytest.approx(np.mean(list(missing.values())))


def test_what_stops_the_pipeline_is_told_and_does_not_stop_inspection(lift_file, tmp_path):
    points = read_markers(lift_file, MarkerLayout(check_axes=False)).positions
    write_markers(tmp_path / "tenfold.c3d", {label: 0.1 * p for label, p in points.items()}, 100, "expert")
    found = lumbar.inspect(tmp_path / "tenfold.c3d", height_m=1.75)
    assert [finding.kind for finding in found.sheet.findings] == ["unit"]
    analysed, words = found.pipeline
    assert not analysed
    assert "set markers.scale to 10" in words


def test_the_command_prints_draws_and_names_files_that_cannot_be_read(lift_file, tmp_path, run):
    points = read_markers(lift_file, MarkerLayout(check_axes=False)).positions
    frozen = tmp_path / "frozen.c3d"
    write_markers(frozen, changed(points, "C7", slice(300, 400), points["C7"][300]), 100, "expert")
    status, out, err = run("inspect", frozen, "--height", "1.75", "--picture", tmp_path / "frozen.svg")
    assert (status, err) == (0, "")
    assert "left out: frozen: C7, 3.00 to 4.00 s" in out
    assert "<svg" in (tmp_path / "frozen.svg").read_text(encoding="utf-8")
    assert not (tmp_path / "frozen.pdf").exists()
    (tmp_path / "broken.c3d").write_bytes(b"nothing")
    status, out, err = run("inspect", frozen, tmp_path / "broken.c3d", "--json")
    assert status == 1
    assert "broken.c3d" in err
    (entry,) = json.loads(out)
    assert [finding["kind"] for finding in entry["findings"]] == ["frozen"]


def test_a_record_of_force_and_position_is_sent_to_the_doctor(tmp_path):
    n = np.arange(300)
    write_columns(tmp_path / "record.csv", time_s=n / 100, position_mm=np.sin(n / 9), force_N=np.cos(n / 7))
    with pytest.raises(InputError, match=r"lumbar doctor .* examines records"):
        lumbar.inspect(tmp_path / "record.csv")


def test_what_could_not_be_checked_is_said(lift_file, tmp_path):
    points = read_markers(lift_file, MarkerLayout(check_axes=False)).positions
    renamed = {f"Q{index}": positions for index, positions in enumerate(points.values())}
    write_markers(tmp_path / "renamed.c3d", renamed, 100, "expert")
    text = str(lumbar.inspect(tmp_path / "renamed.c3d", height_m=1.75))
    assert "findings: none in what could be checked" in text
    (line,) = [line for line in text.splitlines() if line.startswith("not checked: ")]
    for what in ("stature (", "unit (", "left and right (", "order along the trunk ("):
        assert what in line
    assert "rate (" not in line
    fine_rate = "rate off by less than four times"  # which a file without force plates leaves open
    assert list(lumbar.inspect(lift_file, height_m=1.75).sheet.unchecked) == [fine_rate]
    assert list(lumbar.inspect(lift_file).sheet.unchecked) == ["stature", fine_rate]


def test_a_folder_is_called_a_folder(lift_file, run):
    assert "a folder; give the files in it" in run.refused("inspect", lift_file.parent)


def test_a_picture_in_another_format_is_refused_before_anything_is_read(tmp_path, run):
    err = run.refused("inspect", tmp_path / "absent.c3d", "--picture", tmp_path / "x.png")
    assert "pictures are written as .svg or .pdf" in err
    assert "absent.c3d" not in err


def test_a_marker_that_stands_still_throughout_turns_no_axis(shared, tmp_path):
    """C7 left behind at the first frame: it is left out, and up and forward are told by the others."""
    path = shared / "real" / "lifting" / "ktk_pig_com_oracle" / "gait.c3d"
    points = read_markers(path, MarkerLayout(check_axes=False)).positions
    points["C7"] = np.tile(points["C7"][0], (len(points["C7"]), 1))
    write_markers(tmp_path / "walk.c3d", points, 100, "ann")
    found = lumbar.inspect(tmp_path / "walk.c3d")
    assert found.axes == "up +z, forward +y"
    assert [(finding.kind, finding.markers) for finding in found.sheet.findings] == [("frozen", ("C7",))]


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
