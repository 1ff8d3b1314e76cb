"""Force plates as a check of the centre of mass: the ground must push as the body moves, and below its centre."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lumbar.base.errors import InputError, LumbarError
from lumbar.base.yaml_file import shipped_yaml
from lumbar.lifting.movement.carried_object import carried_object
from lumbar.lifting.movement.centre_of_mass import whole_body_centre
from lumbar.lifting.movement.cleaning import derivative, low_pass
from lumbar.lifting.movement.events import held_frames
from lumbar.lifting.movement.joint_centres import unit
from lumbar.lifting.movement.pendulum_states import turn

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from lumbar.lifting.movement.lift import AnalysedLift
    from lumbar.records.ground_forces import ForcePlate
    from lumbar.settings.lifting import LiftingSettings
    from lumbar.settings.subject import SubjectSettings, TrialSettings

GRAVITY = 9.81
LOADED_N = 20.0
SHORTEST_S = 0.2
"""The person must stand on the plates for so long."""
BESIDE_M = 0.10
"""How far a marker of the foot may lie beside the plates."""
MASS_TOLERANCE = 0.10
"""Share by which the plates' weight may differ from the declared one."""
MOVING_N = 20.0
"""Standard deviation of the expected force from which on its course can be compared."""
FOLLOWS = 0.8
"""Correlation below which the force does not follow the movement."""
TELLS_RATE = 0.9
"""Correlation of force and acceleration from which on the ratio of both tells the rate of the markers."""
OTHER_RATE = 1.25
"""Factor by which the rate may be off before it is said: the model of the body takes up to a tenth."""
_ROUNDS = 5
OFF_MM, ELSEWHERE_MM = 60.0, 300.0
"""Mean distance of centre of pressure and centre of mass that says the centre is off, or the plates lie elsewhere."""
_SAID: dict[str, Any] = shipped_yaml(Path(__file__).with_suffix(".yaml"))
_FACTORS: dict[float, str] = _SAID["factors"]
"""What a ratio of both weights within 5 % of these, or of their inverses, means."""


@dataclass(frozen=True)
class PlateCheck:
    """What force plates say of a lift."""

    plates: int
    """Plates of the file."""
    seconds: float = 0.0
    """How long the person stood wholly on them."""
    plates_kg: float | None = None
    declared_kg: float | None = None
    """`plates_kg`, `declared_kg`: mass on the plates, from the mean force over the mean of g + acceleration, and the
    declared one of the body with the box while it is held, mean over time."""
    correlation: float | None = None
    """Of the vertical force with mass × (g + acceleration of the centre of mass); None where hardly anything moves."""
    rmse_N: float | None = None
    """RMS difference of both."""
    rate_factor: float | None = None
    """Stated rate over the one at which the accelerations are those of the force; None where hardly anything moves or the
    force does not follow closely."""
    forward_mm: float | None = None
    right_mm: float | None = None
    """`forward_mm`, `right_mm`: mean place of the centre of pressure as seen from the projection of the centre of mass.
    """
    sway_mm: float | None = None
    """RMS of what remains of that distance without its mean."""
    findings: tuple[str, ...] = ()
    """What does not fit and what that means; or why there is nothing to compare."""
    notes: tuple[str, ...] = ()
    """What reading the plates took for granted."""
    ground: np.ndarray | None = field(default=None, repr=False, compare=False)
    """Shape (n, 6): force in newtons and moment about the origin in N·m by which the ground acts on the person, at the frames
    of the recording; NaN where the person does not stand wholly on the plates."""

    def as_dict(self) -> dict:
        """Plain data for JSON, without the course of the force."""
        return {name: value for name, value in asdict(replace(self, ground=None)).items() if name != "ground"}

    def __str__(self) -> str:
        lines = []
        if self.plates_kg is not None:
            course = "hardly any movement" if self.correlation is None else f"r = {self.correlation:.3f}"
            lines.append(_SAID["figures"].format(check=self, course=course))
        return "\n".join([*lines, *(f"force plates: {finding}" for finding in self.findings)])


def plate_check(
    lift: AnalysedLift,
    subject: SubjectSettings,
    trial: TrialSettings,
    settings: LiftingSettings,
    forces: Path | None = None,
) -> PlateCheck | None:
    """Compare a lift with the force plates of its own file, or with a file of forces; None where there are none.

    Plates that cannot be read refuse no lift: what is wrong with them is a finding.
    """
    from lumbar.records.force_plates import read_force_plates

    try:
        plates = read_force_plates(forces or lift.recording.source, settings.markers)
    except LumbarError as error:
        return PlateCheck(0, findings=(f"not read: {error}",))
    if forces is not None and not plates:
        return PlateCheck(0, findings=(f"not read: {forces} has no columns of ground reaction forces",))
    return check_against_plates(lift, plates, subject, trial, settings)


def check_against_plates(
    lift: AnalysedLift,
    plates: Sequence[ForcePlate],
    subject: SubjectSettings,
    trial: TrialSettings,
    settings: LiftingSettings,
) -> PlateCheck | None:
    """Compare the whole body's centre of mass with force plates.

    Vertically mass × (g + acceleration) must be the plates' force; the centre of pressure stays near the projection of the
    centre of mass, and on average below it as long as the person stands. The plates are on the clock of the recording and in
    the axes of its markers; without any there is nothing to say.
    """
    if not plates:
        return None
    notes = tuple(f"{plate.name}: {note}" for plate in plates for note in plate.notes)
    try:
        return _compared(lift, plates, subject, trial, settings, notes)
    except LumbarError as error:
        return PlateCheck(len(plates), findings=(f"not compared: {error}",), notes=notes)


def _compared(lift, plates, subject, trial, settings, notes) -> PlateCheck:
    recording, plates = lift.recording, [_turned(plate, lift.heading) for plate in plates]
    centre = whole_body_centre(recording, lift.points, lift.table)
    held = held_frames(recording.time, lift.events)
    box, _ = carried_object(recording)
    box_mass = trial.box_mass_kg if box is not None else 0.0
    mass = subject.mass_kg + box_mass * held
    weight = subject.mass_kg * (GRAVITY + _vertical_acceleration(centre, recording.rate))
    if box_mass:
        weight = weight + held * box_mass * (GRAVITY + _vertical_acceleration(box, recording.rate))
        centre = (subject.mass_kg * centre + (box_mass * held)[:, None] * np.nan_to_num(box)) / mass[:, None]
    ground, pressure = _at_frames(lift, plates, settings)
    force = ground[:, 2]
    stands = (force > LOADED_N) & np.isfinite(weight) & _on_plates(lift, plates)
    # Within one period of an end a filtered trajectory leans on how it was continued.
    margin = int(np.ceil(recording.rate / settings.filter.cutoff_Hz))
    stands[:margin], stands[-margin:] = False, False
    seconds = float(stands.sum() / recording.rate)
    if seconds < SHORTEST_S:
        raise InputError(f"the person stands wholly on the plates for {seconds:.2f} s only")
    offset = 1e3 * (pressure - centre)[stands]
    right = unit(lift.points.right * [1.0, 1.0, 0.0])[stands]
    ahead = np.sum(offset * np.cross([0.0, 0.0, 1.0], right), axis=1)
    aside = np.sum(offset * right, axis=1)
    moves = np.std(weight[stands]) > MOVING_N
    still = GRAVITY * mass[stands]
    share, rate_factor = _rate_factor(weight[stands] - still, force[stands], still) if moves else (None, None)
    if rate_factor is None or not _other_rate(rate_factor):
        share = force[stands].mean() / weight[stands].mean()
    check = PlateCheck(
        len(plates),
        seconds,
        plates_kg=float(mass[stands].mean() * share),
        declared_kg=float(mass[stands].mean()),
        correlation=float(np.corrcoef(force[stands], weight[stands])[0, 1]) if moves else None,
        rmse_N=float(np.sqrt(np.mean((force - weight)[stands] ** 2))),
        rate_factor=rate_factor,
        forward_mm=float(np.nanmean(ahead)),
        right_mm=float(np.nanmean(aside)),
        sway_mm=float(np.sqrt(np.nanvar(ahead) + np.nanvar(aside))),
        notes=notes,
        ground=np.where(stands[:, None], ground, np.nan),
    )
    return replace(check, findings=tuple(_findings(check, recording.rate)))


def _turned(plate: ForcePlate, angle: float) -> ForcePlate:
    """A plate in the axes of the planes."""
    corners = None if plate.corners is None else turn(plate.corners, angle)
    return replace(
        plate,
        force=turn(plate.force, angle),
        centre_of_pressure=turn(plate.centre_of_pressure, angle),
        corners=corners,
    )


def _rate_factor(
    inertial: np.ndarray, force: np.ndarray, still: np.ndarray
) -> tuple[float | None, float | None]:
    """Mass on the plates over the declared one, and the stated rate over the true one; None where that is not told.

    Accelerations grow with the square of the rate, forces do not depend on it: force = share × (still + inertial / factor²).
    """
    if np.corrcoef(inertial + still, force)[0, 1] < TELLS_RATE:
        return None, None
    share = force.mean() / still.mean()
    for _ in range(_ROUNDS):
        slope = np.std(force - share * still) / np.std(inertial)
        share = (force.mean() - slope * inertial.mean()) / still.mean()
    return float(share), float(np.sqrt(share / slope))


def _other_rate(factor: float) -> bool:
    return not 1 / OTHER_RATE < factor < OTHER_RATE


def _vertical_acceleration(points: np.ndarray, rate: float) -> np.ndarray:
    return derivative(derivative(points, rate), rate)[:, 2]


def _at_frames(
    lift: AnalysedLift, plates: Sequence[ForcePlate], settings: LiftingSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Force of all plates and its moment about the origin, shape (n, 6), and their common centre of pressure at the frames."""
    time = lift.recording.time
    total = np.zeros((len(time), 9))
    for plate in plates:
        centre = np.nan_to_num(plate.centre_of_pressure)
        moment = np.cross(centre, plate.force)
        moment[:, 2] += np.nan_to_num(plate.free_moment)
        columns = np.hstack([plate.force, moment, centre * plate.force[:, 2:]])
        columns = low_pass(columns, plate.rate, settings.filter.cutoff_Hz, settings.filter.order)
        total += np.transpose([_sampled(time, plate, column) for column in columns.T])
    force = total[:, 2:3]
    with np.errstate(divide="ignore", invalid="ignore"):
        return total[:, :6], np.where(force > LOADED_N, total[:, 6:] / force, np.nan)


def _sampled(time: np.ndarray, plate: ForcePlate, values: np.ndarray) -> np.ndarray:
    """Values of a plate at other instants; NaN where it did not measure."""
    early, late = plate.time[0] - 0.5 / plate.rate, plate.time[-1] + 0.5 / plate.rate
    return np.where((time >= early) & (time <= late), np.interp(time, plate.time, values), np.nan)


def _on_plates(lift: AnalysedLift, plates: Sequence[ForcePlate]) -> np.ndarray:
    """Whether both ankles are above the plates, shape (n,); true where a file states no corners."""
    recording = lift.recording
    if any(plate.corners is None for plate in plates):
        return np.ones(len(recording), dtype=bool)
    return np.all(
        [
            np.any([_above(recording[name], plate.corners) for plate in plates], axis=0)
            for name in ("L_ANKLE", "R_ANKLE")
        ],
        axis=0,
    )


def _above(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    low, high = corners[:, :2].min(axis=0) - BESIDE_M, corners[:, :2].max(axis=0) + BESIDE_M
    return np.all((points[:, :2] >= low) & (points[:, :2] <= high), axis=1)


def _findings(check: PlateCheck, rate_Hz: float) -> Iterator[str]:
    """What does not fit, with what that means."""
    ratio = check.plates_kg / check.declared_kg
    if abs(ratio - 1) > MASS_TOLERANCE:
        both = ((item, text) for factor, text in _FACTORS.items() for item in (factor, 1 / factor))
        known = (text for factor, text in both if abs(ratio / factor - 1) < 0.05)
        yield _SAID["weight"].format(check=check, meaning=next(known, _SAID["weight_unknown"]))
    if check.correlation is not None and check.correlation < FOLLOWS:
        yield _SAID["other_trial"].format(check=check)
    factor = check.rate_factor
    if factor is not None and _other_rate(factor):
        times = f"{max(factor, 1 / factor) ** 2:.2g} times too {'large' if factor > 1 else 'small'}"
        yield _SAID["other_rate"].format(rate_Hz=rate_Hz, times=times, told_Hz=rate_Hz / factor)
    distance = float(np.hypot(check.forward_mm, check.right_mm))
    if distance > OFF_MM:
        yield _SAID["elsewhere" if distance > ELSEWHERE_MM else "beside"].format(distance=distance)
