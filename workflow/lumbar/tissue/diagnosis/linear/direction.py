"""Detection of exchanged input and output and of an inverted sign, by two properties of every tissue.

A tissue only absorbs energy over a record, and its force has at least the detail of its motion. So ∮ output d(input) > 0, and the
input is the smoother channel. If the channels are exchanged, the integral is negative and the output is the smoother channel; if
a sign is inverted, only the integral is negative. A spring absorbs no energy, and a tissue may tear: the work of loading it, from
one reversal of the motion to the next, then decides.
"""

from itertools import chain, combinations, pairwise
from typing import Any

import numpy as np

from lumbar.records.record import Record
from lumbar.records.sampling import runs
from lumbar.settings.layout import ColumnLayout, ColumnSettings
from lumbar.settings.tissue import TissueSettings
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.residuals.motion_diagnostics import reversals
from lumbar.tissue.models.measured_motion import noise_of
from lumbar.tissue.signals.spectrum import spectral_edge

_MIN_SIGMAS = 4.0
"""Smallest difference of an energy from 0, in standard errors."""
_MIN_ENERGY = 0.1
"""Smallest energy, as the correlation of force and speed, that cannot result from a sensor's lag or backlash."""
_MIN_ROUGH, _MAX_SMOOTH, _MAX_ELASTIC = 1.1, 0.95, 0.6
"""Limits of the ratio of the input's detail to the output's: the input is rougher above the first, smoother below the second, and
smoother than with any spring below the third."""
_SIGN_MARGIN = 0.2
"""Additional share of the force that spring, damper and mass must explain if its sign is inverted."""
_LOADING_SHARE = 0.3
"""Smallest part of a motion that loads or unloads the material, as a share of the range."""
_MAX_LOADING_WORK = -0.5
"""Work over all loadings, relative to its size, below which the force opposes the motion."""
_MAX_ONE_WAY_LOADINGS, _MIN_ONE_WAY_SHARE = 2, 0.5
"""Largest number of loadings, and smallest distance of the ends in ranges, of a motion that leads to another place."""
_MAX_LAG_CORRELATION = 0.3
"""Correlation of force and position above which negative energy may result from a lag."""
_MEANS_PER_WINDOW = 32
"""Number of means to which the samples of a long smoothing window are reduced."""
_BLOCKS = 12
_MIN_RESTING_SHARE = 0.5
"""Smallest share of steps of 0 in a zero-order hold."""
_REST_SIGMAS, _REST_SHARE = 5.0, 1e-3
"""Largest change of a channel at rest: in standard deviations of its noise, and as a share of its range, which add up."""
_MIN_HOLD_SAMPLES = 20
"""Smallest number of samples of a rest."""
_MIN_CREEP = 0.01
"""Smallest creep at one constant force, as a share of the position's range."""
_MIN_COMMAND_JUMP = 0.5
"""Smallest jump of a designed command from one sample to the next, as a share of its range; no position jumps so far."""
_MAX_RESPONSE_JUMP = 0.6
"""Largest step of the response to a command that jumps, as a share of the response's range."""
_FORWARD = "improvement: {forward: true}"
"""Line of a study's YAML for records with the force as input."""
_BAND_POWER = 0.95
_SAMPLES_PER_CYCLE = 8


def direction_or_sign(experiment: Experiment, layout: ColumnLayout | None = None) -> Finding | None:
    """Report exchanged input and output or an inverted sign of records of a tissue, if it is significant.

    The finding has the kind ``direction`` or ``sign``; its sentence ends with the lines to put into the study's YAML, in the
    column `layout` of the records, by default that of the project. A pendulum's gravity may have either sign.
    """
    signals = [
        (record.drop_history(record.motion.position), record.drop_history(record.force))
        for record in (*experiment.training.records, *experiment.tests)
        if np.ptp(record.drop_history(record.motion.position)) > 0
    ]
    if all(creeps_at_constant_force(*pair) for pair in signals):
        sentence = (
            "The force seems to drive the test: while it is constant, the position creeps on. Use --forward, or put this into "
            f"the study's YAML:\n{_FORWARD}"
        )
        return Finding("direction", sentence, float(len(signals)), "records")
    measures = [_measure(*pair) for pair in signals]
    columns = (layout or TissueSettings().layout).columns
    position, force = experiment.input_quantity, experiment.output_quantity
    jump, swapped, roughness = (_median(measures, name) for name in ("jump", "swapped_energy", "roughness"))
    reason, value = "", roughness
    if (
        all(
            item["held"]
            and item["jump"] > _MIN_COMMAND_JUMP
            and item["response_jump"] < _MAX_RESPONSE_JUMP * item["jump"]
            for item in measures
        )
        and _standard_errors(measures, "swapped_blocks")
        > -_MIN_SIGMAS  # else the position's tissue absorbs energy
    ):
        value = jump
        reason = (
            f"the {position} jumps between levels, by {100 * jump:.0f} % of its range from one sample to the next, and the "
            f"{force} follows it smoothly: a command moves like this, a position does not"
        )
    elif (
        swapped > _MIN_ENERGY
        and roughness > _MIN_ROUGH
        and _standard_errors(measures, "swapped_blocks") > _MIN_SIGMAS
    ):
        reason = (
            f"the {position} has {roughness:.2g} times the detail of the {force}, and if it were the motion, the material would "
            "give off energy instead of absorbing it (or the output passes a sensor that is slower than the motion)"
        )
    if reason:
        exchanged = columns_yaml(input=columns["output"], output=columns["input"])
        sentence = (
            f"Input and output seem to be exchanged: {reason}. A tissue's input is its motion and its output the force. If the "
            "test was driven by the force (force in, motion out), use --forward, or put this into the study's YAML:\n"
            f"{_FORWARD}\nIf only the columns are exchanged, put this there instead:\n{exchanged}"
        )
        return Finding("direction", sentence, value, "")
    reason, value = _inverted_sign(measures, position, force)
    if not reason:
        return None
    sentence = (
        f"The sign of the {force} seems to be inverted: {reason}. The force is positive along the motion of the tool; if it is "
        f"the force on the tool, put this into the study's YAML:\n{columns_yaml(output=columns['output'].other_sign)}"
    )
    return Finding("sign", sentence, value, "")


def creeps_at_constant_force(position: np.ndarray, force: np.ndarray) -> bool:
    """Return whether the force rests most of the time, and the position creeps on in the direction of its last change."""
    noises, ranges = [noise_of(item) for item in (position, force)], [np.ptp(position), np.ptp(force)]
    limits = [_REST_SIGMAS * noise + _REST_SHARE * size for noise, size in zip(noises, ranges, strict=True)]
    resting = np.concatenate([[False], np.abs(np.diff(force)) <= np.sqrt(2) * limits[1]])
    holds = [item for item in runs(resting) if item.stop - item.start >= _MIN_HOLD_SAMPLES]
    holds = [item for item in holds if np.ptp(force[item]) <= 2 * limits[1]]
    if sum(item.stop - item.start for item in holds) < _MIN_RESTING_SHARE * len(force):
        return False
    creeping = 0
    for before, hold in pairwise(holds):
        first, second, third, fourth = (part.mean() for part in np.array_split(position[hold], 4))
        # Downwards a response is that upwards, inverted.
        sign = np.sign(force[hold].mean() - force[before].mean())
        early, late = sign * (second - first), sign * (fourth - third)
        creeps = early > max(late, 0.0) and sign * (fourth - first) > max(limits[0], _MIN_CREEP * ranges[0])
        creeping += bool(creeps)
    return creeping > 0 and creeping >= _MIN_RESTING_SHARE * (len(holds) - 1)


def inverted_sign_reason(record: Record) -> str:
    """Return the reason to assume an inverted sign of the force in a record of position and force, or an empty text."""
    channels = record.channels["input"], record.channels["output"]
    measures = _measure(*(channel.values for channel in channels))
    return _inverted_sign([measures], *(channel.quantity for channel in channels))[0]


def _inverted_sign(measures: list[dict[str, Any]], position: str, force: str) -> tuple[str, float]:
    """Return the reason and the deciding number if a sign is inverted, else an empty text and 0."""
    energy, roughness, correlation = (
        _median(measures, name) for name in ("energy", "roughness", "correlation")
    )
    is_given = _standard_errors(measures, "blocks") < -_MIN_SIGMAS and energy < -_MIN_ENERGY
    is_detailed = roughness < _MAX_ELASTIC or (roughness < _MAX_SMOOTH and correlation < _MAX_LAG_CORRELATION)
    if is_given and (is_detailed or (roughness < _MIN_ROUGH and correlation < -_MAX_LAG_CORRELATION)):
        reason = "over the records the material gives off energy instead of absorbing it"
        return f"{reason} (correlation of {force} and speed {energy:+.2f})", energy
    opposed = [item["loading_work"] for item in measures if _opposes_motion(item)]
    if len(opposed) > sum(item["loading_work"] > 0 for item in measures):
        reason = f"the {force} falls along the motion, so loading the material by the {position} takes negative work"
        return f"{reason} ({min(opposed):+.2f} of its size)", min(opposed)
    return "", 0.0


def _opposes_motion(item: dict[str, Any]) -> bool:
    """Return whether the material is loaded by negative work, and the force cannot be that of an oscillating mass."""
    is_mass = item["inverted_share"] <= item["passive_share"] + _SIGN_MARGIN
    oscillates = item["loadings"] > _MAX_ONE_WAY_LOADINGS
    return item["loading_work"] < _MAX_LOADING_WORK and not (oscillates and is_mass)


def _loading_work(position: np.ndarray, force: np.ndarray) -> tuple[float, int]:
    """Return the work over all loadings, relative to its size with noise, and the number of loadings.

    The force counts from its value at the beginning of each loading. If the motion leads to another place, the work of the force
    from its zero on must have the same sign, else the result is 0: relaxation while the position drifts loads nothing.
    """
    turns = np.unique([0, *reversals(position, _LOADING_SHARE)[0], len(position) - 1])
    steps, middle, travels = np.diff(position), (force[1:] + force[:-1]) / 2, np.diff(position[turns])
    works = np.add.reduceat(middle * steps, turns[:-1]) - force[turns[:-1]] * travels
    size = np.abs(works).sum() + _MIN_SIGMAS * np.sqrt(np.mean(np.diff(force) ** 2) / 2 * (travels @ travels))
    one_way = len(works) <= _MAX_ONE_WAY_LOADINGS or abs(travels.sum()) > _MIN_ONE_WAY_SHARE * np.ptp(
        position
    )
    is_contradicted = one_way and works.sum() * (middle @ steps) < 0
    return 0.0 if is_contradicted else float(works.sum() / max(size, 1e-300)), len(works)


def _median(measures: list[dict[str, Any]], name: str) -> float:
    return float(np.median([item[name] for item in measures]))


def _standard_errors(measures: list[dict[str, Any]], name: str) -> float:
    """Return the mean energy of the blocks of all records relative to its standard error."""
    energies = np.concatenate([item[name] for item in measures])
    spread = float(np.std(energies, ddof=1)) / np.sqrt(len(energies))
    return float(energies.mean()) / spread if spread > 0 else 0.0


def _measure(position: np.ndarray, force: np.ndarray) -> dict[str, Any]:
    """Return dimensionless measures of the relation of input and output of one record."""
    signals = (position, force)
    jump, response_jump = (float(np.abs(np.diff(signal)).max() / np.ptp(signal)) for signal in signals)
    edges = [spectral_edge(signal - signal.mean(), _BAND_POWER) for signal in signals]
    window = max(round(1 / (_SAMPLES_PER_CYCLE * max(edges))), 1)
    first, second = _smooth(position, window), _smooth(force, window)
    loading_work, loadings = _loading_work(position, force)
    speed, rate = np.gradient(first), np.gradient(second)
    first, second = first - first.mean(), second - second.mean()
    passive, inverted = _passive_shares(second, first, speed)
    return {
        "energy": _correlation(second, speed),
        "swapped_energy": _correlation(first, rate),  # with input and output exchanged
        "blocks": _block_energies(second * speed),
        "swapped_blocks": _block_energies(first * rate),
        "roughness": _detail(first, speed) / _detail(second, rate),
        "correlation": _correlation(first, second),
        "loading_work": loading_work,
        "loadings": loadings,
        "passive_share": passive,  # of the output that a spring, a damper and a mass explain
        "inverted_share": inverted,  # of the inverted output
        "jump": jump,  # largest step of the input as a share of its range
        "response_jump": response_jump,  # largest step of the output
        "held": bool(np.mean(np.diff(position) == 0) > _MIN_RESTING_SHARE),  # the input is a zero-order hold
    }


def _smooth(signal: np.ndarray, window: int) -> np.ndarray:
    """Smooth a signal; if the window is long, replace successive samples by their mean first."""
    length = max(window // _MEANS_PER_WINDOW, 1)
    means = signal[: len(signal) // length * length].reshape(-1, length).mean(axis=1)
    taps = np.hanning(2 * window // length + 1)[1:-1]
    taps = taps[: len(means) // 2]
    return np.convolve(means, taps / taps.sum(), "valid")


def _detail(signal: np.ndarray, rate: np.ndarray) -> float:
    """Return the size of the rate of a signal relative to the size of the signal."""
    return max(float(np.std(rate)), 1e-300) / max(float(np.std(signal)), 1e-300)


def _correlation(one: np.ndarray, other: np.ndarray) -> float:
    size = float(np.sqrt((one @ one) * (other @ other)))
    return float(one @ other) / size if size > 0 else 0.0


def _passive_shares(force: np.ndarray, position: np.ndarray, speed: np.ndarray) -> tuple[float, float]:
    """Return the shares of a force and of the inverted force that a spring, a damper and a mass ≥ 0 explain."""
    # As `scipy.optimize.nnls`, which takes longer to import than the rest of an import of recordings.
    columns = [signal - signal.mean() for signal in (position, speed, np.gradient(speed))]
    columns = np.column_stack([signal / max(float(np.std(signal)), 1e-300) for signal in columns])
    size = float(np.linalg.norm(force))
    if not size > 0:
        return 0.0, 0.0
    products, along = columns.T @ columns, columns.T @ (force / size)
    best = [0.0, 0.0]
    for chosen in chain.from_iterable(combinations(range(3), count) for count in (1, 2, 3)):
        factors = np.linalg.lstsq(products[np.ix_(chosen, chosen)], along[list(chosen)], rcond=None)[0]
        for inverted, sign in enumerate((1, -1)):
            if (sign * factors).min() >= 0:
                best[inverted] = max(best[inverted], float(along[list(chosen)] @ factors))
    return best[0], best[1]


def _block_energies(power: np.ndarray) -> np.ndarray:
    """Return the mean power in each block of a record, relative to its root mean square."""
    size = max(float(np.sqrt(np.mean(power**2))), 1e-300)
    return np.array([block.mean() / size for block in np.array_split(power, _BLOCKS)])


def columns_yaml(**columns: ColumnSettings) -> str:
    """Return the lines of a study's YAML that define columns by role."""
    lines = ["tissue:", "  layout:", "    columns:"]
    for role, column in columns.items():
        entries = [f"column: {_scalar(column.column)}"]
        entries += [f"quantity: {_scalar(column.quantity)}"] * bool(column.quantity)
        entries.append(f"unit: {_scalar(column.unit)}")
        entries += [f"scale: {column.scale!r}"] * (column.scale != 1)
        entries += [f"offset: {column.offset!r}"] * (column.offset != 0)
        lines.append(f"      {role}: {{{', '.join(entries)}}}")
    return "\n".join(lines)


def _scalar(value: str | int) -> str:
    """Write a name for YAML, quoted if it contains more than letters, digits, _, / and ·."""
    plain = isinstance(value, int) or (value[:1].isalpha() and all(c.isalnum() or c in "_/·" for c in value))
    return str(value) if plain else "'" + value.replace("'", "''") + "'"
