"""Agreement of a free-run simulation with a record, and the error that a better model could explain."""

from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.base.formats import format_number, percent
from lumbar.records.record import Record
from lumbar.tables.table import Table, table_from_schema
from lumbar.tissue.diagnosis.noise.noise_floor import NoiseFloor, autocovariance
from lumbar.tissue.identification.metrics import fit_ratio, mean_residual, variance_accounted_for

RESAMPLES = 300
CONFIDENCE = 0.95
_MIN_BLOCKS = 8
_BLOCK_LENGTH = 3
"""Length of a block, in correlation lengths of the energies."""
_MAX_ROUNDING_SHARE = 1e-12
"""Largest share of a mean square that is rounding of a variance."""


@dataclass(frozen=True)
class EstimateWithInterval:
    """A figure of merit and its interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Comparison:
    """Comparison of one record with one simulation."""

    record: str
    unit: str
    """Unit of the output."""
    samples: int
    """Number of samples that count, after `start`."""
    start: float
    """Seconds at the record's beginning that are left out."""
    rms: EstimateWithInterval
    """Root mean square of the residual of the free run."""
    vaf: EstimateWithInterval
    """Variance accounted for, in percent; see `lumbar.tissue.identification.metrics`."""
    fit: EstimateWithInterval
    """Fit in percent; see `lumbar.tissue.identification.metrics`."""
    mean_residual: EstimateWithInterval
    """Mean absolute residual."""
    output_variance: float
    floor: NoiseFloor | None
    """Noise floor of this record or, if it does not repeat, of a record with the same set-up; None if unknown."""
    floor_from: str
    """Name of the record that the floor comes from; empty without a floor."""

    @property
    def explainable_rms(self) -> float | None:
        """RMS of the error that is not noise: √(RMS² − floor²); None without a floor."""
        if self.floor is None:
            return None
        return float(np.sqrt(max(self.rms.value**2 - self.floor.rms**2, 0.0)))

    @property
    def explainable_percent(self) -> float | None:
        """Share of the output's variance that a better model could still explain, %."""
        return None if self.floor is None else 100.0 * self.explainable_rms**2 / self.output_variance

    @property
    def explainable_vaf(self) -> float | None:
        """Share of the output's variance less the noise's that the model explains, %."""
        if self.floor is None or self.output_variance <= self.floor.rms**2:
            return None
        return 100.0 * (1.0 - self.explainable_rms**2 / (self.output_variance - self.floor.rms**2))

    @property
    def is_noise(self) -> bool | None:
        """True if the error is within the interval of the noise; None without a floor."""
        return None if self.floor is None else self.rms.low <= self.floor.high

    @property
    def sentence(self) -> str:
        """The comparison in one sentence."""
        vaf, rms, unit = self.vaf, self.rms.value, self.unit
        explained = (
            f"{self.record}: the model explains {format_number(vaf.value, 4)} % of the output's variance "
            f"({format_number(vaf.low, 4)} to {format_number(vaf.high, 4)} %); its error is {rms:.3g} {unit} RMS"
        )
        if self.floor is None:
            return f"{explained}; no record repeats, so how much of it is noise is unknown."
        if self.is_noise:
            return f"{explained}, no more than the noise of {self.floor.rms:.3g} {unit}."
        return (
            f"{explained}, with {self.floor.rms:.3g} {unit} of noise: a better model could explain {self.explainable_rms:.3g} "
            f"{unit}, {percent(self.explainable_percent / 100)} of the variance."
        )


def compare_record(
    record: Record,
    simulated: np.ndarray,
    floor: NoiseFloor | None = None,
    floor_from: str = "",
    start: float = 0.0,
    seed: int = 0,
) -> Comparison:
    """Compare a free-run simulation with a record.

    The intervals are valid for other excitations of the same kind. They come from resampling blocks of time (Künsch, Annals of
    Statistics 17, 1989), each longer than the correlation length of the energies of error and output. If the record repeats,
    blocks are parts of the period, and all periods of a part are drawn together, because an error that repeats with the period is
    not new evidence.

    Parameters
    ----------
    record : Record
        Measured record.
    simulated : numpy.ndarray, shape (samples,)
        Free run over the whole record.
    floor : NoiseFloor, optional
        Result of `lumbar.tissue.diagnosis.noise.noise_floor.noise_floor`; default unknown.
    floor_from : str
        Name of the record that `floor` comes from; default this record.
    start : float
        Seconds left out at the beginning, because the initial state is unknown.
    seed : int
        Seed of the resampling.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError
        If the simulation does not fit the record, is not finite, or too little is left after `start`.
    NumericalError
        If the output does not move.
    """
    first = settling_samples(record, simulated, start)
    measured, modelled = record["output"][first:], np.asarray(simulated, dtype=float)[first:]
    if np.var(measured) == 0:
        raise NumericalError(f"{record.name}: the output does not move from {start:g} s on")
    repeats = floor is not None and floor_from in ("", record.name)
    period = round(floor.period / record.sampling_time) if repeats else None
    values = [
        float(np.sqrt(np.mean((measured - modelled) ** 2))),
        variance_accounted_for(measured, modelled),
        fit_ratio(measured, modelled),
        mean_residual(measured, modelled),
    ]
    residual, output = modelled - measured, measured - measured.mean()
    groups = block_groups([residual, output], period)
    draws = np.random.default_rng(seed).integers(len(groups), size=(RESAMPLES, len(groups)))
    # A resample has the sums of its groups, each as often as it was drawn.
    often = np.stack([np.bincount(draw, minlength=len(groups)) for draw in draws])
    powers = np.stack([np.ones(len(output)), residual, residual**2, np.abs(residual), output, output**2])
    sums = often @ np.stack([powers[:, group].sum(axis=1) for group in groups])
    # The same figures from means over samples.
    mean, square, absolute, level, energy = (sums[:, 1:] / sums[:, :1]).T
    variance = energy - level**2
    if np.any(variance <= _MAX_ROUNDING_SHARE * energy):
        raise NumericalError(
            f"{record.name}: the output does not move in most of the record. Its intervals are not known."
        )
    unexplained, rms = (square - mean**2) / variance, np.sqrt(square)
    resampled = np.stack([rms, 100 * (1 - unexplained), 100 * (1 - rms / np.sqrt(variance)), absolute])
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(resampled, [tail, 1 - tail], axis=1)
    estimates = [EstimateWithInterval(*map(float, triple)) for triple in zip(values, low, high, strict=True)]
    return Comparison(
        record=record.name,
        unit=record.channels["output"].unit,
        samples=measured.size,
        start=start,
        **dict(zip(("rms", "vaf", "fit", "mean_residual"), estimates, strict=True)),
        output_variance=float(np.var(measured)),
        floor=floor,
        floor_from=(floor_from or record.name) if floor is not None else "",
    )


def settling_samples(record: Record, simulated: np.ndarray, start: float) -> int:
    """Return the number of samples left out at the start; raise `InputError` if simulation and record do not match."""
    name = record.source or record.name
    if np.shape(simulated) != record.time.shape:
        raise InputError(f"{name}: simulation of shape {np.shape(simulated)} for {len(record)} samples")
    bad = np.flatnonzero(~np.isfinite(simulated))
    if bad.size:
        raise InputError(
            f"{name}: the simulation is {np.asarray(simulated)[bad[0]]} from {record.time[bad[0]]:g} s on: the "
            "model is unstable or was not fitted"
        )
    first = round(start / record.sampling_time)
    if len(record) - first < 2 * _MIN_BLOCKS:
        raise InputError(
            f"{name}: {record.duration:g} s leave {max(len(record) - first, 0)} samples after the first {start:g} s; "
            f"at least {2 * _MIN_BLOCKS} are needed"
        )
    return first


def block_groups(signals: list[np.ndarray], period: int | None) -> list[np.ndarray]:
    """Return groups of samples to resample together: eight blocks or more, three times as long as energies correlate."""
    size = len(signals[0])
    span = period if period and period < size else size
    length = 1
    for signal in signals:
        # Samples over which the signal's square stays correlated: 1 + 2 Σρ up to the first ρ below 0.05.
        energy = signal[:span] ** 2 - np.mean(signal[:span] ** 2)
        covariance = autocovariance(energy, energy.size // 4)
        correlated = 1
        if covariance[0] > 0:
            correlation = covariance / covariance[0]
            ends = np.flatnonzero(correlation < 0.05)
            stop = ends[0] if ends.size else correlation.size
            correlated = int(np.ceil(1 + 2 * correlation[1:stop].sum()))
        length = max(min(_BLOCK_LENGTH * correlated, span // _MIN_BLOCKS), length)
    blocks = span // length
    position = np.arange(size) % span
    block = np.minimum(position * blocks // span, blocks - 1)
    order = np.argsort(block, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(block[order])) + 1)


def comparison_table(comparisons: list[Comparison], source_label: str) -> Table:
    """Return the table of all records, the content of ``compare.csv``."""
    rows = []
    for item in comparisons:
        row = {"record": item.record, "samples": item.samples, "unit": item.unit}
        for name in ("rms", "vaf", "fit", "mean_residual"):
            estimate = getattr(item, name)
            suffix = "_percent" if name in ("vaf", "fit") else ""
            row[f"{name}{suffix}"] = estimate.value
            row |= {f"{name}_low": estimate.low, f"{name}_high": estimate.high}
        floor = item.floor
        rows.append(
            row
            | {
                **{f"noise_floor_{key}": floor and getattr(floor, key) for key in ("rms", "low", "high")},
                "noise_floor_from": item.floor_from or None,
                "explainable_rms": item.explainable_rms,
                "explainable_percent": item.explainable_percent,
                "explainable_vaf_percent": item.explainable_vaf,
            }
        )
    fields = {"start": comparisons[0].start, "percent": 100 * CONFIDENCE, "resamples": RESAMPLES}
    return table_from_schema("tissue/diagnosis/residuals", "compare", rows, source_label, fields)
