"""What the parameters of a fitted model can take up of a signal, and what is left of it.

To first order a refit moves the simulation within the tangent space of the model, the span of its sensitivities; only
what lies outside tells another model from it (Bates and Watts, Nonlinear Regression Analysis, 1988, chapter 2).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, linear_with_new
from lumbar.tissue.diagnosis.fitting.uncertainty import sensitivities
from lumbar.tissue.models.form import Form, Place
from lumbar.tissue.models.structure import forces_of

_SMALLEST = 1e-9
"""Directions whose singular value is below this share of the largest are rounding."""


def tangent_basis(fit: Fit, records: list[FitData]) -> np.ndarray:
    """Orthonormal basis of the tangent space over all samples that count of these records, one record after another.

    Returns
    -------
    numpy.ndarray, shape (samples, directions)
    """
    columns = np.concatenate([sensitivities(fit, record) for record in records])
    size = np.sqrt(np.sum(columns**2, axis=0))
    left, values, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    return left[:, values > _SMALLEST * values[0]]


def beyond(basis: np.ndarray, signals: np.ndarray) -> np.ndarray:
    """Part of signals (samples first) that is orthogonal to a basis."""
    return signals - basis @ (basis.T @ signals)


def simulated_over(fit: Fit, records: list[FitData]) -> np.ndarray:
    """Whitened free run over all samples that count of these records, one record after another."""
    return np.concatenate([record.counted(fit.simulate(record.motion)) for record in records])


def added_forces(fit: Fit, form: Form, data: FitData, start: np.ndarray) -> np.ndarray:
    """Whitened forces that a form adds, one per amplitude; of forms without linear parameters the change it makes."""
    if form.place is Place.PARALLEL:
        return data.counted(forces_of(form, data.motion, start))
    structure, linear = fit.structure.with_form(form), linear_with_new(fit, form)
    changed = replace(
        fit, structure=structure, linear=linear, nonlinear=np.concatenate([fit.nonlinear, start])
    )
    return data.counted(changed.simulate(data.motion) - fit.simulate(data.motion))[:, None]
