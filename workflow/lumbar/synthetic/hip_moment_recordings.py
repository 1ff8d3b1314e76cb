"""Moment at the hip of a lifter, beside each lift and in trials of their own; what Eq. 4.1 leaves out is hidden in it.

Head, arms and trunk swing about the hip like a pendulum whose angle counts forward from straight up. The box in the hands
and the stiffness of the passive tissues at the end of the range are no part of Eq. 4.1; `hidden` in the configuration says
which of them there are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lumbar.errors import InputError
from lumbar.synthetic.lifter import Movement
from lumbar.synthetic.swinging_body import GRAVITY, Mass, Signal, Swing, constant, rate

if TYPE_CHECKING:
    from lumbar.settings.twin import (
        SyntheticLift,
        SyntheticLiftingSettings,
        SyntheticMomentSettings,
        SyntheticPerson,
        TrueEvents,
    )

HAT_MASS, HAT_COM, HAT_GYRATION = 0.678, 0.626, 0.496
"""Head, arms and trunk (Winter 2009, Table 4.1): share of body mass; distance of the centre of mass from the greater
trochanter, and radius of gyration about the centre of mass, as shares of the distance from there to the glenohumeral
joint."""
TROCHANTER_TO_SHOULDER = 0.288
"""Share of stature (Drillis and Contini, 1966)."""
DECIMALS = {"time_s": 6, "angle_rad": 9, "moment_Nm": 3, "box_held": 9}
"""Digits after the point that are recorded."""
TAKE_OVER_S = 0.1
"""How long the hands take to load the whole box."""


def hip_moment(
    time: np.ndarray,
    angle: Signal,
    held: Signal,
    box_mass: float,
    person: SyntheticPerson,
    settings: SyntheticMomentSettings,
    gravity_m_s2: float,
    rng,
):
    """Record the hip moment of one movement.

    Parameters
    ----------
    time : ndarray, shape (samples,)
        Seconds.
    angle, held : callable
        Inclination of the trunk (rad) and share of the box that the hands carry, over time.
    box_mass : float
        kg.
    person : SyntheticPerson
    settings : SyntheticMomentSettings
    gravity_m_s2 : float
    rng : numpy.random.Generator

    Returns
    -------
    pandas.DataFrame
        Columns ``time_s``, ``angle_rad``, ``moment_Nm``, ``box_held``.
    """
    import pandas as pd

    hidden, segment = settings.hidden, TROCHANTER_TO_SHOULDER * person.height_m
    mass = HAT_MASS * person.mass_kg
    masses = [Mass(mass, constant(HAT_COM * segment))]
    if hidden.hand_distance_m:
        masses.append(Mass(box_mass, constant(hidden.hand_distance_m), held))
    inertia = mass * (HAT_GYRATION * segment) ** 2
    trunk = Swing(angle, tuple(masses), inertia, hanging=False, gravity=gravity_m_s2)
    moment = trunk.moment(time) + settings.damping_N_m_s * rate(angle, time)
    moment += hidden.stiffening_N_m * np.expm1(angle(time) / hidden.stiffening_angle_rad)
    moment += rng.normal(0, settings.noise_N_m, len(time))
    columns = {"time_s": time, "angle_rad": angle(time), "moment_Nm": moment, "box_held": held(time)}
    # As an instrument writes: what rounding leaves in further digits differs between processors, and at rest, where it
    # is all there is, a diagnosis would take it for motion. Adding zero turns −0 into 0.
    return pd.DataFrame({name: np.round(column, DECIMALS[name]) + 0.0 for name, column in columns.items()})


def trunk_angle(movement: Movement) -> Signal:
    """Inclination of the trunk between the movement's frames, at rest before and after it."""
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(movement.time, movement.hip_angle, k=5)
    return lambda time: spline(np.clip(time, movement.time[0], movement.time[-1]))


def box_held(events: TrueEvents) -> Signal:
    """Share of the box that the hands carry: from lift-off to release."""

    def held(time):
        taken = np.clip((time - events.lift_off) / TAKE_OVER_S, 0, 1)
        left = np.clip((time - events.release) / TAKE_OVER_S, 0, 1)
        return np.sin(0.5 * np.pi * taken) ** 2 - np.sin(0.5 * np.pi * left) ** 2

    return held


def trial_moment(
    name: str,
    settings: SyntheticLiftingSettings,
    movement: Movement,
    lift: SyntheticLift,
    person: SyntheticPerson,
    gravity_m_s2: float,
    rng,
):
    """Record the hip moment of a trial: one lift again and again, faster or slower.

    Parameters
    ----------
    name : str
        Of the trial, in ``twin.lifting.hip_moment.trials``.
    settings : SyntheticLiftingSettings
    movement : Movement
        Of the lift that is repeated.
    lift : SyntheticLift
    person : SyntheticPerson
    gravity_m_s2 : float
    rng : numpy.random.Generator
        For the noise and for the differences between repetitions.

    Returns
    -------
    pandas.DataFrame
        As `hip_moment`.
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
    """Write the trials of a study as CSV files.

    Parameters
    ----------
    settings : SyntheticLiftingSettings
    names : list of str
        Trials of ``hip_moment.trials``.
    paths : list of path
        File of each.
    seed : list of int
    gravity_m_s2 : float

    Raises
    ------
    InputError
        If the twin has no such trial, or a trial no such lift.
    """
    from lumbar.files import write_csv
    from lumbar.synthetic.lifting_recordings import true_movement

    known = settings.hip_moment.trials
    for name, path in zip(names, paths, strict=True):
        if name not in known:
            raise InputError(
                f"twin.lifting.hip_moment.trials: no trial {name!r}; the twin has {', '.join(known)}: add it there"
            )
        lift = known[name].lift
        movement = true_movement(settings, lift)
        content = settings.lifts[lift]
        rng = np.random.default_rng([*seed, list(known).index(name)])
        person = settings.people[content.person]
        write_csv(path, trial_moment(name, settings, movement, content, person, gravity_m_s2, rng))
