"""Whether a record excites an effect that is to be added."""

from __future__ import annotations

import numpy as np

from lumbar.base.errors import InputError
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.sensitivity_subspace import added_forces, beyond, tangent_basis
from lumbar.tissue.models.form import Form


def check_excited(without: Fit, form: Form, data: FitData, nonlinear: np.ndarray, name: str) -> None:
    """Refuse an effect that the training record does not excite.

    That is so where a force as large as the whole response would change the model's error by less than the noise: the 95 %
    interval of the effect's size then holds everything.

    Parameters
    ----------
    without : Fit
        The model without the effect.
    data : FitData
        Training record.
    nonlinear : numpy.ndarray
        Of the form.
    name : str
        Name of the model, for the message.
    """
    basis = tangent_basis(without, [data])
    forces = added_forces(without, form, data, nonlinear)
    size, left = np.sum(forces**2, axis=0), np.sum(beyond(basis, forces) ** 2, axis=0)
    error = without.squared_error / data.size
    response = float(np.var(data.settled(data.force)))
    # An effect of RMS r adds N r² left/size to the squared error; noise hides 1.96² of its own variance.
    hidden = (size == 0) | (left * data.size * response <= 1.96**2 * error * size)
    if np.all(hidden):
        raise InputError(
            f"{data.name}: the record does not excite {form.effect}: added to {name} it could be as large as the whole response "
            "without being seen; leave it out, or train on a record that shows it"
        )
