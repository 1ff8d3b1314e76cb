"""How often valid recordings of people who move give an alarm, and how many faults put into them are found."""

from collections import Counter

import numpy as np
import pytest
from lifting_cases import write_recording
from moving_people import FAULTS, MOTIONS, angles_of, faulty, labelled, move, valid_trial

from lumbar.lifting.quality.body import landmarks
from lumbar.lifting.quality.gate import examine, mask_findings
from lumbar.lifting.quality.screening import read_screened
from lumbar.records.marker_axes import check_axes, find_axes, rotation_to_standard
from lumbar.settings.layout import MarkerLayout

SEEDS = [
    range(1),
    pytest.param(range(1, 3), marks=pytest.mark.statistical),
    pytest.param(range(20), marks=pytest.mark.acceptance),
]
"""Seeds of each of the ten kinds of trials."""


def trials(seeds):
    """Yield trials with their points in standard axes, and the times of the frames."""
    for kind in MOTIONS:
        for seed in seeds:
            trial = valid_trial(kind, seed)
            rotation = rotation_to_standard(trial.up, trial.forward)
            points = {label: places @ rotation.T for label, places in trial.points.items()}
            yield trial, points, np.arange(len(next(iter(points.values())))) / trial.rate


@pytest.mark.parametrize("seeds", SEEDS)
def test_valid_trials_give_hardly_any_alarm(seeds):
    alarms, count = Counter(), 0
    for trial, points, time in trials(seeds):
        found = {finding.kind for finding in examine(points, time, trial.rate, trial.height_m)}
        named = landmarks(points)
        axes = find_axes({name: trial.points[label] for name, label in named.items()})
        turned = trial.kind == "turn" and axes and axes.forward is None
        if axes is None or axes.up != trial.up or not (turned or axes.forward == trial.forward):
            found.add("axes")
        check_axes({name: points[label] for name, label in named.items()}, MarkerLayout(), trial.kind)
        alarms.update(found)
        alarms["trials"] += bool(found)
        count += 1
    assert alarms["trials"] <= count / 100, alarms


@pytest.mark.parametrize("seeds", SEEDS[1:])
def test_faults_in_valid_trials_are_found(seeds):
    seen, others = Counter(), []
    for trial, points, time in trials(seeds):
        for number, (fault, kinds) in enumerate(FAULTS.items()):
            rng = np.random.default_rng([number, len(time)])
            spoilt, labels, frames = faulty(points, fault, trial.rate, rng)
            findings = examine(spoilt, time, trial.rate)
            right = [
                finding
                for finding in findings
                if finding.kind in kinds and set(finding.markers) == labels
                if finding.frames.start < frames.stop + 5 and finding.frames.stop > frames.start - 5
            ]
            seen[fault] += bool(right)
            others += [(trial.kind, fault, finding) for finding in findings if finding not in right]
    count = len(MOTIONS) * len(seeds)
    assert min(seen.values()) >= 0.95 * count, seen
    assert len(others) <= 0.03 * count, others


def test_jump_that_only_most_frames_decide_is_proposed_and_kept():
    """A wrist is elsewhere in the last third of a walk: which part is wrong cannot be seen."""
    time = np.arange(600) / 100
    body = move(angles_of("walk", time, np.random.default_rng(1)), 100, 1.75)
    points = labelled(body, "ior")
    points["L_RSP"][400:] += [0.09, 0, 0.03]
    (finding,) = examine(points, time, 100)
    assert (finding.kind, finding.outcome, finding.markers) == ("jump", "proposed", ("L_RSP",))
    assert mask_findings(points, [finding])["L_RSP"] is points["L_RSP"]


@pytest.mark.parametrize("seed", range(5))
def test_part_of_a_step_shows_the_axes(seed):
    """One foot is far ahead of the other in all frames."""
    time = np.arange(25) / 100
    body = move(angles_of("walk", time, np.random.default_rng(seed)), 100, 1.75)
    for marker_set in ("gait", "ior", "spine", "lower"):
        points = labelled(body, marker_set)
        named = {name: points[label] for name, label in landmarks(points).items()}
        axes = find_axes(named)
        assert (axes.up, axes.forward) == ("+z", "+y")
        check_axes(named, MarkerLayout(), "step.trc")


def test_body_that_turns_shows_no_forward_axis_and_contradicts_none(tmp_path):
    time = np.arange(800) / 100
    angles = angles_of("walk", time, np.random.default_rng(0))
    angles["heading"] = np.radians(270) * time / time[-1]
    points = labelled(move(angles, 100, 1.75), "gait")
    named = {name: points[label] for name, label in landmarks(points).items()}
    axes = find_axes(named)
    assert (axes.up, axes.forward) == ("+z", None)
    for forward in ("+y", "-y", "+x", "-x"):
        rotation = rotation_to_standard("+z", forward)
        check_axes(
            {name: places @ rotation.T for name, places in named.items()},
            MarkerLayout(forward=forward),
            "turn.trc",
        )
    write_recording(tmp_path / "turn.c3d", named)
    _, sheet = read_screened(tmp_path / "turn.c3d", MarkerLayout(subject_prefix="ann"))
    assert "forward" in sheet.unchecked and "up" not in sheet.unchecked
