"""The way back out: a lift's cleaned markers and the load on its hands as files that OpenSim goes on from.

OpenSim's axes are x forward, y up, z to the right; trajectories are TRC, forces MOT with an ExternalLoads that applies them.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lumbar.base.files import write_text
from lumbar.base.templates import template
from lumbar.lifting.movement.carried_object import carried_object
from lumbar.lifting.movement.cleaning import clean, derivative
from lumbar.lifting.movement.events import held_frames
from lumbar.lifting.movement.lift import within_window
from lumbar.lifting.movement.pendulum_states import turn
from lumbar.lifting.movement.rigid_filling import BodyFilling
from lumbar.records.c3d_writer import write_c3d

if TYPE_CHECKING:
    from lumbar.interface.lift import Lift

HANDS = ("hand_r", "hand_l")
"""Bodies of OpenSim's models that the load acts on."""
_FORWARD_UP_RIGHT = [1, 2, 0]


def export_opensim(lift: Lift, folder: Path, gravity: float) -> list[str]:
    """Write ``NAME.trc``, ``NAME.c3d`` and, where a load is held, ``NAME_hands.mot`` with its ``.xml``; say what they hold.

    All markers of the file by their own labels, screened, gaps filled, filtered, in the trial's window. `gravity` is in m/s².
    """
    from lumbar.interface.lift import labelled_markers

    settings, stem = lift.settings, folder / lift.name
    source, height_m = lift.analysed.recording.source, lift.subject.height_m
    labelled = labelled_markers(source, settings.markers, height_m, BodyFilling(settings))
    smooth = within_window(clean(labelled, settings)[0], lift.trial, settings)
    points, first = (
        1e3 * np.stack(list(smooth.positions.values()), axis=1),
        round(smooth.time[0] * smooth.rate),
    )
    write_c3d(stem.with_name(f"{lift.name}.c3d"), points, list(smooth.positions), smooth.rate, first + 1)
    _write_trc(stem.with_name(f"{lift.name}.trc"), smooth.time, smooth.rate, list(smooth.positions), points)
    told = f"{stem}.trc, .c3d: {len(smooth.positions)} markers, cleaned, {len(smooth)} frames"
    columns = _loads(lift, gravity)
    if columns is None:
        return [
            told,
            "no load on the hands: there is none, or it is not seen all the time from lift-off to release",
        ]
    loads = folder / f"{lift.name}_hands.mot"
    table = np.column_stack([lift.analysed.recording.time, *columns.values()])
    rows = ["\t".join(f"{value:.6f}" for value in row) for row in table]
    head = f"{loads.stem}\nversion=1\nnRows={len(table)}\nnColumns={table.shape[1]}\ninDegrees=no\nendheader"
    write_text(loads, "\n".join([head, "\t".join(["time", *columns]), *rows, ""]))
    applied = template("interface/external_loads.xml.jinja").render(file=loads.name, hands=HANDS)
    write_text(loads.with_suffix(".xml"), applied)
    return [told, f"{loads}, .xml: half of the load's weight and inertia on each hand, at the load's centre"]


def _write_trc(path: Path, time: np.ndarray, rate: float, labels: list[str], points: np.ndarray) -> None:
    """Write markers, shape (n_frames, n_markers, 3): right, forward, up in millimetres; an empty cell where not seen."""
    keys = (
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames"
    )
    values = f"{rate:.12g}\t{rate:.12g}\t{len(time)}\t{len(labels)}\tmm\t{rate:.12g}\t1\t{len(time)}"
    names = ["Frame#", "Time", *(cell for label in labels for cell in (label, "", ""))]
    axes = ["", "", *(f"{axis}{number}" for number in range(1, len(labels) + 1) for axis in "XYZ")]
    lines = [["PathFileType", "4", "(X/Y/Z)", path.name], [keys], [values], names[:-2], axes, []]
    for frame, (at, row) in enumerate(zip(time, points[..., _FORWARD_UP_RIGHT], strict=True), 1):
        cells = ("" if np.isnan(value) else f"{value:.5f}" for value in row.ravel())
        lines.append([str(frame), f"{at:.6f}", *cells])
    write_text(path, "".join("\t".join(cells) + "\n" for cells in lines))


def _loads(lift: Lift, gravity: float) -> Mapping[str, np.ndarray] | None:
    """Force of the load on each hand in newtons, the point where it acts in metres, no torque: zero where nothing is held.

    None where there is no load, or it is not seen throughout.
    """
    recording, mass = lift.analysed.recording, lift.trial.box_mass_kg
    held, (load, _) = held_frames(recording.time, lift.analysed.events), carried_object(recording)
    if not mass or load is None or not held.any():
        return None
    load = turn(load, -lift.analysed.heading)
    force = derivative(load, recording.rate, 2)
    force[:, 2] += gravity
    force *= -0.5 * mass
    if np.isnan(force[held]).any():
        return None
    kinds = {"force_v": force, "force_p": load, "torque_": 0 * force}
    return {
        f"{hand}_{kind}{axis}": np.where(held, column, 0.0)
        for hand in HANDS
        for kind, vectors in kinds.items()
        for axis, column in zip("xyz", vectors[:, _FORWARD_UP_RIGHT].T, strict=True)
    }
