"""Centres of mass and pendulum states of the fitted body model, each with its standard deviation.

What spreads: joints, landmarks and noise as far as the trial and the priors leave them open. What does not: the segment
table's shares (their spread is listed by `lumbar.lifting.movement.model_spread`) and the instants of the events.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from lumbar.lifting.body_model.fit import BodyFit
from lumbar.lifting.body_model.structure import Unknowns
from lumbar.lifting.body_model.trunk import model_points, model_recording
from lumbar.lifting.movement.centre_of_mass import centres_of_mass
from lumbar.lifting.movement.events import Event
from lumbar.lifting.movement.pendulum_states import PendulumStates, pendulum_states, pivot_trajectory, turn
from lumbar.lifting.movement.segments import SegmentTable

Planar = dict[tuple[str, str], PendulumStates]


@dataclass(frozen=True)
class Conditions:
    """What turns a moving body into pendulums: as of the rules' result for the same lift."""

    table: SegmentTable
    body_mass: float
    box_mass: float
    """`body_mass`, `box_mass`: kilograms."""
    share: str
    """How the box is shared among the centres of mass."""
    in_position: bool
    """Whether the box counts to the place of a centre of mass."""
    pivot: str
    """One of `lumbar.lifting.movement.pendulum_states.PIVOTS`."""
    heading: float
    """Radians by which the axes are turned."""
    events: Mapping[str, Event]
    points: int
    """Length of the states."""


@dataclass(frozen=True)
class ModelPendulums:
    """Pendulums of the deposit, by centre of mass and plane."""

    states: Planar
    """Of the most probable unknowns."""
    draws: list[Planar]
    """Of unknowns drawn from the posterior."""
    masses: dict[str, tuple[float, float]]
    """Of each centre of mass without and with its share of the box, kilograms."""

    def sd(self, com: str, plane: str) -> PendulumStates:
        """Standard deviation of every state (of its time: 0), as the spread of the draws about the most probable."""
        best = self.states[com, plane]
        drawn = [draw[com, plane] for draw in self.draws]

        def spread(name: str) -> np.ndarray:
            off = [getattr(states, name) - getattr(best, name) for states in drawn]
            return np.sqrt(np.mean(np.square(off), axis=0))

        return PendulumStates(*(spread(field.name) for field in fields(PendulumStates)))


def model_pendulums(fit: BodyFit, conditions: Conditions, draws: Sequence[Unknowns]) -> ModelPendulums:
    """Pendulum states of a fitted body, and of draws from its posterior.

    Parameters
    ----------
    conditions : Conditions
        With a start of deposit and a release.
    draws : sequence of Unknowns
        As of `BodyFit.draws`.

    Raises
    ------
    InputError
        The model lacks the pivot's points, or the deposit is too short.
    """
    best, masses = _states(fit, fit.best, conditions)
    return ModelPendulums(best, [_states(fit, draw, conditions)[0] for draw in draws], masses)


def _states(
    fit: BodyFit, unknowns: Unknowns, conditions: Conditions
) -> tuple[Planar, dict[str, tuple[float, float]]]:
    recording, points = model_recording(fit, unknowns), model_points(fit, unknowns)
    events = dict(conditions.events)
    centres = centres_of_mass(
        recording,
        points,
        conditions.table,
        conditions.body_mass,
        conditions.box_mass,
        conditions.share,
        events,
    )
    pivot = pivot_trajectory(replace(recording, source="body model"), points, conditions.pivot)
    start, stop = events["deposit_start"].time_s, events["release"].time_s
    states: Planar = {}
    for com, centre in centres.items():
        position = centre.position_with_box if conditions.in_position else centre.position
        relative = turn(position - pivot, conditions.heading)
        planar = pendulum_states(
            recording.time, relative, start, stop, conditions.points, f"body model, {com}"
        )
        states |= {(com, plane): values for plane, values in planar.items()}
    return states, {com: (centre.mass_kg, centre.mass_with_box_kg) for com, centre in centres.items()}
