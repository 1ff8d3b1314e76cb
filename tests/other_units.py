"""The same experiment with another clock, other units, inverted signs or another order, and its diagnosis."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates
from lumbar.tissue.diagnosis.forward.forward_base import ForwardData
from lumbar.tissue.diagnosis.law.law_form import Dimension
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisResult
from lumbar.tissue.models.form import Form

Diagnose = Callable[[Sequence[Record], Sequence[str] | str | None], DiagnosisResult]
"""From records, and the names of those that are fitted."""
SIGNIFICANT = 1e-3
"""Relative tolerance of errors: searches end at steps of 1e-7 of the parameters, on either side of the optimum."""
WITHIN = 0.1
"""Tolerance of a parameter and both ends of its interval, relative to the interval's width."""
KILOGRAMS = {"kg": "{y}", "kg m": "{y}", "m": "1", "m/s^2": "1"}
"""Units of pendulums, with constant angle and clock: a mass is proportional to the moments."""


@dataclass(frozen=True)
class Units:
    """Factors that convert an experiment to another clock and other units."""

    clock: float = 1.0
    """Factor on the time."""
    motion: float = 1.0
    """Factor on the input."""
    force: float = 1.0
    """Factor on the output."""
    turned: bool = False
    """True if both have the opposite sign."""
    otherwise: bool = False
    """True if the records are in another order and the units have other names."""

    def convert(self, record: Record) -> Record:
        """Return the record in the other units."""
        sign = -1 if self.turned else 1
        factors = {"input": sign * self.motion, "output": sign * self.force, "pivot_acceleration_x": sign}
        units = {"input": "parsec", "output": "dyn"} if self.otherwise else {}
        channels = {
            role: replace(item, values=item.values * factors.get(role, 1.0), unit=units.get(role, item.unit))
            for role, item in record.channels.items()
        }
        period = record.period and record.period * self.clock
        return replace(record, time=record.time * self.clock, channels=channels, period=period)

    def factor(self, unit: str) -> float:
        """Return the factor on a quantity with this unit."""
        size = Dimension.parse(KILOGRAMS.get(unit, unit))
        return self.motion**size.x * self.force**size.y * self.clock**size.s


SLOW = Units(1e4, 1e-6, 1e6, turned=True, otherwise=True)
FAST = Units(1e-4, 1e6, 1e-6)


def check_alike(diagnose: Diagnose, records: Sequence[Record], units: Units) -> DiagnosisResult:
    """Diagnose the records and the same in other units; both say the same."""
    first = diagnose(records, None)
    train = [item.name for item in first.experiment.training.records]
    second = diagnose([units.convert(record) for record in records[:: -1 if units.otherwise else 1]], train)
    assert unit_free_fields(first) == unit_free_fields(second)
    for one, other in zip(first.path, second.path, strict=True):
        assert other.test_rms == pytest.approx(one.test_rms * units.force, rel=SIGNIFICANT)
    _check_parameters(first, second, units)
    return first


def unit_free_fields(result: DiagnosisResult) -> dict:
    """Return the fields that no unit changes: base, verdict, effects, ties, findings, convergence."""
    return {
        "base": result.base.fit.structure.base.name,
        "verdict": (result.status, result.refined_status, result.complete),
        "selected": result.selected,
        # With viscous damping hidden, depth-dependent damping is at its neutral value, and rounding decides whether it is tied.
        "ties": {frozenset(item.effects) for item in result.tied_with}
        - {frozenset({"depth_dependent_damping"})},
        "findings": sorted((item.kind, sorted(item.record.split("+"))) for item in result.findings),
        "converged": result.model.fit.converged,
    }


def _check_parameters(first: DiagnosisResult, second: DiagnosisResult, units: Units) -> None:
    every = [estimates(found.model.fit, found.experiment.training, "{x}", "{y}") for found in (first, second)]
    for one, other in zip(*every, strict=True):
        factor = units.factor(one.unit)
        if units.turned:
            # An odd effect keeps its sign and an even one takes the other.
            factor *= np.sign(one.value * other.value) or 1
        ends = sorted((one.low * factor, one.high * factor))
        enough = max(WITHIN * (ends[1] - ends[0]), SIGNIFICANT * abs(other.value))
        assert other.value == pytest.approx(one.value * factor, abs=enough), one.name
        assert [other.low, other.high] == pytest.approx(ends, abs=enough), one.name
    # A form counts from the motion to the force, whichever of them drove the record.
    if isinstance(first.experiment.training.records[0], ForwardData):
        units = replace(units, motion=units.force, force=units.motion)
    forms = zip(first.model.fit.structure.forms, second.model.fit.structure.forms, strict=True)
    for form, again in forms:
        expected = {key: value * units.factor(unit) for key, (value, unit) in _followed(form).items()}
        assert {key: value for key, (value, _) in _followed(again).items()} == pytest.approx(expected)


def _followed(form: Form) -> dict[str, tuple[float, str]]:
    """Constants that follow the record, with their units."""
    return {item.symbol: (item.value, item.unit) for item in form.constants if item.scale}
