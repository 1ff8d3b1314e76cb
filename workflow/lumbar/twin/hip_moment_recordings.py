"""Trials of the hip moment alone: one lift of the synthetic twin again and again, with and without a box."""

import numpy as np

from lumbar.base.files import write_csv
from lumbar.settings.twin import SyntheticLift, SyntheticLiftingSettings, SyntheticPerson
from lumbar.twin.hip_moment import GRAVITY, box_held, hip_moment, trunk_angle
from lumbar.twin.lifter import Movement
from lumbar.twin.lifting_recordings import true_movement


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
