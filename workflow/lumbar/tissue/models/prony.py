"""Prony series of linear and quasi-linear models, in the forms that finite-element programs read.

A step of position, or of a quasi-linear base's elastic response, is followed by k∞ + Σ kᵢ exp(−t/τᵢ). Finite-element programs
divide by the value at once, k₀ = k∞ + Σ kᵢ: gᵢ = kᵢ/k₀ (FEBio: Puso and Weiss, J. Biomech. Eng. 120 (1998) 62-70). FEBio takes
six terms.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import scipy

from lumbar.base.errors import InputError
from lumbar.tissue.models.bases import LENGTH
from lumbar.tissue.models.driven_motion import ForceBalance, can_be_simulated
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.form import Place
from lumbar.tissue.models.structure import ForwardStructure, Structure
from lumbar.tissue.models.transfer_function import TransferFunction

MAX_FEBIO_TERMS = 6
"""Number of terms of FEBio's material ``viscoelastic``."""
_FIRST_TIME, _LAST_TIME = 2.0, 0.7
"""Ends of the times of a series with fewer terms, relative to those of the series."""
_RELATIVE_ERROR = 1e-9
"""Largest error of slopes and relaxations that is rounding."""


@dataclass(frozen=True)
class PronySeries:
    """Relaxation of a model after a step."""

    model: FittedModel
    equilibrium: float
    """Stiffness after a long time; of a quasi-linear base at small positions; force's unit per position's unit."""
    terms: tuple[tuple[float, float], ...]
    """Stiffness that relaxes, in the same unit, and its relaxation time in seconds; the fastest first."""

    @property
    def instantaneous(self) -> float:
        """Stiffness at once, in the force's unit per position's unit."""
        return self.equilibrium + sum(stiffness for stiffness, _ in self.terms)

    @property
    def reduced_terms(self) -> list[tuple[float, float]]:
        """Terms as shares of the instantaneous stiffness, with their relaxation times in seconds."""
        return [(stiffness / self.instantaneous, time) for stiffness, time in self.terms]

    def relaxation(self, time: np.ndarray) -> np.ndarray:
        """Return the stiffness at times after a step (s), in the force's unit per position's unit, in the shape of `time`."""
        left = (stiffness * np.exp(-np.asarray(time) / tau) for stiffness, tau in self.terms)
        return np.asarray(self.equilibrium + sum(left))

    def limit_terms(self, most: int) -> tuple[Self, float]:
        """Return the series with at most `most` terms, and its largest error as a share of the instantaneous stiffness.

        The new times are evenly spaced in logarithms; the stiffnesses are a non-negative least-squares fit to the series.

        Parameters
        ----------
        most : int
            Largest number of terms, at least 2.
        """
        if len(self.terms) <= most:
            return self, 0.0
        fastest, slowest = self.terms[0][1], self.terms[-1][1]
        times = np.geomspace(_FIRST_TIME * fastest, _LAST_TIME * slowest, most)
        at = np.append(0.0, np.geomspace(fastest / 30, 3 * slowest, 400))
        wanted = self.relaxation(at)
        columns = np.column_stack([np.ones(len(at)), np.exp(-at[:, None] / times)]) / wanted[:, None]
        (equilibrium, *stiffnesses), _ = scipy.optimize.nnls(columns, np.ones(len(at)))
        pairs = zip(map(float, stiffnesses), map(float, times), strict=True)
        fewer = replace(
            self, equilibrium=float(equilibrium), terms=tuple(pair for pair in pairs if pair[0] > 0)
        )
        return fewer, float(np.abs(fewer.relaxation(at) - wanted).max() / self.instantaneous)

    @property
    def _remarks(self) -> list[str]:
        """Lines for the head of a file."""
        model, position, force = self.model, self.model.input.unit, self.model.output.unit
        if isinstance(model.structure, ForwardStructure):
            position, force = force, position
        unit = f"{force}/{position}"
        stiffness = f"from {self.instantaneous:.6g} {unit} at once to {self.equilibrium:.6g} {unit}"
        lines = [f"Relaxation of {model.name}, times in s: {stiffness}."]
        if isinstance(model.structure, Structure) and model.structure.base.is_quasi_linear:
            length = f"{model[LENGTH].value:.6g} {position}"
            lines.append(
                f"Quasi-linear: these are slopes at 0 of an elastic force that grows as exp(|z|/{length}) - 1."
            )
        lines.append(
            "g_i: share of the instantaneous elastic response, which your elastic material must describe;"
        )
        lines.append("force and position along one axis do not determine it.")
        return lines

    def febio(self) -> str:
        """Return the material ``viscoelastic`` of FEBio, with g0 + Σ gᵢ = 1, but without its elastic material."""
        series, error = self.limit_terms(MAX_FEBIO_TERMS)
        remarks = series._remarks
        if error:
            count = f"{len(series.terms)} terms approximate {len(self.terms)}"
            remarks.append(f"{count} within {100 * error:.2g} % of the instantaneous response.")
        lines = ['<?xml version="1.0" encoding="UTF-8"?>']
        # Two hyphens would end a comment.
        lines += [f"<!-- {line.replace('--', '- -')} -->" for line in remarks]
        lines += ['<material id="1" type="viscoelastic">']
        lines.append(f"  <g0>{series.equilibrium / series.instantaneous:.9g}</g0>")
        for number, (share, time) in enumerate(series.reduced_terms, 1):
            lines += [f"  <g{number}>{share:.9g}</g{number}>", f"  <t{number}>{time:.9g}</t{number}>"]
        lines += [
            "  <!-- Add your instantaneous elastic material here: <elastic type=...> -->",
            "</material>",
        ]
        return "\n".join(lines) + "\n"

    def abaqus(self) -> str:
        """Return the lines ``*VISCOELASTIC, TIME=PRONY`` of Abaqus: gᵢ, kᵢ and τᵢ, with kᵢ = gᵢ."""
        remarks = [
            *self._remarks,
            "Data lines: g_i, k_i, tau_i, for an elastic material with MODULI=INSTANTANEOUS.",
            "k_i = g_i keeps Poisson's ratio constant; for a bulk that does not relax set k_i to 0.",
        ]
        data = [f"{share:.9g}, {share:.9g}, {time:.9g}" for share, time in self.reduced_terms]
        return "\n".join([*(f"** {line}" for line in remarks), "*VISCOELASTIC, TIME=PRONY", *data]) + "\n"


def prony_series(model: FittedModel) -> PronySeries:
    """Return the relaxation of a linear or quasi-linear model after a step.

    Parameters
    ----------
    model : FittedModel
        Continuous model along one axis.

    Raises
    ------
    InputError
        If the model has no Prony series of positive terms.
    """
    structure = model.structure
    reason = _reason_against(structure)
    if isinstance(structure, Structure) and not reason:
        forms = (structure.base.form, *structure.forms)
        parts = [model.values_of(structure.base), *map(model.values_of, structure.forms)]
        numbers = [value for kind in (0, 1) for part in parts for value in part[kind]]
        balance = ForceBalance(forms)
        parameters = dict(zip(balance.parameters, map(float, numbers), strict=True))
        # Near 0, not at 0, where the derivative of a sign is 0.
        near = 1e-9 * (model[LENGTH].value if structure.base.is_quasi_linear else 1.0)
        slopes = _slopes(balance, parameters, near)
        if not structure.base.is_quasi_linear and not _is_linear(balance, parameters, slopes):
            names = ", ".join(structure.effects) or structure.base.name
            reason = f"its force is not linear in the position or depends on time or path ({names})"
        elif structure.base.is_quasi_linear and structure.forms:
            reason = f"{structure.base.name} with {', '.join(structure.effects)} is no elastic response times a relaxation"
        elif np.any(slopes[0, 1:3]):
            reason = (
                "it has a dashpot or a mass without a spring in series, whose force after a step is infinite"
            )
        else:
            series = _relax(slopes)
            if series is not None:
                return PronySeries(model, *series)
            reason = "it does not relax by positive terms"
    raise InputError(f"{model.name} has no Prony series: {reason}")


def _reason_against(structure: Structure | TransferFunction) -> str:
    """Return why models of this kind have no series, or an empty text."""
    if isinstance(structure, TransferFunction):
        return "it is a difference equation; fit the base with 'lumbar refine', whose refined.json has relaxation times"
    base = structure.base
    if base.contact or base.spatial is not None or base.system != "tissue":
        return "only a tissue along one axis that the tool does not leave has one"
    for form in (base.form, *structure.forms):
        if form.place is not Place.PARALLEL or not can_be_simulated(form):
            return f"{form.effect.replace('_', ' ')} is not parallel to the springs and branches"
    return ""


def _slopes(
    balance: ForceBalance, parameters: Mapping[str, float], at: float, others: float = 0.0
) -> np.ndarray:
    """Return derivatives of force and states' rates by z, v, a and states, at a position and other values of all signals."""
    known = {**parameters, **dict.fromkeys(("v", "a", "s", "t", *balance.states), others), "z": at}
    with np.errstate(all="ignore"):
        return balance.slopes(known, ())[1]


def _is_linear(balance: ForceBalance, parameters: Mapping[str, float], slopes: np.ndarray) -> bool:
    """Return whether slopes are the same everywhere, and force and rates are 0 at rest at a later time."""
    rest = {**parameters, **dict.fromkeys(("z", "v", "a", *balance.states), 0.0), "s": 3.0, "t": 7.0}
    with np.errstate(all="ignore"):
        values = balance.values(rest, ())
    moved = [_slopes(balance, parameters, at, others) for at, others in ((0.7, 1.3), (-1.9, 2.7))]
    size = np.abs(slopes).max()
    return bool(
        not values.any() and all(np.abs(item - slopes).max() <= _RELATIVE_ERROR * size for item in moved)
    )


def _relax(slopes: np.ndarray) -> tuple[float, tuple[tuple[float, float], ...]] | None:
    """Return the force long after a step of 1 and the terms that relax; None if a term is not positive, or there is none."""
    by_motion, by_states = slopes[:, :3], slopes[:, 3:]
    rates, force = by_states[1:], by_states[0]
    if not len(rates) or np.any(by_motion[1:, 2]):
        return None
    poles, shapes = np.linalg.eig(rates)
    if np.any(np.abs(poles.imag) > _RELATIVE_ERROR * np.abs(poles)) or np.any(poles.real >= 0):
        return None
    rest = -np.linalg.solve(rates, by_motion[1:, 0])
    weights = (force @ shapes) * np.linalg.solve(shapes, by_motion[1:, 1] - rest)
    equilibrium = float(by_motion[0, 0] + force @ rest)
    size = abs(equilibrium) + np.abs(weights).sum()
    if min(equilibrium, *weights.real) < -_RELATIVE_ERROR * size:
        return None
    pairs = zip(weights.real, -1 / poles.real, strict=True)
    terms = sorted(
        ((float(w), float(t)) for w, t in pairs if w > _RELATIVE_ERROR * size), key=lambda item: item[1]
    )
    return (max(equilibrium, 0.0), tuple(terms)) if terms else None
