"""Whether records have input and output exchanged (force in, motion out) or one sign the other way, by what no tissue can do.

A tissue that is moved only takes energy, over a record, and its force has at least the detail of its motion. So of records
whose roles are right ∮ output d(input) > 0 and the input is the smoother channel; of exchanged ones the integral is negative
and the output is the smoother one; of a wrong sign the integral alone is negative. A spring takes no energy: there the slope of
force over position tells.
"""

from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np

from lumbar.records.record import Record
from lumbar.settings.layout import ColumnLayout, ColumnSettings
from lumbar.settings.tissue import TissueSettings
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.signals.spectrum import spectral_edge

_SURE = 4.0
"""Standard errors by which an energy must differ from 0."""
_LOSS = 0.1
"""Energy, as the correlation of force and speed, that is no longer a sensor's lag or backlash."""
_ROUGHER, _SMOOTHER, _MUCH_SMOOTHER = 1.1, 0.95, 0.6
"""Detail of the input in that of the output from which on it is the rougher or the smoother one, or beyond any spring."""
_BEYOND_MASS = 0.2
"""Share of the force by which spring, damper and mass must explain its opposite better. The force of a mass alone falls where the
position grows, with the correlation −|ẋ|²/(|x||ẍ|)."""
_ALONG = 0.3
"""Correlation of force and position above which energy given may be a lag."""
_PER_WINDOW = 32
"""Means that are left of each smoothing window: what it lets pass needs no more."""
_BLOCKS = 12
_FEWEST_RESTING = 0.5
"""Share of the steps of a command held between jumps in which it rests."""
_BIG_JUMP = 0.5
"""Share of its range by which a designed command jumps from one sample to the next; no position does."""
_FOLLOWS = 0.6
"""Largest step of the output in such a jump, as shares of their ranges, of a response that is moved by it."""
FORWARD = "improvement: {forward: true}"
"""Line of a study's YAML for records that were driven by the force."""
_BAND_POWER = 0.95
_PER_CYCLE = 8


@dataclass(frozen=True)
class _Pair:
    """How input and output of one record lie to each other; all without unit.

    `energy` is the correlation of the output with the input's speed and `swapped_energy` that of the input with the
    output's, `blocks` and `swapped_blocks` these energies in stretches of the record, `roughness` the detail of the
    input in that of the output, `correlation` that of both, `as_counted` and `turned` the share of the output, as it is
    counted and of the other sign, that a spring, a damper and a mass explain, `jump` and `follows` the largest steps of both.
    """

    energy: float
    swapped_energy: float
    blocks: np.ndarray
    swapped_blocks: np.ndarray
    roughness: float
    correlation: float
    as_counted: float
    turned: float
    jump: float
    follows: float
    held: bool


def direction_or_sign(experiment: Experiment, layout: ColumnLayout | None = None) -> Finding | None:
    """Say whether input and output are exchanged or a sign is the other way, where that is sure.

    For tissues: a pendulum's gravity may have either sign.

    The finding is of kind ``direction`` or ``sign``; its sentence ends with the lines to put into the study's YAML, in
    the `layout` that the records were read with, by default the reference's.
    """
    pairs = [
        _pair(record.drop_history(record.motion.position), record.drop_history(record.force))
        for record in (*experiment.training.records, *experiment.tests)
    ]
    layout = layout or TissueSettings().layout
    if all(pair.held and pair.jump > _BIG_JUMP and pair.follows < _FOLLOWS for pair in pairs):
        jump = float(np.median([pair.jump for pair in pairs]))
        reason = (
            f"the {experiment.input_quantity} jumps between levels, by {100 * jump:.0f} % of its range from one sample to the "
            f"next, and the {experiment.output_quantity} follows it smoothly: a command moves like this, a position does not"
        )
        return _exchanged(layout, reason, jump)
    swapped, roughness = (_median(pairs, name) for name in ("swapped_energy", "roughness"))
    surely_taken = _standard_errors([pair.swapped_blocks for pair in pairs]) > _SURE
    if surely_taken and swapped > _LOSS and roughness > _ROUGHER:
        reason = (
            f"the {experiment.input_quantity} has {roughness:.2g} times the detail of the {experiment.output_quantity}, and if "
            "it were the motion, the material would give off energy instead of absorbing it (or the output passes a sensor that "
            "is slower than the motion)"
        )
        return _exchanged(layout, reason, roughness)
    force = experiment.output_quantity
    reason, value = _of_other_sign(pairs, experiment.input_quantity, force)
    if not reason:
        return None
    sentence = (
        f"The sign of the {force} seems to be inverted: {reason}. The force is positive along the motion of the tool; if it is "
        f"the force on the tool, put this into the study's YAML:\n{columns_yaml(output=layout.columns['output'].other_sign)}"
    )
    return Finding("sign", sentence, value, "")


def of_other_sign(record: Record) -> str:
    """Why the force of a record of position and force is surely counted against the motion; empty where it is not."""
    channels = record.channels["input"], record.channels["output"]
    pair = _pair(*(channel.values for channel in channels))
    return _of_other_sign([pair], *(channel.quantity for channel in channels))[0]


def _of_other_sign(pairs: list[_Pair], position: str, force: str) -> tuple[str, float]:
    energy, roughness, correlation, as_counted, turned = (
        _median(pairs, name) for name in ("energy", "roughness", "correlation", "as_counted", "turned")
    )
    surely_given = _standard_errors([pair.blocks for pair in pairs]) < -_SURE
    detailed = roughness < _MUCH_SMOOTHER or (roughness < _SMOOTHER and correlation < _ALONG)
    against = roughness < _ROUGHER and correlation < -_ALONG
    if surely_given and energy < -_LOSS and (detailed or against):
        reason = "over the records the material gives off energy instead of absorbing it"
        return f"{reason} (correlation of {force} and speed {energy:+.2f})", energy
    if correlation < 0 and turned > as_counted + _BEYOND_MASS:
        reason = f"the {force} falls if the {position} grows (correlation {correlation:+.2f})"
        return f"{reason}, and no material at rest pulls away from its rest position", correlation
    return "", 0.0


def _median(pairs: list[_Pair], name: str) -> float:
    return float(np.median([getattr(pair, name) for pair in pairs]))


def _pair(position: np.ndarray, force: np.ndarray) -> _Pair:
    steps = np.abs(np.diff(position))
    jump, follows = (float(np.abs(np.diff(signal)).max() / np.ptp(signal)) for signal in (position, force))
    edges = [spectral_edge(signal - signal.mean(), _BAND_POWER) for signal in (position, force)]
    window = max(round(1 / (_PER_CYCLE * max(edges))), 1)
    first, second = _smooth(position, window), _smooth(force, window)
    speed, rate = np.gradient(first), np.gradient(second)
    first, second = first - first.mean(), second - second.mean()
    as_counted, turned = _resisted(second, first, speed)
    return _Pair(
        energy=_correlation(second, speed),
        swapped_energy=_correlation(first, rate),
        blocks=_in_blocks(second * speed),
        swapped_blocks=_in_blocks(first * rate),
        roughness=_detail(first, speed) / _detail(second, rate),
        correlation=_correlation(first, second),
        as_counted=as_counted,
        turned=turned,
        jump=jump,
        follows=follows,
        held=bool(np.mean(steps == 0) > _FEWEST_RESTING),
    )


def _smooth(signal: np.ndarray, window: int) -> np.ndarray:
    """The signal, smoothed; of a long window first thinned, by means."""
    length = max(window // _PER_WINDOW, 1)
    means = signal[: len(signal) // length * length].reshape(-1, length).mean(axis=1)
    taps = np.hanning(2 * window // length + 1)[1:-1]
    taps = taps[: len(means) // 2]
    return np.convolve(means, taps / taps.sum(), "valid")


def _detail(signal: np.ndarray, rate: np.ndarray) -> float:
    """Size of the rate of a signal over that of the signal."""
    return max(float(np.std(rate)), 1e-300) / max(float(np.std(signal)), 1e-300)


def _correlation(one: np.ndarray, other: np.ndarray) -> float:
    size = float(np.sqrt((one @ one) * (other @ other)))
    return float(one @ other) / size if size > 0 else 0.0


def _resisted(force: np.ndarray, position: np.ndarray, speed: np.ndarray) -> tuple[float, float]:
    """Share of a force, and of it turned, that a spring, a damper and a mass explain, none negative: the best combination's.

    As `scipy.optimize.nnls` would, whose import takes longer than the rest of an import of recordings.
    """
    columns = [signal - signal.mean() for signal in (position, speed, np.gradient(speed))]
    columns = np.column_stack([signal / max(float(np.std(signal)), 1e-300) for signal in columns])
    size = float(np.linalg.norm(force))
    if not size > 0:
        return 0.0, 0.0
    products, along = columns.T @ columns, columns.T @ (force / size)
    best = [0.0, 0.0]
    for chosen in chain.from_iterable(combinations(range(3), count) for count in (1, 2, 3)):
        factors = np.linalg.lstsq(products[np.ix_(chosen, chosen)], along[list(chosen)], rcond=None)[0]
        for turned, sign in enumerate((1, -1)):
            if (sign * factors).min() >= 0:
                best[turned] = max(best[turned], float(along[list(chosen)] @ factors))
    return best[0], best[1]


def _in_blocks(power: np.ndarray) -> np.ndarray:
    """Energy taken in each stretch of a record, relative to the record's size."""
    size = max(float(np.sqrt(np.mean(power**2))), 1e-300)
    return np.array([block.mean() / size for block in np.array_split(power, _BLOCKS)])


def _standard_errors(stretches: list[np.ndarray]) -> float:
    """Mean energy of the stretches of all records over its standard error."""
    blocks = np.concatenate(stretches)
    spread = float(np.std(blocks, ddof=1)) / np.sqrt(len(blocks))
    return float(blocks.mean()) / spread if spread > 0 else 0.0


def _exchanged(layout: ColumnLayout, reason: str, value: float) -> Finding:
    """Say that input and output are exchanged, and which lines of YAML change that."""
    columns = columns_yaml(input=layout.columns["output"], output=layout.columns["input"])
    sentence = (
        f"Input and output seem to be exchanged: {reason}. A tissue's input is its motion and its output the force. If the test "
        f"was driven by the force (force in, motion out), use --forward, or put this into the study's YAML:\n{FORWARD}\nIf only "
        f"the columns are exchanged, put this there instead:\n{columns}"
    )
    return Finding("direction", sentence, value, "")


def columns_yaml(**columns: ColumnSettings) -> str:
    """Lines of a study's YAML that read these roles."""
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
    """A name as YAML reads it back; quoted where it holds more than letters, digits, _, / and ·."""
    plain = isinstance(value, int) or (value[:1].isalpha() and all(c.isalnum() or c in "_/·" for c in value))
    return str(value) if plain else "'" + value.replace("'", "''") + "'"
