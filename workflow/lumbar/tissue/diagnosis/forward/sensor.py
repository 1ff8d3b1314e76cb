"""Linear dynamics from force to motion, with a nonlinear sensor that returns the absolute value or clips."""

from dataclasses import replace

import numpy as np
import scipy

from lumbar.base.formats import plural
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, add, from_log_ratio
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.linear.linear_dynamics import LinearDynamics, linear_dynamics, rational_of_order
from lumbar.tissue.diagnosis.linear.poles import forces
from lumbar.tissue.diagnosis.selection.candidate import Candidate, evaluate
from lumbar.tissue.models.bases import Base
from lumbar.tissue.models.form import Form, HandWritten, LinearParameter, NonlinearParameter, Place
from lumbar.tissue.models.structure import Structure

_ORDERS = (1, 2, 3, 4)
"""Orders of the dynamics that are tried."""
_SIGN_ORDER = 3
"""Order with which the sign of the motion is searched; a lower order gives wrong signs."""
_MAX_NEGATIVE = 0.03
"""Largest negative value of an absolute value, due to noise, as a share of its range."""
_MAX_MINIMUM = 0.1
"""Largest minimum of an absolute value as a share of its range."""
_LAGS = 8
"""Number of time constants of the first guess of the sign."""
_MAX_SIGN_FITS = 15
_POLE_RANGE = 1e3
"""Factor by which a pole may differ from its start."""
_EVALUATIONS = 60


def sensor_candidates(
    experiment: Experiment, forms: dict[str, tuple[Form, ...]]
) -> list[tuple[Candidate, Candidate]]:
    """Fit linear dynamics without and with each effect of the motion's sensor.

    In the experiment the force replaces the motion and the motion the force. `forms` has the forms by effect. Both dynamics of a
    pair have the same order, which has the best score.
    """
    candidates = []
    for name, effect_forms in forms.items():
        for form in effect_forms:
            if name == "absolute_value":
                pairs = _fit_absolute_value(experiment, form)
                candidates += [min(pairs, key=lambda pair: pair[1].score)] if pairs else []
                continue
            # Dynamics of the order that the sensor's signal requires, then dynamics and sensor together.
            dynamics, training = linear_dynamics(experiment), experiment.training
            if dynamics.kind == "rational" and dynamics.order:
                before = _to_fit(dynamics, training)
                both = evaluate(add(before, form, training), experiment)
                candidates.append((evaluate(before, experiment), both))
    return candidates


def _fit_absolute_value(experiment: Experiment, form: Form) -> list[tuple[Candidate, Candidate]]:
    """Fit dynamics of every order with a guess of the motion's sign; the sign of the fitted motion is the next guess."""
    training = experiment.training
    low, span = float(training.force.min()), float(np.ptp(training.force))
    if not -_MAX_NEGATIVE * span <= low <= _MAX_MINIMUM * span:
        return []  # not an absolute value
    # First guesses: signs of the force after lags from a few samples to a tenth of the record.
    step, fits = training.motion.sampling_time, []
    for lag in np.geomspace(4 * step, 0.1 * len(training.motion) * step, _LAGS):
        pole = np.exp(-step / lag)
        sign = _sign(scipy.signal.lfilter([1 - pole], [1, -pole], training.motion.position))
        fits.append(_fit_with_sign(training, sign, _SIGN_ORDER))

    def squared_error(simulated: np.ndarray) -> float:
        error = training.whiten(np.abs(simulated) - training.force)
        return float(error @ error)

    sign = _sign(min((dynamics.simulate(training.motion) for dynamics in fits), key=squared_error))
    pairs = []
    for order in _ORDERS:
        dynamics = _fit_with_sign(training, sign, order)
        sign = _sign(dynamics.simulate(training.motion))
        without = _to_fit(rational_of_order(training, order), training)
        both = _refine_all(Structure(_to_base(dynamics), (form,)), dynamics, training)
        pairs.append((evaluate(without, experiment), evaluate(both, experiment)))
    return pairs


def _sign(signal: np.ndarray) -> np.ndarray:
    return np.where(signal >= 0, 1.0, -1.0)


def _fit_with_sign(training: FitData, sign: np.ndarray, order: int) -> LinearDynamics:
    """Fit dynamics again until the signs of their motion do not change."""
    for _ in range(_MAX_SIGN_FITS):
        dynamics = rational_of_order(replace(training, force=sign * training.force), order)
        last, sign = sign, _sign(dynamics.simulate(training.motion))
        if np.array_equal(sign, last):
            break
    return dynamics


def _to_fit(dynamics: LinearDynamics, data: FitData) -> Fit:
    fit = Fit(Structure(_to_base(dynamics)), dynamics.linear, dynamics.nonlinear, np.inf)
    error = fit.whitened_errors(data)
    return replace(fit, squared_error=float(error @ error))


def _refine_all(structure: Structure, dynamics: LinearDynamics, data: FitData) -> Fit:
    """Refine poles and residues together, from dynamics with the right sign of the motion."""
    count, poles = len(dynamics.linear), dynamics.nonlinear
    rms = np.sqrt(np.mean(forces(data.motion, dynamics.poles, dynamics.held) ** 2, axis=0))
    rms[rms == 0] = 1.0
    shares = np.abs(dynamics.linear) * rms
    size = np.maximum(shares, 1e-3 * shares.max()) / rms
    unit = float(np.linalg.norm(data.force)) or 1.0

    def parameters(vector):
        return vector[:count] * size, from_log_ratio(vector[count:], poles)

    def error(vector):
        return data.whiten(structure.simulate(data.motion, *parameters(vector)) - data.force) / unit

    start = np.concatenate([dynamics.linear / size, np.ones(len(poles))])
    result = scipy.optimize.least_squares(error, start, x_scale="jac", gtol=1e-15, max_nfev=_EVALUATIONS)
    return Fit(structure, *parameters(result.x), 2 * float(result.cost) * unit**2, bool(result.status > 0))


def _to_base(dynamics: LinearDynamics) -> Base:
    """Return linear dynamics as a base, with the residues as linear parameters and the poles as nonlinear parameters."""
    poles, held = dynamics.poles, dynamics.held
    of_rates = [("gain_of_rate", "{y} s/{x}"), ("gain_of_acceleration", "{y} s^2/{x}")]
    gains = [("constant", "{y}"), ("direct_gain", "{y}/{x}")]
    gains = [*gains, *([("gain_of_last", "{y}/{x}")] if held else of_rates)][: poles.direct]
    gains += [(f"residue_{number + 1}", "{y}/{x}") for number in range(poles.order)]
    rates = [
        (f"{name}_{number + 1}", unit)
        for number in range(len(poles.sections))
        for name, unit in (("section_damping", "1/s"), ("section_stiffness", "1/s^2"))
    ]
    rates += [(f"rate_{number + 1}", "1/s") for number in range(len(poles.rates))]
    form = Form(
        name=f"linear-{poles.order}",
        equation=rf"\text{{linear dynamics of {plural(poles.order, 'pole')}}}",
        place=Place.PARALLEL,
        linear=tuple(
            LinearParameter(name, unit, 0, symbol=f"c{index}") for index, (name, unit) in enumerate(gains)
        ),
        nonlinear=tuple(
            NonlinearParameter(
                name, unit, "one", value, value, 1, reach=(1 / _POLE_RANGE, _POLE_RANGE), symbol=f"p{index}"
            )
            for index, ((name, unit), value) in enumerate(zip(rates, dynamics.nonlinear, strict=True))
        ),
        hand_written=HandWritten(
            columns=lambda motion, nonlinear: list(forces(motion, poles.moved_to(np.log(nonlinear)), held).T)
        ),
        effect="base",
    )
    return Base(form, sensor_zero=False)
