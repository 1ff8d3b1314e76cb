"""The way back out: a lift's cleaned markers and the loads at its hands as files that OpenSim goes on from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lumbar.base.errors import InputError
from lumbar.base.files import write_text
from lumbar.base.templates import template
from lumbar.lifting.movement.carried_object import carried_object
from lumbar.lifting.movement.cleaning import clean, derivative
from lumbar.lifting.movement.events import held_frames
from lumbar.lifting.movement.lift import within_window
from lumbar.lifting.movement.pendulum_states import turn
from lumbar.lifting.movement.rigid_filling import BodyFilling
from lumbar.records.c3d_writer import write_c3d
from lumbar.records.opensim_files import opensim_axes, write_mot, write_trc

if TYPE_CHECKING:
    from lumbar.interface.lift import Lift

HANDS = ("hand_r", "hand_l")
"""Bodies of OpenSim's models that the loads act on."""


def export_opensim(lift: Lift, folder: Path, gravity: float) -> list[str]:
    """Write ``NAME.trc``, ``NAME.c3d`` and, where a load is held, ``NAME_hands.mot`` with its ``.xml``; say what they hold.

    All markers of the file by their own labels, screened, gaps filled, filtered, in the trial's window. `gravity` is in m/s².
    """
    from lumbar.interface.lift import labelled_markers

    recording = lift.analysed.recording
    labelled = labelled_markers(
        recording.source, lift.settings.markers, lift.subject.height_m, BodyFilling(lift.settings, None)
    )
    smooth = within_window(clean(labelled, lift.settings).smooth, lift.trial, lift.settings)
    stem, positions = folder / lift.name, smooth.positions
    write_trc(stem.with_suffix(".trc"), smooth.time, smooth.rate, positions)
    points = 1e3 * np.stack(list(positions.values()), axis=1)
    write_c3d(
        stem.with_suffix(".c3d"),
        points,
        list(positions),
        smooth.rate,
        "mm",
        round(smooth.time[0] * smooth.rate) + 1,
    )
    told = [f"{stem}.trc, {stem}.c3d: {len(positions)} markers, cleaned, {len(smooth)} frames"]
    try:
        columns = _loads(lift, gravity)
    except InputError as reason:
        return [*told, f"no loads at the hands: {reason}"]
    loads = folder / f"{lift.name}_hands.mot"
    write_mot(loads, recording.time, columns)
    applied = template("interface/external_loads.xml.jinja").render(file=loads.name, hands=HANDS)
    write_text(loads.with_suffix(".xml"), applied)
    return [*told, f"{loads}, .xml: half of the load's weight and inertia on each hand, at the load's centre"]


def _loads(lift: Lift, gravity: float) -> dict[str, np.ndarray]:
    """Force of the load on each hand in newtons, the point where it acts in metres, and no torque; zero while nothing is held."""
    recording, mass = lift.analysed.recording, lift.trial.box_mass_kg
    held = held_frames(recording.time, lift.analysed.events)
    load, _ = carried_object(recording)
    if not mass or load is None or not held.any():
        raise InputError("no box, no markers on it or on the wrists, or it is never held")
    load = turn(load, -lift.analysed.heading)
    force = derivative(load, recording.rate, 2)
    force[:, 2] += gravity
    force *= -0.5 * mass
    if np.isnan(force[held]).any():
        raise InputError("the load is not seen all the time that it is held")
    found: dict[str, np.ndarray] = {}
    for hand in HANDS:
        for kind, vectors in (("force_v", force), ("force_p", load), ("torque_", 0 * force)):
            turned = opensim_axes(np.where(held[:, None], vectors, 0.0))
            found |= {f"{hand}_{kind}{axis}": column for axis, column in zip("xyz", turned.T, strict=True)}
    return found
