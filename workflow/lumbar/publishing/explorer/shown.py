"""Data of the page of a diagnosis: every record, and every fitted model simulated on each of them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting.preparation import simulate_in_session
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

_SEGMENTS = 8
"""Segments of Welch's method for records without a period."""
RECORD_COLUMNS = 6
"""Columns of a record without those of the models."""
MARKERS = {EXCITED: "circle", EVEN: "square", ODD: "triangle"}
"""Markers of a periodic record's lines by their class."""
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
    """Record with the base's input and output."""
    trained: bool
    """Whether models were fitted to it."""
    first: int
    """First sample that counts in errors."""
    rows: np.ndarray | None
    """Whole periods among the counted samples, shape (periods, samples), if they give the record's noise; else None."""
    columns: dict[str, np.ndarray]
    """Columns of shape (drawn samples,): ``time`` (s), ``position``, ``velocity`` and ``measured`` in the records' units;
    ``since``, seconds after (negative: before) the nearest reversal of the motion, NaN if none is near; ``turned``, the
    direction after that reversal."""
    noise: np.ndarray | None
    """Amplitude density of the noise in the output's unit per √Hz, shape (lines,); None if unknown."""
    marker: list[str]
    """Bokeh's marker of every line of the spectrum; ``dot`` for lines without a class."""

    @property
    def name(self) -> str:
        """Name of the record."""
        return self.record.name

    @property
    def frequency(self) -> np.ndarray:
        """Frequencies of the spectrum above 0 Hz."""
        return self.density(np.zeros(len(self.record) - self.first))[0]

    def density(self, error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return frequencies above 0 Hz and the amplitude density of an error that begins at `first`.

        It is the mean over whole periods if the record repeats, so that lines do not leak; else Welch's estimate.
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
    """Error on training records in the output's unit."""
    test_rms: float | None
    """Error on unseen records; None without any."""
    values: dict[str, np.ndarray]
    """Simulated output at drawn samples by record."""
    density: dict[str, np.ndarray]
    """Amplitude density of its error by record."""
    merits: dict[str, dict[str, float]]
    """``rms``, ``vaf`` and ``fit`` by record, over all samples after the settling time."""


def model_key(effects: Sequence[str]) -> str:
    """Return the name of a set of effects on the page, independent of their order; ``base`` without any."""
    return "+".join(sorted(effects)) or "base"


def candidates_of(verdict: DiagnosisResult) -> list[Candidate]:
    """Return every fitted set of effects: the path, then the ranking, without repetitions."""
    fitted = [*verdict.path, *(item.candidate for item in verdict.ranking)]
    return list({model_key(item.effects): item for item in fitted}.values())


def shown_records(verdict: DiagnosisResult, step: int) -> list[ShownRecord]:
    """Return every record of a diagnosis as it is drawn."""
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
    """Return seconds after the nearest reversal, NaN beyond half of their typical distance, and the direction after it."""
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
    """Simulate the base with effects on every record; every `step`-th sample is drawn."""
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
    """Simulate a model of the thesis on every record; parameters as in `shown_candidate`.

    Raises
    ------
    NumericalError
        If the model is unstable.
    """
    seen = [item.record for item in records]
    simulate = simulate_in_session(seen, model.simulate) if verdict.experiment.session else model.simulate
    values, density, merits = _on_records(simulate, records, step)
    train_rms, test_rms = (_pooled(merits, records, trained) for trained in (True, False))
    label = model.name if model.estimator == GIVEN else f"{model.name} ({_ESTIMATORS[model.estimator]})"
    key = f"{model.name}:{model.estimator}"
    return ShownModel(key, (), label, GROUPS[model.estimator], train_rms, test_rms, values, density, merits)


def _on_records(simulate: Callable[[Record], np.ndarray], records: Sequence[ShownRecord], step: int):
    """Return simulated output, density of its error and figures of merit, each by record."""
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
    """Return the root mean square error over the training records or the unseen ones; None without any."""
    counted = [
        (len(item.record) - item.first, merits[item.name]["rms"])
        for item in records
        if item.trained == trained
    ]
    size = sum(size for size, _ in counted)
    return float(np.sqrt(sum(samples * rms**2 for samples, rms in counted) / size)) if size else None
