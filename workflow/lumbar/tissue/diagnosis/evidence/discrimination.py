"""The excitation that tells tied models apart.

Two models are told apart by a record if neither can be refitted to what the other would have answered: the distance is the
size of what one leaves of the other's force, in noise standard deviations, √Σ(F_A − F_B)²/σ, the smaller of both directions. It
is the number of standard deviations by which the statistic of the likelihood-ratio test would be moved (design for model
discrimination: Atkinson and Fedorov, Biometrika 62 (1975) 57-70, T-optimality). Excitations are ranked by the root mean square
of the difference instead, which does not reward mere length: a small difference drowns in what neither model has.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.joint_fit import fit as refit
from lumbar.tissue.diagnosis.fitting.uncertainty import project_out, tangent_basis
from lumbar.tissue.diagnosis.selection.candidate import Candidate
from lumbar.tissue.diagnosis.selection.result import DiagnosisResult
from lumbar.tissue.diagnosis.selection.sentences import effects_text
from lumbar.tissue.diagnosis.selection.thresholds import TIED
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.signals.spectrum import Kinematics, occupied_band, peak_kinematics

_LONGEST, _ENOUGH = 0.3, 3000
"""Share of the training record's samples, and samples, up to the larger of which an excitation lasts unless it repeats the
record."""
_SHARES = (0.25, 1.0, 1.5)
"""Amplitudes tried, as shares of the training record's half range."""
_ONSET = 10.0
"""Times in which the machine turns, over which motion sets in after rest."""
REFITTED = 4
"""Number of excitations, the best to first order, that are judged with full refits."""
CLEAR, CLEARER = 6.0, 2.0
"""Noise standard deviations, and times those of the record that left the tie, that are enough: an excitation beyond both is
preferred within the range already recorded."""


@dataclass(frozen=True, eq=False)
class ExcitationCandidate:
    """A position signal with the words that describe it."""

    words: str
    """E.g. ``"a triangle of ±8 mm at 2 mm/s for 30 s"``."""
    motion: Motion
    within: bool
    """True if it stays within the positions of the training record, where both models were fitted."""


def excitation_family(reference: Motion, unit: str, limits: Kinematics | None) -> list[ExcitationCandidate]:
    """Excitations of many kinds around a record's own motion, all within the limits.

    Multisines of several bands, amplitudes and offsets, sines, triangles at several rates, ramp and hold, repeated strokes,
    rest before motion, and the record repeated for longer.

    Parameters
    ----------
    reference : Motion
        Of the training record: its range, band and rate.
    unit : str
        Of the position.
    limits : Kinematics or None
        Of the machine, in this unit; without them twice the record's own peaks of velocity and acceleration and one and a half
        times its displacement are taken.
    """
    own = peak_kinematics(reference.position, 1 / reference.sampling_time)
    allowed = limits or Kinematics(1.5 * own.displacement, 2 * own.velocity, 2 * own.acceleration)
    found = []
    turning = 2 * allowed.velocity / allowed.acceleration
    slack = 0.01 * np.ptp(reference.position)
    low, high = reference.position.min() - slack, reference.position.max() + slack
    for words, position in _signals(reference, turning, unit):
        peaks = peak_kinematics(position, 1 / reference.sampling_time)
        if all(
            getattr(peaks, name) <= getattr(allowed, name) * (1 + 1e-9) for name in peaks.__dataclass_fields__
        ):
            time = reference.sampling_time * np.arange(len(position))
            within = bool(low <= position.min() and position.max() <= high)
            found.append(ExcitationCandidate(words, Motion(time, position, reference.sampling_time), within))
    return found


def _signals(reference: Motion, rounded: float, unit: str) -> Iterator[tuple[str, np.ndarray]]:
    step = reference.sampling_time
    middle = (reference.position.max() + reference.position.min()) / 2
    half = np.ptp(reference.position) / 2
    samples = min(max(round(_LONGEST * len(reference)), _ENOUGH), len(reference))
    time, duration = step * np.arange(samples), step * samples
    low, high = occupied_band(reference.position, step)
    highest = 0.1 / step
    speed = float(np.sqrt(np.mean(reference.velocity**2)))
    for share in _SHARES:
        size = share * half
        yield from _multisines(time, middle, size, half, min(high, highest), unit)
        yield from _triangles(time, middle, size, speed, rounded, unit)
        for frequency in dict.fromkeys((max(low, 4 / duration), min(high, highest), min(2 * high, highest))):
            yield (
                f"a sine of ±{size:.3g} {unit} at {frequency:.3g} Hz for {duration:.3g} s",
                middle + size * np.sin(2 * np.pi * frequency * time),
            )
        yield from _strokes(time, middle, size, speed, rounded, unit)
    yield from _rest_and_longer(reference, time, _ONSET * rounded, unit)


def _multisines(time, middle, size, half, high, unit) -> Iterator[tuple[str, np.ndarray]]:
    from lumbar.tissue.signals.multisine import schroeder_phases

    period, step = time[-1] / 3, time[1] - time[0]
    samples = round(period / step)
    for top in dict.fromkeys((0.3 * high, high, min(2 * high, 0.1 / step))):
        lines = np.arange(1, int(top * period) + 1)
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
                    f"a multisine ({grid} grid) of ±{size:.3g} {unit}{about} up to {top:.3g} Hz, three periods of {period:.3g} s",
                    middle + offset + wave,
                )


def _triangles(time, middle, size, speed, rounded, unit) -> Iterator[tuple[str, np.ndarray]]:
    for rate in (0.05 * speed, 0.3 * speed, 2 * speed):
        period = 4 * size / rate
        if not 8 * rounded < period < time[-1] / 1.5:
            continue
        phase = (time / period) % 1.0
        wave = size * (1 - 4 * np.abs(((phase + 0.25) % 1.0) - 0.5))
        yield (
            f"a triangle of ±{size:.3g} {unit} at {rate:.3g} {unit}/s for {time[-1]:.3g} s",
            middle + _rounded(wave, time, rounded),
        )


def _strokes(time, middle, size, speed, rounded, unit) -> Iterator[tuple[str, np.ndarray]]:
    rise = max(2 * size / speed, 4 * rounded)
    hold = time[-1] / 5
    if rise < hold:
        levels = [-size, -size, size, size, 0.0, 0.0, -size]
        at = np.cumsum([0.0, 0.5 * hold, rise, hold, rise, hold, rise])
        yield (
            f"ramp and hold: {2 * size:.3g} {unit} in {rise:.2g} s, held for {hold:.3g} s, half of it back, held, back",
            middle + _rounded(np.interp(time, at, levels), time, rounded),
        )
    for count in (6, 20):
        length = time[-1] / (1.3 * count)
        wave = -size * np.cos(2 * np.pi * np.minimum(time, count * length) / length)
        yield (
            f"{count} equal strokes of {2 * size:.3g} {unit}, {length:.2g} s each, then rest",
            middle + wave,
        )


def _rest_and_longer(
    reference: Motion, time: np.ndarray, onset: float, unit: str
) -> Iterator[tuple[str, np.ndarray]]:
    position = reference.position
    half = len(time) // 2
    moved = position[: len(time) - half] - position[0]
    moved *= 0.5 - 0.5 * np.cos(np.pi * np.minimum(time[: len(moved)] / onset, 1.0))
    yield (
        f"rest for {time[half]:.3g} s, then the beginning of your record",
        position[0] + np.concatenate([np.zeros(half), moved]),
    )
    if abs(position[-1] - position[0]) < 0.05 * np.ptp(position):
        yield (
            f"your record three times in a row without a pause, {3 * len(reference) * reference.sampling_time:.3g} s",
            np.tile(position, 3),
        )


def _rounded(wave: np.ndarray, time: np.ndarray, over: float) -> np.ndarray:
    """Corners rounded by a Hann window."""
    width = max(round(over / (time[1] - time[0])), 1)
    window = np.hanning(2 * width + 3)[1:-1]
    padded = np.pad(wave, len(window) // 2, mode="edge")
    return np.convolve(padded, window / window.sum(), mode="valid")


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
    """Noise standard deviations by which it would separate the closest pair of selected and tied candidates."""
    rms: float
    """Root mean square of that pair's difference, in the output's unit."""
    recorded: float
    """Distance on the training record."""
    closest: tuple[str, ...]
    """Effects of the selected candidate's closest rival under this excitation."""
    tried: int
    """Number of excitations tried."""

    @property
    def separates(self) -> bool:
        """True if the tie would be broken: the likelihoods then differ by more than `TIED`."""
        return self.distance**2 > TIED

    @property
    def improves(self) -> bool:
        """True if it separates better than the training record."""
        return self.distance > self.recorded

    def to_json(self) -> dict:
        """Return the entry ``separating_excitation`` of ``diagnosis.json``."""
        return {
            "description": self.excitation.words,
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

    None without a tie, or if a candidate needs other channels than the input: an excitation does not define them.

    Every excitation is judged to first order (the difference beyond the other model's tangent space), the best few with both
    models refitted in turn.

    `limits` are the machine's, in the input's unit: see `excitation_family`.
    """
    candidates = [diagnosis.model, *diagnosis.tied_with]
    further = any(form.channels for item in candidates for form in item.fit.structure.forms)
    if not diagnosis.tied_with or further:
        return None
    experiment, noise = diagnosis.experiment, diagnosis.noise_rms
    training = experiment.training
    family = excitation_family(training.motion, experiment.input_unit, limits)
    rivals = diagnosis.tied_with
    model = diagnosis.model.fit

    def first_order(item: ExcitationCandidate) -> _Left:
        """Return the smallest difference of two models beyond the tangent space of one of them."""
        data = FitData(item.words, item.motion, np.zeros(len(item.motion)), training.whitening)
        left = []
        for rival in rivals:
            difference = data.whiten(model.simulate(data.motion) - rival.fit.simulate(data.motion))
            for fit in (model, rival.fit):
                rest = project_out(tangent_basis(fit, [data]), difference)
                left.append(_Left.of(float(rest @ rest), data.size))
        return min(left)

    ranked = sorted(((first_order(item), item) for item in family), key=lambda pair: -pair[0].rms)
    own = ExcitationCandidate(training.name, training.motion, True)
    recorded = _judged(model, rivals, own, training.whitening)[0].distance(noise)
    inside = [pair for pair in ranked if pair[1].within]
    enough = inside and inside[0][0].distance(noise) > max(CLEAR, CLEARER * recorded)
    chosen = [item for _, item in (inside if enough else ranked)[:REFITTED]]
    found = [(*_judged(model, rivals, item, training.whitening), item) for item in chosen]
    left, closest, excitation = max(found, key=lambda item: item[0].rms)
    return Separation(excitation, left.distance(noise), left.rms, recorded, closest, len(family))


@dataclass(frozen=True, order=True)
class _Left:
    """Error of the best approximation by another model: RMS (by which it is ordered) and sum of squares."""

    rms: float
    sum_of_squares: float

    @classmethod
    def of(cls, squared: float, size: int) -> Self:
        return cls(float(np.sqrt(squared / size)), float(squared))

    def distance(self, noise: float) -> float:
        return float(np.sqrt(self.sum_of_squares) / noise)


def _judged(model: Fit, rivals: list[Candidate], excitation: ExcitationCandidate, whitening: np.ndarray):
    """Return what full refits leave of the closest rival's noise-free force, or it of the model's, and that rival's effects."""
    judged = []
    for rival in rivals:
        for truth, other in ((model, rival.fit), (rival.fit, model)):
            force = truth.simulate(excitation.motion)
            data = FitData(excitation.words, excitation.motion, force, whitening)
            fitted = refit(other.structure, data, other.nonlinear)
            unfitted = data.whiten(other.simulate(excitation.motion) - force)
            left = _Left.of(min(fitted.squared_error, float(unfitted @ unfitted)), data.size)
            judged.append((left, rival.effects))
    return min(judged, key=lambda item: item[0])


def separation_sentence(separation: Separation, diagnosis: DiagnosisResult) -> str:
    """Propose the excitation, or say that none of those tried helps."""
    unit = diagnosis.experiment.output_unit
    pair = f"{effects_text(diagnosis.selected)} from {effects_text(separation.closest)}"
    excitation, distance = separation.excitation.words, separation.distance
    if not separation.separates:
        return (
            f"None of {separation.tried} excitations tried within the machine's limits would distinguish {pair}: the best, "
            f"{excitation}, separates them by only {distance:.2g} noise standard deviations."
        )
    if not separation.improves:
        return (
            f"The existing records separate {pair} better ({separation.recorded:.2g} noise standard deviations) than any of "
            f"{separation.tried} excitations tried within the machine's limits ({distance:.2g}). No further record of these "
            "kinds is proposed."
        )
    proposal = (
        f"To distinguish {pair}, record {excitation} and fit on it: it would separate them by {distance:.2g} noise standard "
        f"deviations ({separation.rms:.2g} {unit} RMS); your record {diagnosis.experiment.training.name}: "
        f"{separation.recorded:.2g}."
    )
    outside = " It leaves the range of your record: both models are extrapolated there."
    return proposal if separation.excitation.within else proposal + outside
