"""The axes of a file, found from the body alone, and checks that need an axis."""

import numpy as np
import pytest
from lifting_cases import write_recording

import lumbar
from lumbar.lifting.quality.gate import examine
from refusing import has_tokens

AXES = [("+z", "+x"), ("+y", "-z"), ("+x", "+y"), ("-z", "+y")]


def unit_vector(axis):
    return (1 if axis[0] == "+" else -1) * np.eye(3)["xyz".index(axis[1])]


def rotate(points, up, forward, turn_deg=0.0):
    """Express points of a body that faces y, z up, in other axes; the body is turned about the vertical before."""
    cos, sin = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    turned = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    axes = np.column_stack(
        [np.cross(unit_vector(forward), unit_vector(up)), unit_vector(forward), unit_vector(up)]
    )
    return {label: values @ turned.T @ axes.T for label, values in points.items()}


@pytest.fixture(scope="module")
def body(twin_lift):
    """Markers of the expert's lift under usual labels."""
    layout = lumbar.MarkerLayout(check_axes=False)
    return dict(lumbar.read(twin_lift("expert_23kg"), layout=layout).positions)


@pytest.fixture
def inspected(tmp_path):
    def write_and_inspect(points):
        write_recording(tmp_path / "lift.c3d", points, subject="ann")
        return lumbar.inspect(tmp_path / "lift.c3d")

    return write_and_inspect


@pytest.mark.parametrize(("up", "forward"), AXES)
def test_axes_of_lower_body_are_found_and_nothing_is_mirrored(body, inspected, up, forward):
    legs = ("ASIS", "PSIS", "HEEL", "TOE", "ANKLE")
    chosen = {label: values for label, values in body.items() if label[2:] in legs}
    report = inspected(rotate(chosen, up, forward))
    assert report.axes.startswith(f"up {up}, forward {forward} (")
    assert not report.sheet.findings


def test_hidden_frames_do_not_count(body, inspected):
    hidden = {
        label: np.where(np.arange(len(p))[:, None] < 0.8 * len(p), np.nan, p) for label, p in body.items()
    }
    assert inspected(rotate(hidden, "+z", "-x")).axes.startswith("up +z, forward -x (")


def test_sides_are_not_checked_if_up_is_unknown(body, inspected):
    odd = {"HEEL": "sole", "TOE": "tip", "ANKLE": "leg", "SHOULDER": "arm"}
    points = {f"{label[:2]}{odd[label[2:]]}": p for label, p in body.items() if label[2:] in odd}
    report = inspected(rotate(points, "+y", "+x"))
    assert not report.sheet.findings
    assert has_tokens(report.sheet.unchecked["left and right"], "up")
    assert has_tokens(report.axes, "not known … assumed")


@pytest.mark.parametrize("turn_deg", [30, 44.9, 45.1])
def test_turned_body_has_one_answer_with_its_angle(body, inspected, tmp_path, turn_deg):
    points = rotate(body, "+z", "+y", turn_deg)
    axes = inspected(points).axes
    assert has_tokens(axes, f"forward … {30 if turn_deg == 30 else 45}°")
    (study, _) = lumbar.new_study(tmp_path, "turned").files.values()
    assert has_tokens(study, axes)


def test_mirrored_body_is_found_with_markers_hidden_in_most_frames(body):
    mirrored = {label: places * [-1, 1, 1] for label, places in body.items()}
    for label in ("XIPHOID", "MANUBRIUM", "L_TOE", "R_TOE"):
        mirrored[label][: int(0.7 * len(mirrored[label]))] = np.nan
    (finding,) = examine(mirrored, np.arange(len(mirrored["C7"])) / 100, 100)
    assert (finding.kind, finding.outcome) == ("mirrored", "error")
