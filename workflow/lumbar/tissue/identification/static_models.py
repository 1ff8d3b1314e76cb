"""Static laws beside the identified models: how much of a force, and of what a hand feels of it, needs time at all.

Every law is fitted to the training record by least squares, force and position about their means as for the dynamic models; its
parameters are counted without the mean.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lumbar.records.record import Record
from lumbar.tables.described import described
from lumbar.tables.table import Table
from lumbar.tissue.identification.metrics import settling_time, variance_accounted_for
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.model_data import GIVEN
from lumbar.tissue.perception.felt import Felt, felt_columns, force_difference
from lumbar.tissue.perception.thresholds import Hands

_MOST = 4
"""Parameters of the largest law."""
_CURVATURES = np.geomspace(0.05, 20.0, 60)
"""Exponents over the half range of the positions that are tried, of either sign."""
Simulate = Callable[[Record], np.ndarray]


@dataclass(frozen=True)
class StaticLaw:
    """A force that depends on the position alone."""

    name: str
    parameters: int
    force: Callable[[np.ndarray], np.ndarray]
    """From positions to forces, in the units of the record that it was fitted to."""


def static_laws(training: Record, first: int) -> list[StaticLaw]:
    """Odd polynomials, piecewise straight lines and an exponential, fitted to a record from sample `first` on."""
    position, force = training["input"][first:], training["output"][first:]
    middle, half = float(np.mean(position)), float(np.ptp(position)) / 2

    def fitted(name: str, parameters: int, columns: Callable[[np.ndarray], np.ndarray]) -> StaticLaw:
        def matrix(positions: np.ndarray) -> np.ndarray:
            seen = columns((positions - middle) / half)
            return np.column_stack([np.ones(len(positions)), seen])

        solution = np.linalg.lstsq(matrix(position), force, rcond=None)[0]
        return StaticLaw(name, parameters, lambda positions: matrix(positions) @ solution)

    def odd(number: int) -> Callable[[np.ndarray], np.ndarray]:
        return lambda x: x[:, None] ** np.arange(1, 2 * number, 2)

    def pieces(number: int) -> Callable[[np.ndarray], np.ndarray]:
        knots = np.quantile((position - middle) / half, np.arange(1, number) / number)
        return lambda x: np.column_stack([x, *(np.maximum(x - knot, 0.0) for knot in knots)])

    def exponential(exponent: float) -> StaticLaw:
        return fitted("exponential", 2, lambda x: np.expm1(exponent * x)[:, None])

    laws = [fitted("linear", 1, odd(1))]
    for number in range(2, _MOST + 1):
        laws.append(fitted(f"odd polynomial, degree {2 * number - 1}", number, odd(number)))
        laws.append(fitted(f"piecewise linear, {number} pieces", number, pieces(number)))
    curved = [exponential(sign * size) for sign in (-1, 1) for size in _CURVATURES]
    laws.append(min(curved, key=lambda law: float(np.sum((law.force(position) - force) ** 2))))
    return sorted(laws, key=lambda law: (law.parameters, law.name))


def felt_on(
    record: Record,
    simulate: Simulate,
    hands: Hands,
    settling_s: float | None,
    noise: tuple[np.ndarray, np.ndarray] | None,
) -> Felt | None:
    """What a hand would tell of a free run beside the record; parameters as of `force_difference`."""
    first = round(settling_time(record, settling_s) / record.sampling_time)
    measured, modelled = record["output"][first:], simulate(record)[first:]
    unit, step = record.channels["output"].unit, record.sampling_time
    if not np.isfinite(modelled).all():
        return None
    met = force_difference(measured, modelled, unit, record["input"][first:], step, hands, noise)
    return met and met.felt


def static_or_dynamic_table(
    models: Sequence[FittedModel],
    training: Record,
    tests: Sequence[Record],
    hands: Hands,
    settling_s: float | None,
    noise: tuple[np.ndarray, np.ndarray] | None,
    data: str,
) -> Table:
    """Static laws and identified models by number of parameters, with what a hand tells of their errors."""
    first = round(settling_time(training, settling_s) / training.sampling_time)
    found: list[tuple[str, str, int, Simulate]] = [
        (law.name, "static", law.parameters, lambda record, law=law: law.force(record["input"]))
        for law in static_laws(training, first)
    ]
    found += [
        (f"{model.name} ({model.estimator})", "dynamic", model.scores.free_parameters or 0, model.simulate)
        for model in models
        if model.discrete and model.stable and model.estimator != GIVEN and model.trained_on == training.name
    ]
    rows = []
    for name, kind, parameters, simulate in sorted(found, key=lambda item: (item[2], item[1] == "dynamic")):
        felt = felt_on(training, simulate, hands, settling_s, noise)
        vaf = [_vaf(record, simulate, settling_s) for record in (training, *tests)]
        means = float(np.mean(vaf[1:])) if tests else None
        row = {
            "model": name,
            "kind": kind,
            "parameters": parameters,
            "vaf_percent": vaf[0],
            "vaf_tests_percent": means,
        }
        rows.append(row | felt_columns(felt))
    words = {"record": training.name, "sentence": _needs_time(rows)}
    return described(__file__, "static_or_dynamic", rows, data, words)


def _vaf(record: Record, simulate: Simulate, settling_s: float | None) -> float:
    first = round(settling_time(record, settling_s) / record.sampling_time)
    return variance_accounted_for(record["output"][first:], simulate(record)[first:])


def _needs_time(rows: Sequence[dict]) -> str:
    """How much of what is felt of a straight spring's error a static law takes away, and how much a model with time."""
    felt = {kind: [row["felt_jnd"] for row in rows if row["kind"] == kind] for kind in ("static", "dynamic")}
    if None in felt["static"] or not felt["dynamic"]:
        return "What a hand would tell is known of forces alone."
    straight = next(row["felt_jnd"] for row in rows if row["model"] == "linear")
    best = {kind: min(values) for kind, values in felt.items()}
    return (
        f"To a hand a straight spring is wrong by {straight:.2g} times what it just notices, the best static law by "
        f"{best['static']:.2g}, the best model with time by {best['dynamic']:.2g}."
    )
