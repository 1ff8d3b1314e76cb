"""An effect put into a model at any strength: the force that it adds has a root mean square that is asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, nonlinear_starts, shape_bounds
from lumbar.tissue.diagnosis.fitting.sensitivity_subspace import beyond, tangent_basis
from lumbar.tissue.models.form import Form, Place

_LARGEST = 10.0
"""RMS of the response, in those of the record, up to which a parallel form's force is scaled."""
_NOTHING = 1e-6
"""Share of a force that is left by rounding alone."""
_ROUNDS = 4
"""Fixed-point iterations for the strength at which an effect becomes visible: its share beyond the model moves little."""


@dataclass(frozen=True, eq=False)
class Injection:
    """A form added to a fitted model, with one dose that its force grows with.

    The dose of a parallel form scales its forces; of a form at the input or output it is the one of its parameters that
    changes the force most, e.g. a delay or a limit, in the direction in which it does.
    """

    model: Fit
    """Without the effect."""
    form: Form
    start: np.ndarray
    """Nonlinear parameters of the form."""
    data: FitData
    """Training record, on which strengths are measured."""

    @classmethod
    def middle(cls, model: Fit, form: Form, data: FitData) -> Injection:
        """Add a form with the middle one of its starting values."""
        starts = nonlinear_starts(form, data, data.force - model.simulate(data.motion))
        return cls(model, form, starts[len(starts) // 2], data)

    @property
    def largest(self) -> float:
        """Largest RMS that the force can have, in the output's unit; 0 where these motions do not call the effect forth."""
        return self._doses[1]

    def at(self, rms: float) -> Fit:
        """The model with the effect, its force of this RMS over the samples that count of the training record.

        Raises
        ------
        ValueError
            Beyond `largest`.
        """
        if not 0 < rms <= self.largest * (1 + 1e-9):
            raise ValueError(f"{self.form.key}: {rms:g} is not between 0 and {self.largest:g}")
        fit_at, largest = self._doses
        if self.form.place is Place.PARALLEL and self.model.structure.is_linear:
            return fit_at(rms / largest)
        return fit_at(self._dose_of(min(rms, largest)))

    def predicted(self, least: float) -> float:
        """Smallest RMS of the force of which so much is visible, to first order.

        Visible is what the model's own parameters cannot take up, after whitening, as of
        `lumbar.tissue.diagnosis.design.detectable.detectable_effects`. NaN where they take up all of it.

        Parameters
        ----------
        least : float
            RMS that must be visible.
        """
        rms = min(least, self.largest)
        for _ in range(_ROUNDS):
            fit = self.at(rms)
            share = self._visible(fit) / self.rms(fit)
            if not share > _NOTHING:
                return float("nan")
            rms = min(least / share, self.largest)
        return float(least / share)

    def _visible(self, fit: Fit) -> float:
        """RMS of what the model without the effect leaves of the added force, whitened."""
        added = fit.simulate(self.data.motion) - self.model.simulate(self.data.motion)
        left = beyond(self._basis, self.data.counted(added))
        return float(np.sqrt(np.mean(left**2)))

    @cached_property
    def _basis(self) -> np.ndarray:
        return tangent_basis(self.model, [self.data])

    def rms(self, fit: Fit) -> float:
        """RMS of what another model adds to the one without the effect, over the samples that count."""
        added = fit.simulate(self.data.motion) - self._without
        return float(np.sqrt(np.mean(self.data.settled(added) ** 2)))

    @cached_property
    def _without(self) -> np.ndarray:
        return self.model.simulate(self.data.motion)

    def _with(self, linear: np.ndarray, nonlinear: np.ndarray) -> Fit:
        model = self.model
        return replace(
            model,
            structure=model.structure.with_form(self.form),
            linear=np.concatenate([model.linear, linear]),
            nonlinear=np.concatenate([model.nonlinear, nonlinear]),
        )

    @cached_property
    def _doses(self) -> tuple[Callable[[float], Fit], float]:
        """Model by dose, which lies between 0 (no effect) and 1 (the largest), and the largest RMS."""
        if self.form.place is Place.PARALLEL:
            amplitudes = self._amplitudes()
            largest = _LARGEST * float(np.sqrt(np.mean(self.data.settled(self.data.force) ** 2)))
            unit = self.rms(self._with(amplitudes, self.start))
            scale = largest / unit if unit > _NOTHING else 0.0

            def scaled(dose: float) -> Fit:
                return self._with(dose * scale * amplitudes, self.start)

            return scaled, self.rms(scaled(1.0))
        return self._by_parameter()

    def _amplitudes(self) -> np.ndarray:
        """Linear parameters whose forces have RMS 1 each; those that the mechanism can do without are 0."""
        essential = self.form.essential or tuple(item.name for item in self.form.linear)
        found = np.zeros(len(self.form.linear))
        for number, item in enumerate(self.form.linear):
            unit = np.zeros(len(found))
            unit[number] = -1.0 if item.sign < 0 else 1.0
            size = self.rms(self._with(unit, self.start))
            if item.name in essential and size > 0:
                found[number] = unit[number] / size
        return found

    def _by_parameter(self) -> tuple[Callable[[float], Fit], float]:
        """Dose along the nonlinear parameter, from the end of its range that changes nothing to the other."""
        empty = np.zeros(0)
        structure = self.model.structure.with_form(self.form)
        start = np.concatenate([self.model.nonlinear, self.start])
        low, high = (
            bound[len(self.model.nonlinear) :] for bound in shape_bounds(structure, self.data, start)
        )
        ends = []
        for number in range(len(self.start)):
            for weak, strong in ((low[number], high[number]), (high[number], low[number])):
                changes = [self.rms(self._with(empty, self._moved(number, end))) for end in (weak, strong)]
                ends.append((changes[1] - changes[0], number, float(weak), float(strong)))
        _, number, weak, strong = max(ends)

        def along(dose: float) -> Fit:
            return self._with(empty, self._moved(number, float(weak ** (1 - dose) * strong**dose)))

        return along, self.rms(along(1.0))

    def _moved(self, number: int, value: float) -> np.ndarray:
        moved = np.array(self.start, dtype=float)
        moved[number] = value
        return moved

    def _dose_of(self, rms: float) -> float:
        """Dose at which the added force has this RMS, by Brent's method; 0 where the least dose adds more."""
        from scipy.optimize import brentq

        fit_at, _ = self._doses

        def above(dose: float) -> float:
            return self.rms(fit_at(dose)) - rms

        if above(0.0) >= 0:
            return 0.0
        return 1.0 if above(1.0) <= 0 else float(brentq(above, 0.0, 1.0, xtol=1e-9, rtol=1e-7))


def without_effect(fit: Fit, effect: str) -> tuple[Fit, Form, np.ndarray]:
    """Take an effect out of a fitted model: the model without it, its form and its nonlinear parameters."""
    structure = fit.structure
    form = next(item for item in structure.forms if item.effect == effect)
    position = len(structure.base.linear)
    keep = np.ones(len(fit.linear), dtype=bool)
    for item in structure.forms:
        if item is form:
            keep[position : position + len(item.linear)] = False
        position += len(item.linear)
    base, parts = structure.nonlinear_of(fit.nonlinear)
    rest = structure.without(effect)
    nonlinear = np.concatenate([base, *(parts[item.key] for item in rest.forms)])
    return replace(fit, structure=rest, linear=fit.linear[keep], nonlinear=nonlinear), form, parts[form.key]
