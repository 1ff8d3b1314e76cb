"""The excitation that distinguishes tied models.

A record distinguishes two models if neither can be refitted to the force that the other predicts. The distance of two models is
the error that a refit of one leaves of the force of the other, √Σ(F_A − F_B)²/σ in noise standard deviations; the smaller value
counts. It is the shift of the likelihood-ratio statistic in standard deviations (T-optimality: Atkinson and Fedorov, Biometrika
62 (1975) 57-70). Excitations are ranked by the root mean square of the difference, because the distance grows with the length.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass

import numpy as np

from lumbar.base.formats import format_number
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import fit as refit
from lumbar.tissue.diagnosis.fitting.uncertainty import project_out, tangent_basis
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisResult
from lumbar.tissue.diagnosis.selection.sentences import effects_text
from lumbar.tissue.diagnosis.selection.thresholds import TIED
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.signals.spectrum import Kinematics, occupied_band, peak_kinematics

_MAX_LENGTH_SHARE, _MAX_SAMPLES = 0.3, 3000
"""Longest excitation that does not repeat the training record: the larger of a share of the record and a number of samples."""
_SHARES = (0.25, 1.0, 1.5)
"""Amplitudes tried, as shares of the training record's half range."""
_ONSET = 10.0
"""Time over which motion sets in after rest, in turning times of the machine."""
REFITTED = 4
"""Number of excitations that are judged with full refits: the best to first order."""
CLEAR, CLEARER = 6.0, 2.0
"""Distance that is enough, in noise standard deviations and in distances on the training record: an excitation above both is
preferred if it stays within the range already recorded."""


@dataclass(frozen=True, eq=False)
class ExcitationCandidate:
    """A position signal with its description."""

    description: str
    """Description for the reader, e.g. ``"a triangle of ±8 mm at 2 mm/s for 30 s"``."""
    motion: Motion
    is_within: bool
    """True if the signal stays within the positions of the training record, to which both models were fitted."""


def excitation_family(reference: Motion, unit: str, limits: Kinematics | None) -> list[ExcitationCandidate]:
    """Return excitations of many kinds around a record's own motion, all within the limits.

    Multisines of several bands, amplitudes and offsets, sines, triangles at several rates, ramp and hold, repeated strokes,
    rest before motion, and the record repeated for longer.

    Parameters
    ----------
    reference : Motion
        Motion of the training record; it gives range, band and rate.
    unit : str
        Unit of the position.
    limits : Kinematics or None
        Limits of the machine, in `unit`; default twice the record's peak speed and acceleration, and 1.5 times its displacement.

    Returns
    -------
    list of ExcitationCandidate
    """
    peaks = peak_kinematics(reference.position, 1 / reference.sampling_time)
    allowed = limits or Kinematics(1.5 * peaks.displacement, 2 * peaks.velocity, 2 * peaks.acceleration)
    family = []
    turning = 2 * allowed.velocity / allowed.acceleration
    slack = 0.01 * np.ptp(reference.position)
    low, high = reference.position.min() - slack, reference.position.max() + slack
    for description, position in _signals(reference, turning, unit):
        commanded = asdict(peak_kinematics(position, 1 / reference.sampling_time))
        if all(value <= getattr(allowed, name) * (1 + 1e-9) for name, value in commanded.items()):
            time = reference.sampling_time * np.arange(len(position))
            is_within = bool(low <= position.min() and position.max() <= high)
            motion = Motion(time, position, reference.sampling_time)
            family.append(ExcitationCandidate(description, motion, is_within))
    return family


def _signals(reference: Motion, turning: float, unit: str) -> Iterator[tuple[str, np.ndarray]]:
    """Yield descriptions and positions; `turning` is the time (s) in which the machine turns."""
    step, position = reference.sampling_time, reference.position
    middle, half = (position.max() + position.min()) / 2, np.ptp(position) / 2
    count = min(max(round(_MAX_LENGTH_SHARE * len(reference)), _MAX_SAMPLES), len(reference))
    time, duration = step * np.arange(count), step * count
    low, high = occupied_band(position, step)
    highest = 0.1 / step
    speed = float(np.sqrt(np.mean(reference.velocity**2)))

    def round_corners(wave: np.ndarray) -> np.ndarray:
        width = max(round(turning / (time[1] - time[0])), 1)
        window = np.hanning(2 * width + 3)[1:-1]
        padded = np.pad(wave, len(window) // 2, mode="edge")
        return np.convolve(padded, window / window.sum(), mode="valid")

    for size in (share * half for share in _SHARES):
        top = min(high, highest)
        yield from _multisines(time, middle, size, half, top, unit)
        for rate in (0.05 * speed, 0.3 * speed, 2 * speed):
            cycle = 4 * size / rate
            if 8 * turning < cycle < time[-1] / 1.5:
                wave = size * (1 - 4 * np.abs((((time / cycle) % 1.0 + 0.25) % 1.0) - 0.5))
                yield (
                    f"a triangle of ±{size:.3g} {unit} at {rate:.3g} {unit}/s for {time[-1]:.3g} s",
                    middle + round_corners(wave),
                )
        for frequency in dict.fromkeys((max(low, 4 / duration), top, min(2 * high, highest))):
            yield (
                f"a sine of ±{size:.3g} {unit} at {frequency:.3g} Hz for {duration:.3g} s",
                middle + size * np.sin(2 * np.pi * frequency * time),
            )
        rise, hold = max(2 * size / speed, 4 * turning), time[-1] / 5
        if rise < hold:
            levels = [-size, -size, size, size, 0.0, 0.0, -size]
            at = np.cumsum([0.0, 0.5 * hold, rise, hold, rise, hold, rise])
            yield (
                f"ramp and hold: {2 * size:.3g} {unit} in {rise:.2g} s, held for {hold:.3g} s, half of it back, held, back",
                middle + round_corners(np.interp(time, at, levels)),
            )
        for strokes in (6, 20):
            length = time[-1] / (1.3 * strokes)
            wave = -size * np.cos(2 * np.pi * np.minimum(time, strokes * length) / length)
            yield (
                f"{strokes} equal strokes of {2 * size:.3g} {unit}, {length:.2g} s each, then rest",
                middle + wave,
            )
    rest = len(time) // 2
    moved = position[: len(time) - rest] - position[0]
    moved *= 0.5 - 0.5 * np.cos(np.pi * np.minimum(time[: len(moved)] / (_ONSET * turning), 1.0))
    yield (
        f"rest for {time[rest]:.3g} s, then the beginning of your record",
        position[0] + np.concatenate([np.zeros(rest), moved]),
    )
    if abs(position[-1] - position[0]) < 0.05 * np.ptp(position):
        yield (
            f"your record three times in a row without a pause, {3 * len(reference) * step:.3g} s",
            np.tile(position, 3),
        )


def _multisines(
    time: np.ndarray, middle: float, size: float, half: float, top: float, unit: str
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield three periods of multisines, on full and odd grids."""
    from lumbar.tissue.signals.multisine import schroeder_phases

    period = time[-1] / 3
    samples = round(period / (time[1] - time[0]))
    for edge in dict.fromkeys((0.3 * top, top, min(2 * top, 0.1 / (time[1] - time[0])))):
        lines = np.arange(1, int(edge * period) + 1)
        if len(lines) < 3:
            continue
        for grid, chosen in (("full", lines), ("odd", lines[::2])):
            phases = schroeder_phases(np.ones(len(chosen)))
            angle = 2 * np.pi * np.outer(np.arange(samples) / samples, chosen) + phases
            wave = np.tile(np.cos(angle).sum(axis=1), 3)
            wave *= size / np.abs(wave).max()
            for offset in (0.0, 0.5 * half, -0.5 * half) if grid == "full" else (0.0,):
                about = f" about {middle + offset:.3g} {unit}" if offset else ""
                yield (
                    f"a multisine ({grid} grid) of ±{size:.3g} {unit}{about} up to {edge:.3g} Hz, three periods of "
                    f"{period:.3g} s",
                    middle + offset + wave,
                )


def motion_csv(motion: Motion, unit: str) -> str:
    """Return a motion as a file to play, with the header ``time_s,position_<unit>``."""
    rows = zip(motion.time, motion.position, strict=True)
    return "\n".join(
        [f"time_s,position_{unit}", *(f"{time:.6g},{position:.6g}" for time, position in rows), ""]
    )


@dataclass(frozen=True, eq=False)
class Separation:
    """The excitation that separates tied candidates best."""

    excitation: ExcitationCandidate
    distance: float
    """Distance under this excitation of the closest pair of selected and tied candidates, in noise standard deviations."""
    rms: float
    """Root mean square of the difference of the closest pair, in the output's unit."""
    recorded: float
    """Distance of the closest pair on the training record, in noise standard deviations."""
    closest: tuple[str, ...]
    """Effects of the selected candidate's closest rival under this excitation."""
    tried: int
    """Number of excitations tried."""

    @property
    def separates(self) -> bool:
        """True if the excitation would break the tie: the likelihoods then differ by more than `TIED`."""
        return self.distance**2 > TIED

    @property
    def improves(self) -> bool:
        """True if the excitation separates the candidates better than the training record does."""
        return self.distance > self.recorded

    def to_json(self) -> dict:
        """Return the entry ``separating_excitation`` of ``diagnosis.json``."""
        return {
            "description": self.excitation.description,
            "duration_s": self.excitation.motion.sampling_time * len(self.excitation.motion),
            "noise_standard_deviations": self.distance,
            "noise_standard_deviations_recorded": self.recorded,
            "difference_rms": self.rms,
            "closest": list(self.closest),
            "separates": self.separates,
            "improves": self.improves,
            "tried": self.tried,
        }


def separating_excitation(diagnosis: DiagnosisResult, limits: Kinematics | None = None) -> Separation | None:
    """Search the excitation under which the selected and the tied candidates differ most.

    Return None without a tie, or if a candidate needs channels in addition to the input: an excitation does not define them.

    Every excitation is judged to first order (the difference beyond the other model's tangent space), the best few with both
    models refitted in turn. `limits` are the limits of the machine in the input's unit, as in `excitation_family`.
    """
    rivals, model = diagnosis.tied_with, diagnosis.model.fit
    forms = [form for item in (diagnosis.model, *rivals) for form in item.fit.structure.forms]
    if not rivals or any(form.channels for form in forms):
        return None
    experiment, noise = diagnosis.experiment, diagnosis.noise_rms
    training = experiment.training
    family = excitation_family(training.motion, experiment.input_unit, limits)

    def first_order(item: ExcitationCandidate) -> tuple[float, float]:
        """Return RMS and sum of squares of the smallest difference of two models beyond the tangent space of one of them."""
        data = FitData(item.description, item.motion, np.zeros(len(item.motion)), training.whitening)
        left = []
        for rival in rivals:
            difference = data.whiten(model.simulate(data.motion) - rival.fit.simulate(data.motion))
            for fit in (model, rival.fit):
                rest = project_out(tangent_basis(fit, [data]), difference)
                squared = float(rest @ rest)
                left.append((float(np.sqrt(squared / data.size)), squared))
        return min(left)

    def refitted(item: ExcitationCandidate) -> tuple[tuple[float, float], tuple[str, ...]]:
        """Return the error that a full refit leaves of the force of the other model without noise, and the closest rival."""
        judged = []
        for rival in rivals:
            for truth, other in ((model, rival.fit), (rival.fit, model)):
                force = truth.simulate(item.motion)
                data = FitData(item.description, item.motion, force, training.whitening)
                unfitted = data.whiten(other.simulate(item.motion) - force)
                fitted = refit(other.structure, data, other.nonlinear).squared_error
                squared = float(min(fitted, float(unfitted @ unfitted)))
                judged.append(((float(np.sqrt(squared / data.size)), squared), rival.effects))
        return min(judged, key=lambda pair: pair[0])

    def distance(squares: float) -> float:
        return float(np.sqrt(squares) / noise)

    ranked = sorted(((first_order(item), item) for item in family), key=lambda pair: -pair[0][0])
    (_, squares), _ = refitted(ExcitationCandidate(training.name, training.motion, True))
    recorded = distance(squares)
    inside = [pair for pair in ranked if pair[1].is_within]
    enough = inside and distance(inside[0][0][1]) > max(CLEAR, CLEARER * recorded)
    judged = [(*refitted(item), item) for _, item in (inside if enough else ranked)[:REFITTED]]
    (rms, squares), closest, excitation = max(judged, key=lambda item: item[0][0])
    return Separation(excitation, distance(squares), rms, recorded, closest, len(family))


def separation_sentence(separation: Separation, diagnosis: DiagnosisResult) -> str:
    """Propose the excitation, or report that no excitation that was tried helps."""
    unit = diagnosis.experiment.output_unit
    pair = f"{effects_text(diagnosis.selected)} from {effects_text(separation.closest)}"
    excitation = separation.excitation.description
    distance, recorded = (format_number(value, 2) for value in (separation.distance, separation.recorded))
    if not separation.separates:
        return (
            f"None of {separation.tried} excitations tried within the machine's limits would distinguish {pair}: the best, "
            f"{excitation}, separates them by only {distance} noise standard deviations."
        )
    if not separation.improves:
        return (
            f"The existing records separate {pair} better ({recorded} noise standard deviations) than any of "
            f"{separation.tried} excitations tried within the machine's limits ({distance}). No further record of these "
            "kinds is proposed."
        )
    proposal = (
        f"To distinguish {pair}, record {excitation} and fit on it: it would separate them by {distance} noise standard "
        f"deviations ({separation.rms:.2g} {unit} RMS); your record {diagnosis.experiment.training.name}: "
        f"{recorded}."
    )
    outside = " It leaves the range of your record: both models are extrapolated there."
    return proposal if separation.excitation.is_within else proposal + outside
