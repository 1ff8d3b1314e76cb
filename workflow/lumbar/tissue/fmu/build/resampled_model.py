"""The same model for a faster loop: from the identified rate through continuous time to another one."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.tissue.fmu.build.linear_model import LinearModel

_WHOLE = 1e-6
"""A number of samples this close to a whole one is whole."""


def at_rate(model: LinearModel, sampling_time: float, wanted: float) -> LinearModel:
    """Return the model at another sampling time, exact for a position linear between the old samples.

    The continuous model whose ramp-invariant (first-order hold) discretisation is the identified one is found
    and discretised anew, ramp-invariant again: at the old instants, and for such positions, both give the same.
    G. F. Franklin, J. D. Powell and M. Workman, Digital Control of Dynamic Systems (1998), section 6.3. Leading zeros of
    the numerator are a delay, which stays what it is in seconds.

    A pole that is 0 or negative is that of no continuous model. Such a model runs as many times over as the new rate
    holds the old one, each on the samples of its own clock: H(z^r), r new samples in an old one, which at the old
    instants gives the same for any position (P. P. Vaidyanathan, Multirate Systems and Filter Banks (1993), section 4.2).

    Parameters
    ----------
    sampling_time : float
        Of the identified model, in seconds.
    wanted : float
        Seconds.

    Raises
    ------
    NumericalError
        The wanted rate is slower; or there is no continuous model and the new rate is no multiple of the old one.
    """
    if (model.states == 0 and model.feedthrough) or wanted == sampling_time:
        return model
    if wanted > sampling_time:
        raise NumericalError(
            f"{model.name}: runtime.rate_Hz {1 / wanted:g} is slower than the {1 / sampling_time:g} Hz it was "
            "identified at, where faster motion would fold back; export it with runtime.rate_Hz: null"
        )
    ratio = sampling_time / wanted
    late = next((index for index, value in enumerate(model.numerator) if value != 0.0), 0)
    prompt = replace(model, numerator=model.numerator[late:])
    if not _has_continuous_counterpart(prompt):
        return _several_times_over(model, ratio, sampling_time)
    delay, rest = divmod(late * ratio, 1.0)
    if min(rest, 1.0 - rest) < _WHOLE:
        delay, rest = round(late * ratio), 0.0
    if prompt.states == 0:
        numerator, denominator = (1.0 - rest, rest), (1.0,)
        numerator = tuple(prompt.numerator[0] / prompt.denominator[0] * value for value in numerator)
    else:
        numerator, denominator = _discretised(_continuous(prompt, sampling_time), wanted, rest, model.name)
    return LinearModel(numerator, denominator, model.name, int(delay))


def _has_continuous_counterpart(model: LinearModel) -> bool:
    poles = model.state_space.poles()
    unusable = (np.abs(poles.imag) < 1e-12 * np.abs(poles)) & (poles.real <= 0)
    return not unusable.any() and bool(np.abs(poles).min(initial=1.0) > 0)


def _several_times_over(model: LinearModel, ratio: float, sampling_time: float) -> LinearModel:
    """The model on its own clock, once for every new sample in an old one."""
    if abs(ratio - round(ratio)) > _WHOLE:
        poles = np.array2string(model.state_space.poles(), precision=4)
        raise NumericalError(
            f"{model.name}: its poles {poles} hold one that is 0 or negative, which no continuous model has; it can be "
            f"exported at multiples of its own {1 / sampling_time:g} Hz alone: let runtime.rate_Hz be one, or null"
        )
    return replace(model, phases=round(ratio))


@lru_cache(maxsize=64)
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


def _discretised(continuous: tuple, sampling_time: float, late: float, name: str) -> tuple[tuple, tuple]:
    """Numerator and denominator, ramp-invariant, with the input `late` by a share of a sample.

    The late input is a straight line with a corner at `late` within every sample: two holds, one after the other.
    """
    from scipy.linalg import expm
    from scipy.signal import ss2tf

    a, b, c, d = continuous
    _, at_start, at_corner = _ramp(a, b, late * sampling_time)
    after, from_corner, at_end = _ramp(a, b, (1 - late) * sampling_time)
    # x[k+1] = whole x[k] + newest u[k+1] + new u[k] + old u[k-1]
    whole = expm(a * sampling_time)
    newest = at_end * (1 - late)
    new = after @ (at_start * (1 - late) + at_corner) + from_corner + at_end * late
    old = after @ at_start * late
    # In x − newest u, which needs no later input, and the input before as one more state.
    order = len(a)
    matrix = np.zeros((order + 1, order + 1))
    matrix[:order, :order], matrix[:order, order:] = whole, old
    column = np.vstack([new + whole @ newest, [[1.0]]])
    row = np.hstack([c, d * late])
    numerator, denominator = ss2tf(matrix, column, row, d * (1 - late) + c @ newest)
    if late == 0.0:  # the input before is without effect: both polynomials end in the zero of its state
        numerator, denominator = numerator[:, :-1], denominator[:-1]
    values = (tuple(map(float, numerator[0])), tuple(map(float, denominator)))
    if not all(map(math.isfinite, (*values[0], *values[1]))):
        raise NumericalError(f"{name}: it cannot be discretised anew at {sampling_time:g} s")
    return values


def _ramp(a: np.ndarray, b: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What a state and an input in a straight line become after a time: of the state, the line's begin and its end."""
    from scipy.linalg import expm

    order = len(a)
    block = np.zeros((order + 2, order + 2))
    block[:order, :order], block[:order, order : order + 1] = a * time, b * time
    block[order, order + 1] = 1.0
    grown = expm(block)
    held, rising = grown[:order, order : order + 1], grown[:order, order + 1 :]
    return grown[:order, :order], held - rising, rising
