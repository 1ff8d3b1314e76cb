"""The lifting figures show what the files hold: events, pivot and angle, ends of the segments."""

from __future__ import annotations

import numpy as np
import pytest

from lumbar.lifting.movement import lift as lifting
from lumbar.publishing.figures.lifting_figures import events_figure, pendulum_figure, segments_figure
from lumbar.records.markers import read_markers
from study_settings import study_settings, subject_settings


@pytest.fixture(scope="module")
def drawn(project, tmp_path_factory):
    from lumbar.twin.lifting_recordings import write_lift

    settings, twin = study_settings().lifting, study_settings().twin.lifting
    subject = subject_settings("novice")
    path = tmp_path_factory.mktemp("twin") / "novice_23kg.c3d"
    write_lift(twin, "novice_23kg", [1], path, None)
    trial = subject.trials[0]
    lift = lifting.analyse_lift(read_markers(path, settings.markers), "novice_23kg", subject, trial, settings)
    return {
        "motion": lifting.motion_frame(lift),
        "centres": lifting.centres_frame(lift),
        "states": lifting.states_frame(lift),
        "landmarks": lifting.landmarks_frame(lift),
        "events": {name: event.as_dict() for name, event in lift.events.items()},
        "summary": lifting.summary(lift, subject, trial, settings),
    }


def texts(figure):
    return " ".join(text.get_text() for axis in figure.axes for text in axis.texts)


def vertical_lines(axis):
    return sorted(float(line.get_xdata()[0]) for line in axis.lines if len(set(line.get_xdata())) == 1)


def test_every_event_stands_in_every_panel(drawn):
    figure = events_figure(drawn)
    events = drawn["events"]
    times = sorted([*(event["time_s"] for event in events.values()), events["deposit_start"]["thesis_s"]])
    for axis in figure.axes:
        assert vertical_lines(axis) == pytest.approx(times)
    assert "thesis's rule" in texts(figure)
    for label in ("lift-off", "first toe-off", "start of deposit", "release"):
        assert label in texts(figure)


def test_missing_feet_and_events_set_by_hand_are_said(drawn):
    motion = drawn["motion"].drop(columns=["l_toe_speed_m_s", "r_toe_speed_m_s"])
    events = {**drawn["events"], "toe_off": {"time_s": None, "method": "absent"}}
    events["release"] = {**events["release"], "method": "declared"}
    figure = events_figure({**drawn, "motion": motion, "events": events})
    assert "no markers on the feet" in texts(figure)
    assert "release (set by hand)" in texts(figure)
    assert len(vertical_lines(figure.axes[0])) == 4


def test_figure_4_1_draws_the_pendulums_from_pivot_to_centre(drawn):
    figure = pendulum_figure(drawn)
    at_release = drawn["landmarks"].query("event == 'release'").set_index("point")
    pivot = at_release.loc["PIVOT", ["y_m", "z_m"]].to_numpy(float)
    for com in ("thorax", "abdomen", "pelvis"):
        centre = at_release.loc[f"COM_{com}", ["y_m", "z_m"]].to_numpy(float)
        rods = [line.get_xydata() for line in figure.axes[0].lines if len(line.get_xdata()) == 2]
        assert any(np.allclose(rod, [pivot, centre]) for rod in rods)
        # Angle and length of the rod as drawn are those of the table's last row.
        last = drawn["states"].query("com == @com and plane == 'flexion_extension'").iloc[-1]
        rod = centre - pivot
        assert np.arctan2(rod[0], rod[1]) == pytest.approx(last["angle_rad"], abs=5e-3)
        assert np.hypot(*rod) == pytest.approx(last["length_m"], abs=5e-3)


def test_figure_4_2_draws_the_segments_between_their_landmarks(drawn):
    figure = segments_figure(drawn)
    at_start = drawn["landmarks"].query("event == 'deposit_start'").set_index("point")
    for axis, horizontal in zip(figure.axes, ("x_m", "y_m"), strict=True):
        bands = [line.get_xydata() for line in axis.lines if line.get_linewidth() == 7]
        ends = [("C7T1", "T12L1"), ("T12L1", "L4L5"), ("L4L5", "MID_HIP")]
        for band, pair in zip(bands, ends, strict=True):
            assert np.allclose(band, at_start.loc[list(pair), [horizontal, "z_m"]].to_numpy(float))
    assert figure.axes[0].xaxis_inverted()


def test_one_marked_wrist_is_called_by_its_side(drawn):
    def names(motion):
        legend = events_figure({**drawn, "motion": motion}).axes[0].get_legend()
        return [text.get_text() for text in legend.get_texts()]

    one = {f"wrists_{quantity}": f"r_wrist_{quantity}" for quantity in ("height_m", "speed_m_s")}
    assert names(drawn["motion"]) == ["box", "wrists"]
    assert names(drawn["motion"].rename(columns=one)) == ["box", "right wrist"]
