"""What the page of a diagnosis holds: every record, and every model that was fitted, simulated on each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lumbar.diagnosis.fitting.fit_data import SETTLING
from lumbar.diagnosis.fitting.preparation import Experiment
from lumbar.diagnosis.residuals.locate import residual_of
from lumbar.diagnosis.residuals.residual_report import simulation
from lumbar.diagnosis.selection.forward_selection import Candidate
from lumbar.diagnosis.selection.refined_model import model_name
from lumbar.diagnosis.selection.verdict import Verdict
from lumbar.identification.metrics import fit_ratio, variance_accounted_for
from lumbar.models.measured_angle import for_base
from lumbar.models.model_data import FittedParameter
from lumbar.records.record import Record

MOST_VALUES = 1_200_000
"""Numbers that a page holds in 4 bytes each, about 6.5 MB as text; of longer records every second, third, … sample is drawn."""
_SEGMENTS = 8
"""Segments of Welch's method where a record has no period."""


@dataclass(frozen=True, eq=False)
class ShownRecord:
    """One record as it is drawn.

    Attributes
    ----------
    name : str
    trained : bool
        Whether models were fitted to it; the others are unseen.
    columns : dict of str to numpy.ndarray, shape (drawn samples,)
        ``time`` (s), ``position``, ``velocity`` and ``measured``, in the records' units.
    frequency : numpy.ndarray, shape (lines,)
        Hz.
    noise : numpy.ndarray, shape (lines,), or None
        Amplitude density of the noise in the output's unit per √Hz, where it is known.
    """

    name: str
    trained: bool
    columns: dict[str, np.ndarray]
    frequency: np.ndarray
    noise: np.ndarray | None


@dataclass(frozen=True, eq=False)
class ShownModel:
    """One fitted model on every record.

    Attributes
    ----------
    effects : tuple of str
    label : str
    train_rms, test_rms : float
        Errors in the output's unit.
    values, density : dict of str to numpy.ndarray
        Simulated output (drawn samples) and amplitude density of its error, by record.
    merits : dict of str to dict
        ``rms``, ``vaf`` and ``fit`` of every record, of all samples from the settling time on.
    parameters : list of FittedParameter
        With intervals, where they were computed.
    """

    effects: tuple[str, ...]
    label: str
    train_rms: float
    test_rms: float
    values: dict[str, np.ndarray]
    density: dict[str, np.ndarray]
    merits: dict[str, dict[str, float]]
    parameters: list[FittedParameter]

    @property
    def key(self) -> str:
        """The set of its effects: their order makes no other model."""
        return model_key(self.effects)


def model_key(effects: Sequence[str]) -> str:
    """Name of a set of effects on the page; ``base`` without any."""
    return "+".join(sorted(effects)) or "base"


def candidates_of(verdict: Verdict) -> list[tuple[Candidate, list[FittedParameter]]]:
    """Every fitted set of effects once: the path, then the ranking, with the parameters' intervals where they are known."""
    ranked = {model_key(item.candidate.effects): item for item in verdict.ranking}
    found = {model_key(item.effects): (item, []) for item in verdict.path}
    found |= {key: (item.candidate, item.estimates) for key, item in ranked.items()}
    return list(found.values())


def drawing_step(experiment: Experiment, models: int) -> int:
    """Which samples are drawn, so that the page stays within `MOST_VALUES`: every one, every second, …."""
    samples = sum(len(record) for record in experiment.records)
    return max(1, -(-samples * (models + 4) // MOST_VALUES))


def shown_records(verdict: Verdict, step: int) -> list[ShownRecord]:
    """Every record of a diagnosis as it is drawn."""
    experiment = verdict.experiment
    trained = {item.name for item in getattr(experiment.training, "parts", (experiment.training,))}
    return [_shown_record(record, record.name in trained, verdict, step) for record in _seen(verdict)]


def _seen(verdict: Verdict) -> list[Record]:
    base = verdict.base.fit.structure.base
    return [for_base(record, base) for record in verdict.experiment.records]


def _shown_record(record: Record, trained: bool, verdict: Verdict, step: int) -> ShownRecord:
    experiment = verdict.experiment
    source = "" if record.name == experiment.floor_from else experiment.floor_from
    residual = residual_of(record, record["output"], experiment.floor, source)
    first = len(record) - len(residual.values)
    columns = {
        "time": record.time - record.time[0],
        "position": record["input"],
        "velocity": np.concatenate([np.full(first, residual.velocity[0]), residual.velocity]),
        "measured": record["output"],
    }
    frequency, _ = _density(residual.values, record, _period(record, verdict))
    noise = None
    if residual.floor is not None:
        noise = np.sqrt(2 * record.sampling_time * residual.noise_power(frequency))
    return ShownRecord(record.name, trained, _drawn(columns, step), frequency, noise)


def _drawn(columns: dict[str, np.ndarray], step: int) -> dict[str, np.ndarray]:
    return {name: values[::step].astype(np.float32) for name, values in columns.items()}


def shown_model(
    candidate: Candidate, parameters: list[FittedParameter], verdict: Verdict, step: int
) -> ShownModel:
    """Simulate one fitted model on every record.

    Parameters
    ----------
    candidate : Candidate
    parameters : list of FittedParameter
    verdict : Verdict
        Whose records it is shown on.
    step : int
        See `drawing_step`.
    """
    experiment, seen = verdict.experiment, _seen(verdict)
    simulate = simulation(seen, candidate.fit, experiment.surface, experiment.session)
    values, density, merits = {}, {}, {}
    for record in seen:
        simulated = simulate(record)
        first = min(round(SETTLING / record.sampling_time), len(record) - 2)
        measured, output = record["output"][first:], simulated[first:]
        values[record.name] = simulated[::step].astype(np.float32)
        density[record.name] = _density(measured - output, record, _period(record, verdict))[1]
        merits[record.name] = {
            "rms": float(np.sqrt(np.mean((measured - output) ** 2))),
            "vaf": variance_accounted_for(measured, output),
            "fit": fit_ratio(measured, output),
        }
    return ShownModel(
        candidate.effects,
        model_name(candidate.fit),
        candidate.train_rms,
        candidate.test_rms,
        values,
        density,
        merits,
        list(parameters),
    )


def _period(record: Record, verdict: Verdict) -> float:
    """Seconds after which a record repeats; 0 where it does not."""
    experiment = verdict.experiment
    repeats = experiment.floor is not None and record.name == experiment.floor_from
    return experiment.floor.period if repeats else 0.0


def _density(error: np.ndarray, record: Record, period_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Amplitude density by Welch's method, over whole periods where the record repeats; frequencies above 0 Hz."""
    from scipy.signal import welch

    period = round(period_s / record.sampling_time)
    length = period if 0 < period <= len(error) else max(len(error) // _SEGMENTS, min(len(error), 64))
    frequency, power = welch(error, 1 / record.sampling_time, nperseg=length, detrend="constant")
    return frequency[1:].astype(np.float32), np.sqrt(power[1:]).astype(np.float32)
