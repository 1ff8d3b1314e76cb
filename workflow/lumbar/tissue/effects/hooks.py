"""Code for mechanisms that no equation expresses; only YAML files of the catalogue can name it, not files of users.

Closed forms of states, hand-written simulation and C code, starting values of a search, contradictions of record and effect.
"""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from lumbar.base.yaml_file import shipped_yaml
from lumbar.tissue.models.bases import elongation
from lumbar.tissue.models.equation import CStep
from lumbar.tissue.models.form import HandWritten
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.operators import (
    bouc_wen,
    bouc_wen_general,
    elastoplastic,
    play,
    presliding,
    relaxation,
)

_MAX_EDGES = 160  # instants that are tried as ends of an interval
_MAX_LINES = 3  # strongest frequencies that are tried
_MAX_MODULATION_HZ = 4.0  # people move no faster
_C_STEPS: dict[str, str] = shipped_yaml(Path(__file__).with_name("c_steps.yaml"))
_BRANCHES = 6  # of a relaxation spectrum; each is four times as fast as the one before

_IWAN_ELEMENTS = 4  # Jenkins elements; each slides at half the distance of the one before
_IWAN_STEP = "\n".join(
    f"next[{order}] = behind_gap(memory[{order}], position, largest_distance / {2**order}, first);"
    for order in range(_IWAN_ELEMENTS)
)
_IWAN_FORCE = " + ".join(
    f"friction_limit_{order} * ((position - next[{order}]) / (largest_distance / {2**order}))"
    for order in range(_IWAN_ELEMENTS)
)


def strongest_lines(motion: Motion, residual: np.ndarray) -> list[np.ndarray]:
    """Return the frequencies (Hz) of the strongest lines of the residual, strongest first.

    Trends (below 1.5 cycles per record) are omitted. Lines near strong lines of the input count less, because the error of a
    model repeats with a periodic input.
    """
    frequency, power = _periodogram(residual, motion.sampling_time)
    _, excitation = _periodogram(motion.position, motion.sampling_time)
    resolution = 1.0 / (len(residual) * motion.sampling_time)
    power[frequency < 1.5 * resolution] = 0.0
    peaks = _peaks(power)
    if not len(peaks):
        return [np.array([2 * resolution])]
    weight = power[peaks] / (1e-3 * excitation.max() + excitation[peaks])
    best = [*peaks[np.argsort(-weight)[:_MAX_LINES]], *peaks[np.argsort(-power[peaks])[:1]]]
    return [np.array([frequency[peak]]) for peak in dict.fromkeys(best)]


def _peaks(power: np.ndarray) -> np.ndarray:
    """Return the indices of local maxima."""
    return np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])) + 1


def _periodogram(signal: np.ndarray, sampling_time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the frequencies (Hz) and the power of a signal about its mean, with a Hann window and zero-padding."""
    padded = 8 * len(signal)
    power = np.abs(np.fft.rfft((signal - signal.mean()) * np.hanning(len(signal)), padded)) ** 2
    return np.fft.rfftfreq(padded, sampling_time), power


def interval_starts(motion: Motion, residual: np.ndarray, carriers: list[np.ndarray]) -> list[np.ndarray]:
    """Return start and stop (s) of the interval in which two carriers explain most of the residual, jointly with the base.

    The base of Eq. 4.1 is refitted for every interval: sums over an interval are differences of cumulative sums. The list
    contains only this pair; residual and both carriers have shape (samples,).
    """
    base = np.stack([motion.acceleration, motion.velocity, np.sin(motion.position)])
    carrier = np.stack(carriers)
    edges = np.linspace(0, len(motion), min(_MAX_EDGES, len(motion) // 4) + 1).astype(int)
    first, last = np.triu_indices(len(edges), k=2)

    def interval_sums(values: np.ndarray) -> np.ndarray:
        total = np.concatenate([np.zeros((*values.shape[:-1], 1)), np.cumsum(values, axis=-1)], axis=-1)
        total = total[..., edges]
        return total[..., last] - total[..., first]

    cross = interval_sums(base[:, None] * carrier)
    inverse = np.linalg.pinv(base @ base.T, hermitian=True)
    square = interval_sums(carrier[:, None] * carrier) - np.einsum("abn,ac,cdn->bdn", cross, inverse, cross)
    right = interval_sums(carrier * residual) - np.einsum("abn,ac,c->bn", cross, inverse, base @ residual)
    determinant = square[0, 0] * square[1, 1] - square[0, 1] ** 2
    gain = (
        square[1, 1] * right[0] ** 2 - 2 * square[0, 1] * right[0] * right[1] + square[0, 0] * right[1] ** 2
    )
    # For an interval of nearly the whole record the carriers do not differ from the base.
    is_regular = determinant > 1e-6 * square[0, 0] * square[1, 1]
    best = int(np.where(is_regular, gain / np.where(is_regular, determinant, 1.0), 0.0).argmax())
    return [np.maximum(edges[[first[best], last[best]]] * motion.sampling_time, motion.sampling_time)]


def modulation_starts(motion: Motion, residual: np.ndarray, carriers: list[np.ndarray]) -> list[np.ndarray]:
    """Return the frequencies (Hz) at which the residual contains a modulated carrier, strongest first.

    Peaks of the spectrum of residual times carrier; a modulation of fewer than 1.5 cycles per record is not an oscillation.
    """
    lowest = 1.5 / (len(residual) * motion.sampling_time)
    frequencies = []
    for carrier in carriers:
        frequency, power = _periodogram(residual * carrier, motion.sampling_time)
        peaks = _peaks(power)
        peaks = peaks[(frequency[peaks] >= lowest) & (frequency[peaks] <= _MAX_MODULATION_HZ)]
        frequencies += list(frequency[peaks[np.argsort(-power[peaks])[:_MAX_LINES]]])
    return [np.array([value]) for value in dict.fromkeys(frequencies)] or [np.array([2 * lowest])]


_MAX_SHARE_BEYOND = 0.01  # of the samples that are beyond a limit
_MIN_CYCLES, _CERTAIN_CYCLES = 2.0, 5.0
"""Smallest number of cycles of a disturbance (below it, it is a drift), and number below which its line must be visible."""
_MIN_LINE_POWER = 30.0
"""Smallest power of a visible line, relative to the level of a wandering zero at its frequency."""
_EXCLUDED_LINES = 2.5
"""Lines (1/duration) excluded from the level on both sides of a line; Hann's window spreads a line over fewer."""
_MIN_LINES_APART = 0.5  # lines (1/duration) from a disturbance to the excitation's nearest line


def _describe_excess(values, force: np.ndarray, noise: float, phrase: str) -> str:
    """Return a sentence on the share of the samples beyond a fitted limit, or an empty text if the share is small."""
    share = float(np.mean(force > 1.02 * values["limit"] + 3 * noise))
    return f"{100 * share:.1f} % of the samples {phrase} its limit" if share > _MAX_SHARE_BEYOND else ""


def _is_line_visible(motion: Motion, force: np.ndarray, at: float) -> bool:
    """Return whether a force has a spectral line at a frequency that neither a linear tissue nor a wandering zero explains."""
    columns = [np.ones(len(motion)), motion.position, motion.velocity]
    columns += [relaxation(motion, share * motion.scale("time")) for share in (0.1, 1.0, 10.0)]
    known = np.column_stack(columns)
    residual = force - known @ np.linalg.lstsq(known, force, rcond=1e-10)[0]
    frequency, power = _periodogram(residual, motion.sampling_time)
    lines = (frequency - at) * motion.time[-1]
    around = (np.abs(lines) > _EXCLUDED_LINES) & (frequency > 0) & (frequency < 4 * at)
    # A random walk's power falls with the square of the frequency.
    level = np.median(power[around] * (frequency[around] / at) ** 2)
    return bool(power[np.argmin(np.abs(lines))] > _MIN_LINE_POWER * level)


def _refute_disturbance(values, motion, force, noise, period) -> str:
    """Return the reason to reject a disturbance: few cycles (a drift) or repetition with the excitation; empty if accepted."""
    frequency, duration = values["frequency"], float(motion.time[-1])
    cycles = frequency * duration
    if cycles < _MIN_CYCLES or (cycles < _CERTAIN_CYCLES and not _is_line_visible(motion, force, frequency)):
        return f"its record holds {cycles:.1f} cycles of it"
    if period and abs(frequency * period - round(frequency * period)) < _MIN_LINES_APART * period / duration:
        return "it repeats with the excitation"
    return ""


HOOKS: Mapping[str, Mapping[str, Any]] = {
    "solution": {  # states in closed form, and in C if the solver's step is less exact
        "maxwell_branch": (elongation, ""),
        "spectrum": (
            lambda motion, nonlinear: tuple(
                relaxation(motion, nonlinear[0] / 4**n) for n in range(_BRANCHES)
            ),
            "",
        ),
        "dahl": (lambda motion, nonlinear: (presliding(motion, nonlinear[0]),), ""),
        "bouc_wen": (lambda motion, nonlinear: (bouc_wen(motion, nonlinear[0]),), _C_STEPS["bouc_wen"]),
        "bouc_wen_general": (
            lambda motion, nonlinear: (bouc_wen_general(motion, *nonlinear),),
            _C_STEPS["bouc_wen_general"],
        ),
    },
    "by_hand": {
        "elastoplastic": HandWritten(
            columns=lambda motion, nonlinear: [elastoplastic(motion, nonlinear[0])],
            c_step=CStep(
                "friction_limit * ((position - next[0]) / presliding_distance)",
                "next[0] = behind_gap(memory[0], position, presliding_distance, first);  // the slider",
                memory=1,
            ),
        ),
        "iwan": HandWritten(
            columns=lambda motion, nonlinear: [
                elastoplastic(motion, nonlinear[0] / 2**order) for order in range(_IWAN_ELEMENTS)
            ],
            c_step=CStep(_IWAN_FORCE, _IWAN_STEP, memory=_IWAN_ELEMENTS),
        ),
        "play": HandWritten(
            input_transform=lambda motion, nonlinear: motion.through(partial(play, gap=nonlinear[0])),
            c_step=CStep("next[0]", "next[0] = behind_gap(memory[0], position, half_gap, first);", memory=1),
        ),
        "delay": HandWritten(
            input_transform=lambda motion, nonlinear: motion.delayed(nonlinear[0]),
            spatial=True,
            c_step=CStep(
                "newer + share * (older - newer)",
                "double newer = earlier(now, ring, (int)whole), older = earlier(now, ring, (int)whole + 1);",
                # whole samples, and the share of one that is left over
                constants=lambda parameters, sampling_time: dict(
                    zip(("whole", "share"), divmod(parameters["delay"] / sampling_time, 1.0), strict=True)
                ),
                history=lambda numbers: int(numbers["whole"]) + 1,
            ),
        ),
    },
    "starts": {
        "strongest_lines": strongest_lines,
        "grasp_and_release": lambda motion, residual: [
            np.array([distance, *times])
            for times in interval_starts(motion, residual, [motion.acceleration, np.sin(motion.position)])
            for distance in (0.25, 0.75)
        ],
        "oscillating_length": lambda motion, residual: modulation_starts(
            motion, residual, [np.sin(motion.position), motion.acceleration]
        ),
        "swaying_pivot": lambda motion, residual: modulation_starts(
            motion, residual, [np.cos(motion.position)]
        ),
        "heaving_pivot": lambda motion, residual: modulation_starts(
            motion, residual, [np.sin(motion.position)]
        ),
    },
    "contradiction": {
        "above_limit": lambda values, motion, force, noise, period: _describe_excess(
            values, np.abs(force), noise, "lie above"
        ),
        "below_adhesion": lambda values, motion, force, noise, period: _describe_excess(
            values, -force, noise, "pull more than"
        ),
        "no_disturbance": _refute_disturbance,
    },
}
"""Code by key of a form in YAML, then by name."""
