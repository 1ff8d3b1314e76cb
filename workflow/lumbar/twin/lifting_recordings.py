"""Lifting recordings of the synthetic twin: marker files (C3D) with hip moments, and hip moments of repeated lifts."""

from collections.abc import Iterable

import numpy as np

from lumbar.base.errors import InputError
from lumbar.base.files import write_csv
from lumbar.records.c3d_file import write_c3d
from lumbar.settings.twin import MomentTrial, SyntheticLiftingSettings
from lumbar.twin.hip_moment import GRAVITY, Signal, box_held, hip_moment, trunk_angle
from lumbar.twin.lifter import Movement, simulate


def select_lifts(settings: SyntheticLiftingSettings, lifts: Iterable[str]) -> SyntheticLiftingSettings:
    """Return the settings reduced to these lifts and their people, so that an added person changes no other recording."""
    moved = {name: settings.lifts[name] for name in lifts}
    people = {lift.person: settings.people[lift.person] for lift in moved.values()}
    return settings.model_copy(update={"people": people, "lifts": moved, "groups": {}, "cohort": None})


def true_movement(settings: SyntheticLiftingSettings, lift: str) -> Movement:
    """Return the movement of one lift, e.g. ``"expert_23kg"``, without noise or gaps.

    Raises
    ------
    InputError
        If the events of the lift are not in order.
    """
    content = settings.lifts[lift]
    events = content.events_s
    order = [1.2, events.lift_off, events.toe_off, events.deposit_start, events.release]
    if np.any(np.diff([*order, settings.duration_s - 0.3]) < 0.2):
        raise InputError(
            f"twin.lifting.lifts.{lift}.events_s: {vars(events)}; lift_off (at least 1.4 s), toe_off, deposit_start and release "
            f"must follow at least 0.2 s apart and end 0.5 s before duration_s ({settings.duration_s} s)"
        )
    time = np.arange(round(settings.duration_s * settings.rate_Hz)) / settings.rate_Hz
    return simulate(time, settings.people[content.person], content, settings.workplace)


def write_lift(
    settings: SyntheticLiftingSettings,
    lift: str,
    seed: list[int],
    markers_path,
    moment_path,
    gravity_m_s2: float = GRAVITY,
) -> None:
    """Write one lift as a C3D file, and its hip moment as a CSV file if a path is given; `seed` is for noise and gaps."""
    movement = true_movement(settings, lift)
    rng = np.random.default_rng(seed)
    measured = {
        name: points + rng.normal(0, settings.marker_noise_mm * 1e-3, points.shape)
        for name, points in movement.markers.items()
    }
    # Hide some markers for a moment, as behind an arm; never at the ends of the recording.
    rate, gaps = settings.rate_Hz, settings.gaps
    longest, margin = max(1, int(gaps.longest_s * rate)), int(0.3 * rate)
    for name in rng.choice(sorted(measured), size=min(gaps.count, len(measured)), replace=False):
        length = int(rng.integers(1, longest + 1))
        start = int(rng.integers(margin, len(measured[name]) - margin - length))
        measured[name][start : start + length] = np.nan
    content = settings.lifts[lift]
    # Labels have the prefix of the person, those of the box its own; a C3D file has millimetres.
    labels = [f"{'box' if name.startswith('BOX_') else content.person}:{name}" for name in measured]
    write_c3d(markers_path, 1e3 * np.stack(list(measured.values()), axis=1), labels, float(rate))
    if moment_path is not None:
        signals = trunk_angle(movement), box_held(content.events_s)
        write_csv(moment_path, hip_moment(movement.time, signals, content, settings, gravity_m_s2, rng))


def _repeat_lift(
    settings: SyntheticLiftingSettings, trial: MomentTrial, rng: np.random.Generator
) -> tuple[np.ndarray, tuple[Signal, Signal]]:
    """Return time, angle and share of the box of a trial: one lift, repeated at several speeds, with and without a box."""
    cycle = settings.duration_s
    single_angle = trunk_angle(true_movement(settings, trial.lift))
    single_held = box_held(settings.lifts[trial.lift].events_s)
    scale = 1 + trial.variation * rng.standard_normal(trial.repetitions)

    def phase(time):
        """Return the number of the repetition and the time within the lift."""
        lifting = np.clip(time * trial.pace, 0, cycle * trial.repetitions - 1e-9)
        return (lifting // cycle).astype(int), lifting % cycle

    def angle(time):
        repetition, instant = phase(time)
        return scale[repetition] * single_angle(instant)

    samples = round(cycle * trial.repetitions / trial.pace * settings.rate_Hz)
    held = lambda time: trial.with_box * single_held(phase(time)[1])  # noqa: E731
    return np.arange(samples) / settings.rate_Hz, (angle, held)


def write_trials(
    settings: SyntheticLiftingSettings,
    names: list[str],
    paths: list,
    seed: list[int],
    gravity_m_s2: float = GRAVITY,
) -> None:
    """Write the hip moments of trials of ``hip_moment.trials`` as CSV files."""
    trials = settings.hip_moment.trials
    for name, path in zip(names, paths, strict=True):
        rng, lift = (
            np.random.default_rng([*seed, list(trials).index(name)]),
            settings.lifts[trials[name].lift],
        )
        motion = _repeat_lift(settings, trials[name], rng)
        write_csv(path, hip_moment(*motion, lift, settings, gravity_m_s2, rng))
