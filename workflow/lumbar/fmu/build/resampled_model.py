"""The same model for a faster loop: from the identified rate through continuous time to another one."""

from __future__ import annotations

import math

import numpy as np

from lumbar.errors import NumericalError
from lumbar.fmu.build.linear_model import LinearModel


def at_rate(model: LinearModel, sampling_time: float, wanted: float) -> LinearModel:
    """Return the model at another sampling time, exact for a position linear between the old samples.

    The continuous model whose ramp-invariant (first-order hold) discretisation is the identified one is found
    and discretised anew, ramp-invariant again: at the old instants, and for such positions, both give the same.
    G. F. Franklin, J. D. Powell and M. Workman, Digital Control of Dynamic Systems (1998), section 6.3.

    Parameters
    ----------
    model : LinearModel
    sampling_time : float
        Of the identified model, in seconds.
    wanted : float
        Seconds.

    Returns
    -------
    LinearModel

    Raises
    ------
    NumericalError
        There is no continuous model: a pole is 0 or negative, or the model's numerator begins with a delay of
        whole samples, which belongs to the rate it was identified at; or the wanted rate is slower.
    """
    if model.states == 0 or wanted == sampling_time:
        return model
    advice = "export it with runtime.rate_Hz: null, or identify it at the faster rate"
    if wanted > sampling_time:
        raise NumericalError(
            f"{model.name}: runtime.rate_Hz {1 / wanted:g} is slower than the {1 / sampling_time:g} Hz it was "
            f"identified at, where faster motion would fold back; {advice.split(',')[0]}"
        )
    if not model.feedthrough:
        raise NumericalError(
            f"{model.name}: its force is a whole sample of {sampling_time:g} s late (numerator[0] is 0); a delay of "
            f"samples has no counterpart at another rate: {advice}"
        )
    poles = model.state_space.poles()
    unusable = poles[(np.abs(poles.imag) < 1e-12 * np.abs(poles)) & (poles.real <= 0)]
    if len(unusable) or not np.abs(poles).min() > 0:
        raise NumericalError(
            f"{model.name}: its poles {np.array2string(poles, precision=4)} hold one that is 0 or negative; no "
            f"continuous model has it: {advice}"
        )
    return _discretised(_continuous(model, sampling_time), wanted, model.name)


def _continuous(model: LinearModel, sampling_time: float) -> tuple[np.ndarray, ...]:
    """Continuous state space whose ramp-invariant discretisation at this sampling time is the model."""
    from scipy.linalg import logm
    from scipy.signal import cont2discrete

    system, identity = model.state_space, np.eye(model.states)
    a = np.real(logm(system.A)) / sampling_time
    # What the hold makes of an input matrix is linear in it: shown by that of the identity.
    _, hold, _, through, _ = cont2discrete((a, identity, identity, 0 * identity), sampling_time, method="foh")
    b = np.linalg.solve(hold, system.B)
    return a, b, system.C, system.D - system.C @ through @ b


def _discretised(continuous: tuple, sampling_time: float, name: str) -> LinearModel:
    from scipy.signal import cont2discrete, ss2tf

    *discrete, _ = cont2discrete(continuous, sampling_time, method="foh")
    numerator, denominator = ss2tf(*discrete)
    values = (tuple(map(float, numerator[0])), tuple(map(float, denominator)))
    if not all(map(math.isfinite, (*values[0], *values[1]))):
        raise NumericalError(f"{name}: it cannot be discretised anew at {sampling_time:g} s")
    return LinearModel(*values, name=name)
