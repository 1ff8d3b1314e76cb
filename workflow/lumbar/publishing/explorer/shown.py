"""What the page of a diagnosis holds: every record, and every model that was fitted, simulated on each of them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting.preparation import in_session
from lumbar.tissue.diagnosis.residuals.locate import residual_of, simulation
from lumbar.tissue.diagnosis.residuals.motion_diagnostics import reversal_reach, reversals
from lumbar.tissue.diagnosis.residuals.time_frequency import EVEN, EXCITED, ODD, excited_lines, line_classes
from lumbar.tissue.diagnosis.selection.candidate import Candidate
from lumbar.tissue.diagnosis.selection.refine import model_name
from lumbar.tissue.diagnosis.selection.result import DiagnosisResult
from lumbar.tissue.identification.metrics import fit_ratio, variance_accounted_for
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.measured_motion import for_base
from lumbar.tissue.models.model_data import ARX, GIVEN, OUTPUT_ERROR
from lumbar.tissue.signals.spectrum import welch

MOST_VALUES = 1_200_000
"""Numbers that a page holds in 4 bytes each, about 6.5 MB as text; of longer records every second, third, … sample is drawn."""
_SEGMENTS = 8
"""Segments of Welch's method where a record has no period."""
_COLUMNS = 6
"""Columns of a record beside those of the models."""
MARKERS = {EXCITED: "circle", EVEN: "square", ODD: "triangle"}
"""Marks of a periodic record's lines where its grid tells them apart."""
WITH_EFFECTS = "with effects"
GROUPS = {
    ARX: "of the thesis, ridge ARX",
    OUTPUT_ERROR: "of the thesis, output error",
    GIVEN: "of the thesis, given",
}
"""Groups of models by their estimator."""
_ESTIMATORS = {ARX: "ARX", OUTPUT_ERROR: "output error"}


@dataclass(frozen=True, eq=False)
class ShownRecord:
    """One record as it is drawn."""

    record: Record
    """As the base model sees it."""
    trained: bool
    """Whether models were fitted to it; the others are unseen."""
    first: int
    """Sample from which on errors count."""
    rows: np.ndarray | None
    """Shape (periods, samples), or None: whole periods among the samples that count, where the record's noise was told
    from them."""
    columns: dict[str, np.ndarray]
    """Shape (drawn samples,): ``time`` (s), ``position``, ``velocity`` and ``measured``, in the records' units; ``since``,
    seconds after (negative: before) the nearest reversal of the motion, NaN where none is near, and ``turned``, the
    direction it takes then."""
    noise: np.ndarray | None
    """Shape (lines,), or None: amplitude density of the noise in the output's unit per √Hz, where it is known."""
    marker: list[str]
    """Bokeh's mark of every line of the spectrum; ``dot`` for those that say nothing by themselves."""

    @property
    def name(self) -> str:
        """Name of the record."""
        return self.record.name

    @property
    def frequency(self) -> np.ndarray:
        """Lines of the spectrum in Hz, above 0."""
        return self.density(np.zeros(len(self.record) - self.first))[0]

    def density(self, error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies above 0 Hz and amplitude density of an error from `first` on.

        The mean over whole periods where the record repeats, so that its lines do not leak into one another; else Welch's.
        """
        step = self.record.sampling_time
        if self.rows is not None:
            samples = self.rows.shape[1]
            power = np.mean(np.abs(np.fft.rfft(error[self.rows])) ** 2, axis=0) * 2 * step / samples
            frequency = np.fft.rfftfreq(samples, step)
        else:
            length = max(len(error) // _SEGMENTS, min(len(error), 64))
            frequency, power = welch(error, step, np.hanning(length + 1)[:-1])
        return frequency[1:].astype(np.float32), np.sqrt(power[1:]).astype(np.float32)


@dataclass(frozen=True, eq=False)
class ShownModel:
    """One model on every record."""

    key: str
    """See `model_key`; name and estimator of a model of the thesis."""
    effects: tuple[str, ...]
    label: str
    group: str
    train_rms: float
    test_rms: float | None
    """`train_rms`, `test_rms`: errors in the output's unit; None where no record is unseen."""
    values: dict[str, np.ndarray]
    density: dict[str, np.ndarray]
    """`values`, `density`: simulated output (drawn samples) and amplitude density of its error, by record."""
    merits: dict[str, dict[str, float]]
    """``rms``, ``vaf`` and ``fit`` of every record, of all samples from the settling time on."""


def model_key(effects: Sequence[str]) -> str:
    """Name of a set of effects on the page, whose order makes no other model; ``base`` without any."""
    return "+".join(sorted(effects)) or "base"


def candidates_of(verdict: DiagnosisResult) -> list[Candidate]:
    """Every fitted set of effects once: the path, then the ranking."""
    fitted = [*verdict.path, *(item.candidate for item in verdict.ranking)]
    return list({model_key(item.effects): item for item in fitted}.values())


def drawing_step(records: Sequence[Record], models: int) -> int:
    """Which samples are drawn, so that the page stays within `MOST_VALUES`: every one, every second, …."""
    samples = sum(len(record) for record in records)
    return max(1, -(-samples * (models + _COLUMNS) // MOST_VALUES))


def shown_records(verdict: DiagnosisResult, step: int) -> list[ShownRecord]:
    """Every record of a diagnosis as it is drawn."""
    experiment = verdict.experiment
    trained = {item.name for item in getattr(experiment.training, "parts", (experiment.training,))}
    base = verdict.base.fit.structure.base
    return [
        _shown_record(for_base(record, base), record.name in trained, verdict, step)
        for record in experiment.records
    ]


def _shown_record(record: Record, trained: bool, verdict: DiagnosisResult, step: int) -> ShownRecord:
    experiment = verdict.experiment
    residual = residual_of(record, np.zeros(len(record)), experiment)
    first = len(record) - len(residual.values)
    since, turned = _around_reversals(record)
    columns = {
        "time": record.time - record.time[0],
        "position": record["input"],
        "velocity": np.concatenate([np.full(first, residual.velocity[0]), residual.velocity]),
        "measured": record["output"],
        "since": since,
        "turned": turned,
    }
    rows, marker = None, []
    if residual.folding is not None:
        rows = residual.folding.rows
        excited = excited_lines(residual.position[rows].mean(axis=0))
        classes = line_classes(excited, rows.shape[1] // 2 + 1)[1:]
        marker = [MARKERS.get(kind, "dot") for kind in classes]
    drawn = {name: values[::step].astype(np.float32) for name, values in columns.items()}
    found = ShownRecord(record, trained, first, rows, drawn, None, marker)
    frequency = found.frequency
    noise = None
    if residual.floor is not None:
        noise = np.sqrt(2 * record.sampling_time * residual.noise_power(frequency))
    return replace(found, noise=noise, marker=marker or ["dot"] * len(frequency))


def _around_reversals(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Seconds after the nearest reversal, NaN beyond half of what usually lies between two, and the direction after it."""
    samples = np.arange(len(record))
    turns, directions = reversals(record["input"])
    if turns.size < 2:
        return np.full(len(samples), np.nan), np.zeros(len(samples))
    nearest = np.searchsorted((turns[1:] + turns[:-1]) / 2, samples)
    since = (samples - turns[nearest]).astype(float)
    since[np.abs(since) > reversal_reach(turns, len(samples))] = np.nan
    return since * record.sampling_time, directions[nearest].astype(float)


def shown_candidate(
    candidate: Candidate, verdict: DiagnosisResult, records: Sequence[ShownRecord], step: int
) -> ShownModel:
    """Simulate the base with effects on every record; `step` as of `drawing_step`."""
    experiment = verdict.experiment
    seen = [item.record for item in records]
    simulate = simulation(seen, candidate.fit, experiment.surface, experiment.session)
    return ShownModel(
        model_key(candidate.effects),
        candidate.effects,
        model_name(candidate.fit).replace("+", " + ").replace("_", " "),
        WITH_EFFECTS,
        candidate.train_rms,
        candidate.test_rms,
        *_on_records(simulate, records, step),
    )


def shown_fitted(
    model: FittedModel, verdict: DiagnosisResult, records: Sequence[ShownRecord], step: int
) -> ShownModel:
    """Simulate a model of the thesis on every record; parameters as of `shown_candidate`.

    Raises
    ------
    NumericalError
        If the model is unstable.
    """
    seen = [item.record for item in records]
    simulate = in_session(seen, model.simulate) if verdict.experiment.session else model.simulate
    values, density, merits = _on_records(simulate, records, step)
    train_rms, test_rms = (_pooled(merits, records, trained) for trained in (True, False))
    label = model.name if model.estimator == GIVEN else f"{model.name} ({_ESTIMATORS[model.estimator]})"
    key = f"{model.name}:{model.estimator}"
    return ShownModel(key, (), label, GROUPS[model.estimator], train_rms, test_rms, values, density, merits)


def _on_records(simulate: Callable[[Record], np.ndarray], records: Sequence[ShownRecord], step: int):
    """Simulated output, density of its error and figures of merit, each by record."""
    values, density, merits = {}, {}, {}
    for item in records:
        simulated = simulate(item.record)
        measured, output = item.record["output"][item.first :], simulated[item.first :]
        values[item.name] = simulated[::step].astype(np.float32)
        density[item.name] = item.density(measured - output)[1]
        merits[item.name] = {
            "rms": float(np.sqrt(np.mean((measured - output) ** 2))),
            "vaf": variance_accounted_for(measured, output),
            "fit": fit_ratio(measured, output),
        }
    return values, density, merits


def _pooled(
    merits: dict[str, dict[str, float]], records: Sequence[ShownRecord], trained: bool
) -> float | None:
    """Root mean square over all samples of the records that models were, or were not, fitted to; None without any."""
    counted = [
        (len(item.record) - item.first, merits[item.name]["rms"])
        for item in records
        if item.trained == trained
    ]
    size = sum(size for size, _ in counted)
    return float(np.sqrt(sum(own * rms**2 for own, rms in counted) / size)) if size else None
