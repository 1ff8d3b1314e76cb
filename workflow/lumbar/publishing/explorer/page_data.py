"""Data of the page of a diagnosis: every record, and every fitted model simulated on each record."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting.preparation import Experiment, simulate_in_session
from lumbar.tissue.diagnosis.residuals.candidate_causes import rank_causes
from lumbar.tissue.diagnosis.residuals.locate import Location, residual_of, simulation
from lumbar.tissue.diagnosis.residuals.motion_diagnostics import reversal_reach, reversals
from lumbar.tissue.diagnosis.residuals.time_frequency import EVEN, EXCITED, ODD, excited_lines, line_classes
from lumbar.tissue.diagnosis.selection.candidate import Candidate
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisResult
from lumbar.tissue.diagnosis.selection.refine import model_name
from lumbar.tissue.identification.metrics import fit_ratio, variance_accounted_for
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.measured_motion import for_base
from lumbar.tissue.models.model_data import ARX, GIVEN, OUTPUT_ERROR
from lumbar.tissue.signals.spectrum import welch

_SEGMENTS = 8
"""Number of segments in Welch's method, for records without a period."""
RECORD_COLUMNS = 6
"""Number of drawn columns of a record, without columns of models."""
_MARKERS = {EXCITED: "circle", EVEN: "square", ODD: "triangle"}
"""Markers of a periodic record's lines by their class."""
EFFECTS_GROUP = "with effects"
_THESIS_GROUPS = {
    ARX: "of the thesis, ridge ARX",
    OUTPUT_ERROR: "of the thesis, output error",
    GIVEN: "of the thesis, given",
}
"""Names of groups of the thesis's models by estimator."""
_ESTIMATORS = {ARX: "ARX", OUTPUT_ERROR: "output error"}


@dataclass(frozen=True, eq=False)
class RecordData:
    """Data of one record for drawing."""

    record: Record
    """Record with the base's input and output."""
    is_training: bool
    """True if models were fitted to the record."""
    first: int
    """Index of the first sample that counts in errors."""
    rows: np.ndarray | None
    """Shape (periods, samples): indices of whole periods that give the record's noise; None if there are none."""
    columns: dict[str, np.ndarray]
    """Columns of shape (drawn samples,): ``time`` (s), ``position``, ``velocity`` and ``measured`` in the records' units;
    ``since``, seconds after (negative: before) the nearest reversal of the motion, NaN if none is near; ``turned``, the
    direction after that reversal."""
    frequency: np.ndarray
    """Frequencies of the spectrum above 0 Hz, shape (lines,)."""
    noise: np.ndarray | None
    """Amplitude density of the noise in the output's unit per √Hz, shape (lines,); None if unknown."""
    marker: list[str]
    """Bokeh's marker for every line of the spectrum; ``dot`` for lines without a class."""
    step: int
    """Step between drawn samples: 1, or more for long records."""

    @property
    def name(self) -> str:
        """Name of the record."""
        return self.record.name

    def density(self, error: np.ndarray) -> np.ndarray:
        """Return the amplitude density of an error that begins at `first`, shape (lines,)."""
        return _density(error, self.rows, self.record.sampling_time)[1]


def _density(error: np.ndarray, rows: np.ndarray | None, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies above 0 Hz and an amplitude density.

    The density is the mean over whole periods if the record repeats, so that lines do not leak; else it is Welch's estimate.
    """
    if rows is not None:
        samples = rows.shape[1]
        power = np.mean(np.abs(np.fft.rfft(error[rows])) ** 2, axis=0) * 2 * step / samples
        frequency = np.fft.rfftfreq(samples, step)
    else:
        length = max(len(error) // _SEGMENTS, min(len(error), 64))
        frequency, power = welch(error, step, np.hanning(length + 1)[:-1])
    return frequency[1:].astype(np.float32), np.sqrt(power[1:]).astype(np.float32)


@dataclass(frozen=True, eq=False)
class PageModel:
    """One model with its simulation on every record."""

    key: str
    """Key on the page: see `model_key`; for a model of the thesis its name and estimator."""
    effects: tuple[str, ...]
    label: str
    group: str
    train_rms: float
    """Error on training records in the output's unit."""
    test_rms: float | None
    """Error on unseen records in the output's unit; None without unseen records."""
    errors: dict[str, np.ndarray]
    """Measured less simulated output at drawn samples by record, as 16-bit integers in units of `scales`."""
    scales: dict[str, float]
    """Unit of `errors` by record, in the output's unit."""
    density: dict[str, np.ndarray]
    """Amplitude density of the model's error by record."""
    merits: dict[str, dict[str, float]]
    """Figures of merit ``rms``, ``vaf`` and ``fit`` by record, over all samples after the settling time."""
    located: dict[str, Location] = field(default_factory=dict)
    """Location of the error by record; empty for models of the thesis."""


def model_key(effects: Sequence[str]) -> str:
    """Return the key of a set of effects on the page, independent of their order; ``base`` without effects."""
    return "+".join(sorted(effects)) or "base"


def fitted_candidates(diagnosis: DiagnosisResult) -> list[Candidate]:
    """Return every fitted set of effects, without repetitions: the path, the ranking, then the other sets that were tried."""
    fitted = [*diagnosis.path, *(item.candidate for item in diagnosis.ranking), *diagnosis.tried]
    return list({model_key(item.effects): item for item in reversed(fitted)}.values())[::-1]


def gather_records(diagnosis: DiagnosisResult, samples: int) -> list[RecordData]:
    """Return every record of a diagnosis for drawing, with at most `samples` samples together: long records are thinned."""
    experiment = diagnosis.experiment
    training = {item.name for item in getattr(experiment.training, "parts", (experiment.training,))}
    base, most, left = diagnosis.base.fit.structure.base, 1, samples
    lengths = sorted(map(len, experiment.records))
    for place, length in enumerate(lengths):
        most = max(left // (len(lengths) - place), 1)
        left -= min(length, most)
    return [
        _record_data(for_base(record, base), record.name in training, experiment, -(-len(record) // most))
        for record in experiment.records
    ]


def _record_data(record: Record, is_training: bool, experiment: Experiment, step: int) -> RecordData:
    residual = residual_of(record, np.zeros(len(record)), experiment)
    first = len(record) - len(residual.values)
    since, turned = _since_reversal(record)
    columns = {
        "time": record.time - record.time[0],
        "position": record["input"],
        "velocity": np.concatenate([np.full(first, residual.velocity[0]), residual.velocity]),
        "measured": record["output"],
        "since": since,
        "turned": turned,
    }
    rows = None if residual.folding is None else residual.folding.rows
    frequency = _density(np.zeros(len(record) - first), rows, record.sampling_time)[0]
    marker = ["dot"] * len(frequency)
    if rows is not None:
        excited = excited_lines(residual.position[rows].mean(axis=0))
        classes = line_classes(excited, rows.shape[1] // 2 + 1)[1:]
        marker = [_MARKERS.get(kind, "dot") for kind in classes]
    noise = None
    if residual.floor is not None:
        noise = np.sqrt(2 * record.sampling_time * residual.noise_power(frequency))
    drawn = {
        name: values[::step].astype(np.int8 if name == "turned" else np.float32)
        for name, values in columns.items()
    }
    return RecordData(record, is_training, first, rows, drawn, frequency, noise, marker, step)


def _since_reversal(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Return seconds after the nearest reversal (NaN beyond half their typical interval) and the direction after it."""
    samples = np.arange(len(record))
    turns, directions = reversals(record["input"])
    if turns.size < 2:
        return np.full(len(samples), np.nan), np.zeros(len(samples))
    nearest = np.searchsorted((turns[1:] + turns[:-1]) / 2, samples)
    since = (samples - turns[nearest]).astype(float)
    since[np.abs(since) > reversal_reach(turns, len(samples))] = np.nan
    return since * record.sampling_time, directions[nearest].astype(float)


def simulate_candidate(
    candidate: Candidate, experiment: Experiment, records: Sequence[RecordData]
) -> PageModel:
    """Simulate the base with effects on every record."""
    simulate = simulation(
        [item.record for item in records], candidate.fit, experiment.surface, experiment.session
    )
    simulated = {item.name: simulate(item.record) for item in records}
    residuals = [residual_of(item.record, simulated[item.name], experiment) for item in records]
    causes, named = rank_causes(residuals), zip(records, residuals, strict=True)
    return PageModel(
        model_key(candidate.effects),
        candidate.effects,
        model_name(candidate.fit).replace("+", " + ").replace("_", " "),
        EFFECTS_GROUP,
        candidate.train_rms,
        candidate.test_rms,
        *_compare(simulated, records),
        {item.name: Location.from_residual(item.name, residual, causes) for item, residual in named},
    )


def simulate_thesis_model(
    model: FittedModel, experiment: Experiment, records: Sequence[RecordData]
) -> PageModel:
    """Simulate a model of the thesis on every record.

    Raises
    ------
    NumericalError
        If the model is unstable.
    """
    seen = [item.record for item in records]
    simulate = simulate_in_session(seen, model.simulate) if experiment.session else model.simulate
    drawn, scales, density, merits = _compare({item.name: simulate(item.record) for item in records}, records)
    errors: list[float | None] = []
    for is_training in (True, False):
        counted = [item for item in records if item.is_training == is_training]
        sizes = [len(item.record) - item.first for item in counted]
        squares = [size * merits[item.name]["rms"] ** 2 for item, size in zip(counted, sizes, strict=True)]
        errors.append(float(np.sqrt(sum(squares) / sum(sizes))) if counted else None)
    label = model.name if model.estimator == GIVEN else f"{model.name} ({_ESTIMATORS[model.estimator]})"
    key, group = f"{model.name}:{model.estimator}", _THESIS_GROUPS[model.estimator]
    return PageModel(key, (), label, group, *errors, drawn, scales, density, merits)


def _compare(simulated: Mapping[str, np.ndarray], records: Sequence[RecordData]):
    """Return errors with their units, density of the error and figures of merit of simulated outputs, each by record."""
    errors, scales, density, merits = {}, {}, {}, {}
    for item in records:
        drawn = (item.record["output"] - simulated[item.name])[:: item.step]
        scales[item.name] = float(np.abs(drawn).max()) / np.iinfo(np.int16).max or 1.0
        errors[item.name] = np.round(drawn / scales[item.name]).astype(np.int16)
        measured, output = item.record["output"][item.first :], simulated[item.name][item.first :]
        density[item.name] = item.density(measured - output)
        merits[item.name] = {
            "rms": float(np.sqrt(np.mean((measured - output) ** 2))),
            "vaf": variance_accounted_for(measured, output),
            "fit": fit_ratio(measured, output),
        }
    return errors, scales, density, merits
