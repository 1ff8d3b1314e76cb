"""Events of a lift against movements with known events, and against recordings of people."""

import re
from dataclasses import replace

import numpy as np
import pytest
from lifting_cases import ANN, cut, hide_markers, mark, noisy_recording, recording_of, trial_of

import lumbar
from refusing import has_tokens
from study_settings import changed, study_settings

RATE = 100.0
TIME = np.arange(0, 8, 1 / RATE)
LIFTING = lumbar.load_settings().lifting
TRUE = {"lift_off": 2.0, "toe_off": 3.2, "deposit_start": 5.0, "release": 6.5}


def lift_of(recording, by_hand=None, **rules):
    return lumbar.lift(
        recording, ANN, trial=trial_of(events=by_hand), settings=changed(LIFTING, events=rules)
    )


def events_of(recording, by_hand=None, **rules):
    return lift_of(recording, by_hand, **rules).analysed.events


@pytest.fixture(scope="module")
def squat(shared):
    """Floor pick-ups and squats of an athlete, 21 s, with hands and toes."""
    aliases = {"L_TOE": "LTOE", "R_TOE": "RTOE", "R_WRIST": "ROWR", "L_WRIST": "LOWR"}
    layout = lumbar.MarkerLayout(up="+y", forward="+z", check_axes=False, aliases=aliases)
    return lumbar.read(
        shared / "real" / "lifting" / "athlete_floor_pickup_squats" / "squat.c3d", layout=layout
    )


def moved(recording, axis, way, *names):
    """The recording with markers moved along an axis; the box's by default."""
    for name in names or ("BOX_1", "BOX_2"):
        recording[name][:, axis] += way
    return recording


def ramp(start, stop):
    share = np.clip((TIME - start) / (stop - start), 0, 1)
    return share**2 * (3 - 2 * share)


def scene(step=0.6, shuffle=0.0, hesitation=0.0, drop=0.25, leave=True, pause=False, seed=None):
    """Box on the floor, lifted at 2 s, carried from 3.2 s, set down from 5.0 to 6.5 s; feet step at 3.2 s."""
    zero = np.zeros_like(TIME)
    height = (
        0.3
        + 0.7 * ramp(2.0, 3.1)
        - drop * ramp(5.0, 6.5)
        + hesitation * np.sin(2 * np.pi * 2 * TIME) * (ramp(5.0, 5.5) - ramp(5.8, 6.3))
    )
    carry = (ramp(3.1, 3.9) + ramp(3.95, 5.0)) / 2 if pause else ramp(3.1, 5.0)
    forward = 0.4 + 0.9 * carry + 0.2 * ramp(5.0, 6.5)
    box = np.stack([zero, forward, height], axis=1)
    leaving = (ramp(6.6, 7.2) * leave)[:, None] * [0, -0.4, 0.1]
    reaching = (1 - ramp(0.5, 1.8))[:, None] * [0, -0.3, 0.5]
    toe = np.stack([zero, step * ramp(3.2, 3.6) + shuffle * ramp(0.6, 0.9), zero + 0.02], axis=1)
    positions = {
        "BOX_1": box + np.array([-0.2, 0, 0]),
        "BOX_2": box + np.array([0.2, 0, 0]),
        "L_WRIST": box + np.array([-0.2, -0.05, 0.05]) + leaving + reaching,
        "R_WRIST": box + np.array([0.2, -0.05, 0.05]) + leaving + reaching,
        "L_TOE": toe,
        "R_TOE": np.tile([0.2, 0.0, 0.02], (len(TIME), 1)),
    }
    trunk = {"C7": 1.5, "T12": 1.2, "L5": 1.0, "L_HIP": 0.9, "R_HIP": 0.9}
    positions |= {name: np.tile([0.0, 0.0, height], (len(TIME), 1)) for name, height in trunk.items()}
    if seed is not None:
        rng = np.random.default_rng(seed)
        positions = {name: points + rng.normal(0, 5e-4, points.shape) for name, points in positions.items()}
    return recording_of(positions, name="scene")


@pytest.mark.parametrize("seed", [None, 1, 2, 3])
@pytest.mark.parametrize("shuffle", [0.0, 0.15])
def test_known_events_are_found(seed, shuffle):
    events = events_of(scene(seed=seed, shuffle=shuffle))
    assert {event.method for event in events.values()} == {"detected"}
    for name, true in TRUE.items():
        assert events[name].time_s == pytest.approx(true, abs=0.05), name


@pytest.mark.parametrize(
    ("lift", "seed", "noise_mm", "off_s"),
    [
        *((f"{who}_{mass}kg", seed, 0.5, 0.05) for who in ("expert", "novice") for mass in (23, 15) for seed in (45, 7, 1000)),
        *((f"{who}_23kg", 9, 3.0, 0.08) for who in ("expert", "novice")),
    ],
)  # fmt: skip
def test_events_of_the_twin_are_found_at_six_times_the_noise(tmp_path, lift, seed, noise_mm, off_s):
    config = study_settings()
    actual = lumbar.lift(noisy_recording(lift, seed, noise_mm, tmp_path), ANN, 15.0, settings=config.lifting)
    for name, true in vars(config.twin.lifting.lifts[lift].events_s).items():
        assert actual.analysed.events[name].time_s == pytest.approx(true, abs=off_s), name


def box_set(value, kept=slice(None)):
    """The scene with the box's markers, in some frames, at a given place."""
    recording = scene()
    for name in ("BOX_1", "BOX_2"):
        recording[name][kept] = recording[name][0] if value == "at rest" else value
    return recording


def swinging():
    bare = hide_markers(scene(), "BOX")
    for name in ("L_WRIST", "R_WRIST"):
        bare[name][:] = [0.2, 0.3, 0.9]
        bare[name][:, 2] += 0.1 * np.sin(2 * np.pi * TIME)
    return bare


def twitching(later):
    """A toe at 0.5 m/s for 40 ms at 4.0 s, and where asked for a step at 4.5 s."""
    recording = scene(step=0.0)
    recording["L_TOE"][:, 1] += 0.02 * np.clip((TIME - 4.0) / 0.04, 0, 1)
    recording["L_TOE"][:, 1] += later * 0.06 * np.clip((TIME - 4.5) / 0.12, 0, 1)
    return recording


CARRIED = ("BOX_1", "BOX_2", "L_WRIST", "R_WRIST")
NOTHING = dict.fromkeys(TRUE)
SCENES = {
    "a pause while carrying": (lambda: scene(pause=True), {}),
    "slowing down halfway, still raised until 5.1 s": (lambda: scene(hesitation=0.02), {"deposit_start": 5.1}),
    "no step": (lambda: scene(step=0.0, shuffle=0.3), {"toe_off": None}),
    "no feet": (lambda: hide_markers(scene(), "L_TOE", "R_TOE"), {"toe_off": None}),
    "a twitch": (lambda: twitching(0), {"toe_off": None}),
    "a twitch and a step": (lambda: twitching(1), {"toe_off": 4.5}),
    "a box that never moves": (
        lambda: box_set("at rest"), NOTHING
    ),
    "carried from the start": (
        lambda: cut(scene(), TIME >= 2.5), {"lift_off": None}
    ),
    "an early end": (
        lambda: cut(scene(leave=False), TIME <= 6.0), {"release": None},
    ),
    "sliding first": (lambda: moved(scene(), 1, -0.2 * (1 - ramp(1.2, 1.9))), {}),
    "taken down": (lambda: moved(scene(), 2, -1.4 * ramp(2.0, 3.1), *CARRIED), {}),
    "lowered, carried on at that height, and set down": (
        lambda: moved(scene(), 2, -0.3 * ramp(3.3, 4.0), *CARRIED), {}
    ),
    "hands that only swing": (swinging, NOTHING),
    "a box hidden after the release": (
        lambda: box_set(np.nan, TIME > 7.0), {}
    ),
}  # fmt: skip
"""A recording, and those of its events that differ from `TRUE`."""


@pytest.mark.parametrize("name", SCENES)
def test_events_of_a_scene_are_found_or_absent_with_a_reason(name):
    recording, otherwise = SCENES[name]
    lift = lift_of(recording())
    events, expected = lift.analysed.events, TRUE | otherwise
    for event, true in expected.items():
        assert events[event].time_s == (true and pytest.approx(true, abs=0.06)), event
        assert true or (events[event].method == "absent" and events[event].how)
    if expected["lift_off"] and expected["release"]:
        phases = lift.body["phase"].unique().tolist()
        assert phases == ["before", "lift", *["carry"] * bool(expected["toe_off"]), "deposit", "after"]


def test_box_that_is_not_set_down_has_no_deposit():
    lift = lift_of(scene(drop=0.02))
    event = lift.analysed.events["deposit_start"]
    assert event.time_s is None and "lifting.events.descent_m" in event.how
    assert "0.025 m" in event.how and "0.019" in event.how
    assert lift.analysed.events["lift_off"].time_s == pytest.approx(2.0, abs=0.05)
    assert set(lift.body["phase"]) == {"before", "lift", "carry", "after"}


@pytest.mark.parametrize("drop", [0.046, 0.039])
@pytest.mark.parametrize(("bob", "actual"), [(0.0, True), (0.003, True), (0.02, False)])
def test_small_descent_is_a_deposit_if_others_are_smaller(drop, bob, actual):
    """Steps of 2 Hz move the box up and down while it is carried: a descent hardly larger than theirs is no deposit."""
    steps = bob * np.sin(4 * np.pi * TIME) * (ramp(3.2, 3.4) - ramp(4.6, 4.9))
    event = events_of(moved(scene(drop=drop), 2, steps, *CARRIED))["deposit_start"]
    assert (event.time_s is not None) == actual
    if actual:
        assert event.earliest_s <= 5.0 + 0.02 and event.time_s == pytest.approx(5.2, abs=0.05)
    else:
        assert "0.05 m" in event.how and "lifting.events.descent_m" in event.how


def test_an_event_set_by_hand_replaces_the_detected_one():
    event = events_of(scene(), {"deposit_start_s": 5.2, "reason": "hands regrip"})["deposit_start"]
    assert (event.time_s, event.method) == (5.2, "declared")
    assert event.detected_s == pytest.approx(5.0, abs=0.05)
    assert "hands regrip" in event.how


def test_events_that_cannot_be_detected_can_be_declared():
    bare = hide_markers(scene(), "BOX", "L_WRIST", "R_WRIST")
    assert {event.method for event in events_of(bare).values()} == {"absent"}
    events = events_of(bare, {"lift_off_s": 2.0, "release_s": 6.5})
    assert events["toe_off"].time_s == pytest.approx(3.2, abs=0.05)
    assert events["deposit_start"].method == "absent"


@pytest.mark.parametrize(
    ("declared", "problem"),
    [
        ({"lift_off_s": 99.0, "release_s": 6.5}, r"scene\.c3d: (.|\n)*lift_off: 99 s\b.*\b0 .*7\.99 s"),
        ({"deposit_start_s": 7.0}, r"scene\.c3d: (.|\n)*release: 6\.4\d s .*deposit_start .*\b7 s"),
        ({"toe_off_s": 1.0}, r"scene\.c3d: (.|\n)*toe_off: 1 s .*lift_off .*\b2 s"),
    ],
)
def test_events_out_of_order_are_rejected(declared, problem):
    with pytest.raises(lumbar.InputError, match=problem):
        events_of(scene(), declared)


def test_a_person_sets_a_box_on_a_shelf(shared):
    """The box slides on its shelf from 1.60 s, rises by 0.26 m until 2.96 s and rests at 3.73 s (raw data, read by others).

    The wrists are slowest while it is swung upwards: there the thesis's rule finds the start of a deposit.
    """
    study = study_settings("studies/box_transfer.yaml").lifting
    file = shared / "real" / "lifting" / "s2m_box_transfer" / "Vicon.c3d"
    recording = lumbar.read(file, layout=study.markers)
    events = lumbar.lift(recording, ANN, 6.0, settings=study).analysed.events
    lifted, deposit = events["lift_off"], events["deposit_start"]
    assert 2.0 <= lifted.time_s <= 2.2
    assert deposit.time_s == pytest.approx(2.96, abs=0.02)
    assert deposit.earliest_s <= deposit.time_s < deposit.latest_s < 3.2
    assert 2.2 < deposit.thesis_s < 2.7
    assert events["release"].time_s == pytest.approx(3.73, abs=0.08)
    assert events["toe_off"].time_s is None


def test_the_thesis_starts_the_deposit_with_the_slowest_wrists():
    """The box rests for 0.05 s at 3.9 s and at 5 s; an event has the start by both rules."""
    by_descent = events_of(scene(pause=True))["deposit_start"]
    event = events_of(scene(pause=True), deposit_start="wrist_minimum")["deposit_start"]
    assert event.time_s == event.thesis_s == by_descent.thesis_s
    assert event.descent_s == by_descent.descent_s == by_descent.time_s
    by_hand = events_of(scene(pause=True), {"deposit_start_s": 4.8})["deposit_start"]
    assert (by_hand.time_s, by_hand.descent_s, by_hand.thesis_s) == (4.8, by_descent.time_s, event.time_s)
    none = events_of(scene(pause=True), deposit_start="wrist_minimum", prominence_m_s=2.0)["deposit_start"]
    assert none.time_s is None and "lifting.events.prominence_m_s" in none.how


def test_a_box_that_creeps_up_and_rises_no_further_is_lifted():
    """It rises by just what makes a lift, and too slowly to be distinguished from rest."""
    recording = scene()
    for name in ("BOX_1", "BOX_2"):
        recording[name][:, 1] = ramp(1.9, 5.0)
        recording[name][:, 2] = 0.3 + (LIFTING.events.rise_m + 0.001) * ramp(2.0, 4.5)
    event = events_of(recording)["lift_off"]
    assert event.earliest_s <= event.time_s < event.latest_s <= 4.7


@pytest.mark.parametrize("seed", [None, 4, 5])
@pytest.mark.parametrize("wrists", ["both", "right"])
def test_hands_replace_a_box_without_markers(seed, wrists):
    bare = hide_markers(scene(seed=seed), "BOX", *(["L_WRIST"] if wrists == "right" else []))
    events = events_of(bare)
    for name, true in TRUE.items():
        assert events[name].time_s == pytest.approx(true, abs=0.1), name


def test_hands_pick_up_from_the_floor_and_put_down_there(squat):
    """Only hands: the person bends to the floor until 1.4 s and again from 18.55 s (raw data)."""
    events = events_of(hide_markers(squat, "L_TOE", "R_TOE"))
    assert 1.0 < events["lift_off"].time_s < 1.6
    assert events["deposit_start"].time_s == pytest.approx(18.55, abs=0.2)
    assert 19.0 < events["release"].time_s < 20.6


def test_a_box_that_is_lifted_twice_is_reported_with_windows():
    twice = recording_of({name: np.concatenate([points] * 2) for name, points in scene().positions.items()})
    how = events_of(twice)["release"].how
    (start, middle), (again, end) = re.findall(r"\[([\d.]+), ([\d.]+)\]", how)
    assert float(start) == 0.0 and 8.0 < float(middle) == float(again) < 10.0 and float(end) == 15.99


@pytest.fixture(scope="module")
def lift():
    """True lift-off 2.0 s, toe-off 3.2 s, deposit 5.0 s, release 6.5 s; marked otherwise in the file."""
    steps = mark("Foot Off", 0.5, "Left"), mark("Foot Off", 3.25, "Right")
    marks = (
        mark("Lift-Off", 1.9, "General"),
        *steps,
        mark("Box_Release", 6.8),
        mark("Cough", 4.0),
        mark("Cough", 70.0),
    )
    return replace(scene(seed=1), events=marks)


def test_events_of_the_file_are_compared_and_change_nothing(lift):
    marked, unmarked = lift_of(lift), lift_of(replace(lift, events=()))
    events = marked.analysed.events
    assert [event.time_s for event in events.values()] == [
        event.time_s for event in unmarked.analysed.events.values()
    ]
    assert [event.file_s for event in events.values()] == [1.9, 3.25, None, 6.8]
    lines, early = str(marked).splitlines(), events["toe_off"].time_s - 3.25
    assert any(
        "toe_off 3.250 s (Right Foot Off)" in line and f"{-early:.3f} s earlier" in line for line in lines
    )
    assert sum(has_tokens(line, "Cough…4.00") for line in lines) == 1
    assert sum(has_tokens(line, "0.00 to 7.99 s…Cough…70.00") for line in lines) == 1
    assert "Right Foot Off" not in str(unmarked)


@pytest.mark.parametrize(("trial", "study"), [("file", "detection"), (None, "file")])
def test_events_of_the_file_replace_detected_ones_if_selected(lift, trial, study):
    events = events_of(lift, trial, taken_from=study)
    assert {
        name: (event.time_s, event.method) for name, event in events.items() if name != "deposit_start"
    } == {"lift_off": (1.9, "file"), "toe_off": (3.25, "file"), "release": (6.8, "file")}
    assert events["deposit_start"].method == "detected"
    assert events["release"].detected_s == pytest.approx(6.5, abs=0.05)


def test_events_set_by_hand_precede_those_of_the_file(lift):
    release = events_of(lift, {"release_s": 6.6, "reason": "seen on video"}, taken_from="file")["release"]
    assert (release.time_s, release.method, release.file_s) == (6.6, "declared", 6.8)


def test_ambiguous_events_of_the_file_are_rejected_only_if_selected(lift):
    twice = replace(lift, events=(*lift.events, mark("release", 7.0)))
    with pytest.raises(
        lumbar.InputError, match=r"scene\.c3d: release .*Box_Release .*6\.80 s.*release .*7\.00 s.*window_s"
    ):
        events_of(twice, "file")
    release = events_of(twice)["release"]
    assert release.file_s is None and "window_s" in release.file
    with pytest.raises(
        lumbar.InputError, match=r"scene\.c3d: .*'Cough'.*\b0\.00 to 7\.99 s.*lifting\.events\.labels"
    ):
        events_of(replace(lift, events=lift.events[-2:]), "file")
    assert events_of(lift, "file", labels={"deposit_start": ["cough"]})["deposit_start"].time_s == 4.0
