"""Events that the recording's own file holds: beside ours, or in their place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_events import scene

from lumbar.base.errors import InputError
from lumbar.lifting.movement.events import find_events
from lumbar.lifting.movement.file_events import comparison
from lumbar.records.marker_file import RecordedEvent
from lumbar.records.markers import read_markers
from lumbar.settings.layout import MarkerLayout
from lumbar.settings.lifting import EventLabels, EventSettings
from lumbar.settings.plain import plain, typed
from lumbar.settings.subject import DeclaredEvents, TrialSettings

SETTINGS = EventSettings()
STEPS = (RecordedEvent("Foot Off", "Left", 0.5), RecordedEvent("Foot Off", "Right", 3.25))


@pytest.fixture(scope="module")
def lift():
    """True lift-off 2.0 s, toe-off 3.2 s, deposit 5.0 s, release 6.5 s; marked otherwise by somebody."""
    marks = (
        RecordedEvent("Lift-Off", "General", 1.9),
        *STEPS,
        RecordedEvent("Box_Release", "", 6.8),
        RecordedEvent("Cough", "", 4.0),
        RecordedEvent("Cough", "", 70.0),
    )
    return replace(scene(seed=1), events=marks)


def test_the_files_events_stand_beside_ours_and_change_nothing(lift):
    events = find_events(lift, SETTINGS)
    alone = find_events(replace(lift, events=()), SETTINGS)
    assert {name: event.time_s for name, event in events.items()} == {
        name: event.time_s for name, event in alone.items()
    }
    assert [event.file_s for event in events.values()] == [1.9, 3.25, None, 6.8]
    lines = comparison(lift, events, SETTINGS.labels)
    early = events["toe_off"].time_s - 3.25
    assert any(
        "toe_off 3.250 s (Right Foot Off)" in line and f"{-early:.3f} s earlier" in line for line in lines
    )
    assert any("mean none of a lift" in line and line.endswith("Cough at 4.00 s") for line in lines)
    assert any("outside 0.00 to 7.99 s" in line and "Cough at 70.00 s" in line for line in lines)
    assert comparison(replace(lift, events=()), alone, SETTINGS.labels) == []


@pytest.mark.parametrize("by", ["trial", "study"])
def test_the_files_events_replace_ours_where_that_is_asked_for(lift, by):
    trial = typed(TrialSettings, {**plain(TrialSettings(15.0, "lift.c3d")), "events": "file"})
    settings = SETTINGS if by == "trial" else replace(SETTINGS, taken_from="file")
    events = find_events(lift, settings, trial.events if by == "trial" else None)
    assert {
        name: (event.time_s, event.method) for name, event in events.items() if name != "deposit_start"
    } == {
        "lift_off": (1.9, "file"),
        "toe_off": (3.25, "file"),
        "release": (6.8, "file"),
    }
    assert events["deposit_start"].method == "detected"
    assert events["release"].detected_s == pytest.approx(6.5, abs=0.05)


def test_what_is_set_by_hand_goes_before_the_file(lift):
    by_hand = DeclaredEvents(release_s=6.6, reason="seen on video")
    release = find_events(lift, replace(SETTINGS, taken_from="file"), by_hand)["release"]
    assert (release.time_s, release.method, release.file_s) == (6.6, "declared", 6.8)


def test_a_files_events_that_leave_a_doubt_are_refused_and_only_told_otherwise(lift):
    twice = replace(lift, events=(*lift.events, RecordedEvent("release", "", 7.0)))
    with pytest.raises(InputError, match=r"release in the file: Box_Release at 6\.80 s, release at 7\.00 s"):
        find_events(twice, SETTINGS, "file")
    events = find_events(twice, SETTINGS)
    assert events["release"].file_s is None and "window_s" in events["release"].file
    with pytest.raises(InputError, match="holds 'Cough', and 1 outside"):
        find_events(replace(lift, events=lift.events[-2:]), SETTINGS, "file")
    own = replace(SETTINGS, labels=EventLabels(deposit_start=("cough",)))
    assert find_events(lift, own, "file")["deposit_start"].time_s == 4.0


def test_steps_of_a_real_gait_are_no_toe_off_of_a_lift(shared):
    recording = read_markers(
        shared / "real" / "lifting" / "ktk_pig_com_oracle" / "gait.c3d", MarkerLayout(check_axes=False)
    )
    events = find_events(recording, SETTINGS)
    assert all(event.file_s is None for event in events.values())
    lines = comparison(recording, events, SETTINGS.labels)
    assert [line.count(" s") > 0 for line in lines] == [True, True]
    assert (
        lines[0].startswith("events of the file whose labels mean none of a lift")
        and "Foot Strike at 3.14" in lines[0]
    )
    assert "do not lie between a lift-off and a release: Foot Off at 2.73" in lines[1]
    assert np.isclose(recording.events[0].time, 2.73, atol=0.01)
