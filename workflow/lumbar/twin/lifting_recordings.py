"""Lifting recordings of the synthetic twin: marker files (C3D) and the hip moment beside each, and trials of the moment alone,
one lift again and again, with and without a box.
"""

import os
from collections.abc import Iterable

import numpy as np

from lumbar.base.errors import InputError
from lumbar.base.files import write_csv
from lumbar.records.c3d_writer import write_c3d
from lumbar.settings.twin import SyntheticLift, SyntheticLiftingSettings, SyntheticPerson
from lumbar.twin.hip_moment import GRAVITY, box_held, hip_moment, trunk_angle
from lumbar.twin.lifter import Movement, simulate


def settings_of_lifts(settings: SyntheticLiftingSettings, lifts: Iterable[str]) -> SyntheticLiftingSettings:
    """Return the settings with these lifts and who lifts alone: whoever is added makes no other recording anew."""
    moved = {name: settings.lifts[name] for name in lifts}
    people = {lift.person: settings.people[lift.person] for lift in moved.values()}
    return settings.model_copy(update={"people": people, "lifts": moved, "groups": {}, "cohort": None})


def true_movement(settings: SyntheticLiftingSettings, lift: str) -> Movement:
    """Movement of one lift, ``"expert_23kg"``, without noise or gaps.

    Raises
    ------
    InputError
        If its events are not in order.
    """
    content = settings.lifts[lift]
    events = content.events_s
    order = [1.2, events.lift_off, events.toe_off, events.deposit_start, events.release]
    if np.any(np.diff([*order, settings.duration_s - 0.3]) < 0.2):
        raise InputError(
            f"twin.lifting.lifts.{lift}.events_s: {vars(events)}; lift_off (from 1.4 s on), toe_off, "
            "deposit_start and "
            "release must follow at least 0.2 s apart and end 0.5 s before duration_s "
            f"({settings.duration_s} s)"
        )
    frames = round(settings.duration_s * settings.rate_Hz)
    time = np.arange(frames) / settings.rate_Hz
    return simulate(time, settings.people[content.person], content, settings.workplace)


def write_lift(
    settings: SyntheticLiftingSettings,
    lift: str,
    seed: list[int],
    markers_path,
    moment_path,
    gravity_m_s2: float = GRAVITY,
) -> None:
    """Write one lift as a C3D file and, where it has a path, the moment at the hip as a CSV file.

    `seed` is that of the noise and the gaps.
    """
    movement = true_movement(settings, lift)
    rng = np.random.default_rng(seed)
    measured = {
        name: points + rng.normal(0, settings.marker_noise_mm * 1e-3, points.shape)
        for name, points in movement.markers.items()
    }
    _open_gaps(measured, settings, rng)
    write_markers(markers_path, measured, settings.rate_Hz, subject=settings.lifts[lift].person)
    if moment_path is not None:
        content = settings.lifts[lift]
        person = settings.people[content.person]
        held = box_held(content.events_s)
        signals = movement.time, trunk_angle(movement), held
        write_csv(
            moment_path,
            hip_moment(*signals, content.box_mass_kg, person, settings.hip_moment, gravity_m_s2, rng),
        )


def _open_gaps(markers: dict[str, np.ndarray], settings: SyntheticLiftingSettings, rng) -> None:
    """Hide some markers for a moment, as behind an arm; never at the ends of the recording."""
    rate, gaps = settings.rate_Hz, settings.gaps
    longest = max(1, int(gaps.longest_s * rate))
    margin = int(0.3 * rate)
    for name in rng.choice(sorted(markers), size=min(gaps.count, len(markers)), replace=False):
        length = int(rng.integers(1, longest + 1))
        start = int(rng.integers(margin, len(markers[name]) - margin - length))
        markers[name][start : start + length] = np.nan


def write_markers(path: str | os.PathLike, markers: dict[str, np.ndarray], rate: float, subject: str) -> None:
    """Write markers (metres, shape (n, 3), NaN where one was not seen) as a C3D file in millimetres, `rate` in hertz.

    Labels have the subject's prefix, those of the box ``box:``.
    """
    labels = [f"{'box' if name.startswith('BOX_') else subject}:{name}" for name in markers]
    write_c3d(path, 1e3 * np.stack(list(markers.values()), axis=1), labels, float(rate))


def trial_moment(
    name: str,
    settings: SyntheticLiftingSettings,
    movement: Movement,
    lift: SyntheticLift,
    person: SyntheticPerson,
    gravity_m_s2: float,
    rng,
):
    """Record the hip moment of a trial, as `hip_moment` does: one lift again and again, faster or slower.

    `movement` is that of the lift; `rng` draws the noise and the differences between repetitions.
    """
    trial = settings.hip_moment.trials[name]
    once, cycle = trunk_angle(movement), settings.duration_s
    scale = 1 + trial.variation * rng.standard_normal(trial.repetitions)
    held_once = box_held(lift.events_s)

    def phase(time):
        """Which repetition, and the time within the lift."""
        lifting = np.clip(time * trial.pace, 0, cycle * trial.repetitions - 1e-9)
        return (lifting // cycle).astype(int), lifting % cycle

    def angle(time):
        repetition, within = phase(time)
        return scale[repetition] * once(within)

    def held(time):
        return trial.with_box * held_once(phase(time)[1])

    samples = round(cycle * trial.repetitions / trial.pace * settings.rate_Hz)
    time = np.arange(samples) / settings.rate_Hz
    return hip_moment(time, angle, held, lift.box_mass_kg, person, settings.hip_moment, gravity_m_s2, rng)


def write_trials(
    settings: SyntheticLiftingSettings,
    names: list[str],
    paths: list,
    seed: list[int],
    gravity_m_s2: float = GRAVITY,
) -> None:
    """Write trials of ``hip_moment.trials``, each as a CSV file."""
    known = settings.hip_moment.trials
    for name, path in zip(names, paths, strict=True):
        lift = known[name].lift
        movement = true_movement(settings, lift)
        content = settings.lifts[lift]
        rng = np.random.default_rng([*seed, list(known).index(name)])
        person = settings.people[content.person]
        write_csv(path, trial_moment(name, settings, movement, content, person, gravity_m_s2, rng))
