"""Linear dynamics from force to motion behind a sensor that is not linear: it gives the absolute value, or clips."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy

from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, add, from_log_ratio
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.linear.linear_dynamics import LinearDynamics, linear_dynamics, rational_of_order
from lumbar.tissue.diagnosis.linear.poles import Poles, forces
from lumbar.tissue.diagnosis.selection.candidate import Candidate, evaluate
from lumbar.tissue.models.bases import Base
from lumbar.tissue.models.form import Form, HandWritten, LinearParameter, NonlinearParameter, Place
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.structure import Structure

ORDERS = (1, 2, 3, 4)
"""Orders of the dynamics that are tried."""
_FIRST_ORDER = 3
"""Order with which the sign is found: one that is too low finds another."""
_NEVER_BELOW = 0.03
"""Share of its range by which an absolute value may lie below 0: noise."""
_NEAR_ZERO = 0.1
"""Share of its range within which an absolute value comes to 0."""
_LAGS = 8
"""Time constants of the first guess of the sign."""
_TURNS = 15
_WIDE = 1e3
"""How far from its start a pole may be searched, as a factor."""
_EVALUATIONS = 60


def sensor_candidates(
    experiment: Experiment, forms: dict[str, tuple[Form, ...]]
) -> list[tuple[Candidate, Candidate]]:
    """Linear dynamics and the same behind each effect of the sensor, refitted together.

    In the experiment the force stands as motion and the motion as force; `forms` are by effect. Pairs are without and
    with the sensor's effect, the dynamics of the same order, as the likelihood of all records asks.
    """
    found = []
    for name, own in forms.items():
        for form in own:
            fits = _behind_absolute_value if name == "absolute_value" else _behind
            pairs = fits(experiment, form)
            if pairs:
                found.append(min(pairs, key=lambda pair: pair[1].score))
    return found


def _behind_absolute_value(experiment: Experiment, form: Form) -> list[tuple[Candidate, Candidate]]:
    """Every order: the sign of the motion is guessed, dynamics are fitted, their sign is the next guess."""
    training = experiment.training
    low, reach = float(training.force.min()), float(np.ptp(training.force))
    if not -_NEVER_BELOW * reach <= low <= _NEAR_ZERO * reach:
        return []  # it is no absolute value
    settled = [_settled_signs(training, start, _FIRST_ORDER) for start in _first_signs(training)]

    def squared_error(simulated: np.ndarray) -> float:
        error = training.whiten(np.abs(simulated) - training.force)
        return float(error @ error)

    sign = _sign(min((dynamics.simulate(training.motion) for dynamics in settled), key=squared_error))
    pairs = []
    for order in ORDERS:
        dynamics = _settled_signs(training, sign, order)
        sign = _sign(dynamics.simulate(training.motion))
        pairs.append(_pair(experiment, dynamics, rational_of_order(training, order), form))
    return pairs


def _first_signs(training: FitData) -> list[np.ndarray]:
    """Signs of the force after lags from a few samples to a tenth of the record."""
    step = training.motion.sampling_time
    force = training.motion.position
    found = []
    for lag in np.geomspace(4 * step, 0.1 * len(training.motion) * step, _LAGS):
        pole = np.exp(-step / lag)
        found.append(_sign(scipy.signal.lfilter([1 - pole], [1, -pole], force)))
    return found


def _sign(signal: np.ndarray) -> np.ndarray:
    return np.where(signal >= 0, 1.0, -1.0)


def _settled_signs(training: FitData, sign: np.ndarray, order: int) -> LinearDynamics:
    """Fit dynamics until they give the signs that they were fitted to."""
    for _ in range(_TURNS):
        dynamics = rational_of_order(replace(training, force=sign * training.force), order)
        last, sign = sign, _sign(dynamics.simulate(training.motion))
        if np.array_equal(sign, last):
            break
    return dynamics


def _behind(experiment: Experiment, form: Form) -> list[tuple[Candidate, Candidate]]:
    """Dynamics of the order that the sensor's own signal asks for, then both together."""
    plain = linear_dynamics(experiment)
    if plain.kind != "rational":
        return []
    before = _fit_of(_base_of(plain), plain, experiment.training)
    if not len(before.nonlinear):
        return []
    return [(evaluate(before, experiment), evaluate(add(before, form, experiment.training), experiment))]


def _pair(
    experiment: Experiment, dynamics: LinearDynamics, plain: LinearDynamics, form: Form
) -> tuple[Candidate, Candidate]:
    before = evaluate(_fit_of(_base_of(plain), plain, experiment.training), experiment)
    behind = Structure(_base_of(dynamics), (form,))
    after = evaluate(_refined(behind, dynamics, experiment.training), experiment)
    return before, after


def _fit_of(base: Base, dynamics: LinearDynamics, data: FitData) -> Fit:
    fit = Fit(Structure(base), dynamics.linear, np.exp(dynamics.poles.to_vector()), np.inf)
    error = fit.whitened_errors(data)
    return replace(fit, squared_error=float(error @ error))


def _refined(structure: Structure, dynamics: LinearDynamics, data: FitData) -> Fit:
    """Poles and residues together, from a start at which the motion's sign is known."""
    count, poles = len(dynamics.linear), np.exp(dynamics.poles.to_vector())
    reach = np.sqrt(np.mean(forces(data.motion, dynamics.poles, dynamics.held) ** 2, axis=0))
    reach[reach == 0] = 1.0
    shares = np.abs(dynamics.linear) * reach
    size = np.maximum(shares, 1e-3 * shares.max()) / reach
    unit = float(np.linalg.norm(data.force)) or 1.0

    def parameters(vector):
        return vector[:count] * size, from_log_ratio(vector[count:], poles)

    def error(vector):
        return data.whiten(structure.simulate(data.motion, *parameters(vector)) - data.force) / unit

    start = np.concatenate([dynamics.linear / size, np.ones(len(poles))])
    found = scipy.optimize.least_squares(error, start, x_scale="jac", gtol=1e-15, max_nfev=_EVALUATIONS)
    linear, nonlinear = parameters(found.x)
    return Fit(structure, linear, nonlinear, 2 * float(found.cost) * unit**2, bool(found.status > 0))


def _base_of(dynamics: LinearDynamics) -> Base:
    """Linear dynamics as a base: residues are linear parameters, poles nonlinear ones."""
    poles, held = dynamics.poles, dynamics.held
    direct = (
        "constant",
        "direct_gain",
        *(("gain_of_last",) if held else ("gain_of_rate", "gain_of_acceleration")),
    )
    direct = direct[: poles.direct]
    units = ("{y}", "{y}/{x}", "{y}/{x}" if held else "{y} s/{x}", "{y} s^2/{x}")
    gains = [*zip(direct, units, strict=False)]
    gains += [(f"residue_{number + 1}", "{y}/{x}") for number in range(poles.order)]
    rates = [
        (f"{name}_{number + 1}", unit)
        for number in range(len(poles.sections))
        for name, unit in (("section_damping", "1/s"), ("section_stiffness", "1/s^2"))
    ]
    rates += [(f"rate_{number + 1}", "1/s") for number in range(len(poles.rates))]
    values = np.exp(poles.to_vector())
    form = Form(
        name=f"linear-{poles.order}",
        equation=rf"\text{{linear dynamics of {poles.order} poles}}",
        place=Place.PARALLEL,
        linear=tuple(
            LinearParameter(name, unit, 0, symbol=f"c{index}") for index, (name, unit) in enumerate(gains)
        ),
        nonlinear=tuple(
            NonlinearParameter(
                name, unit, "one", value, value, 1, reach=(1 / _WIDE, _WIDE), symbol=f"p{index}"
            )
            for index, ((name, unit), value) in enumerate(zip(rates, values, strict=True))
        ),
        hand_written=HandWritten(columns=_columns(poles, held)),
        effect="base",
    )
    return Base(form, sensor_zero=False)


def _columns(poles: Poles, held: bool) -> Callable[[Motion, np.ndarray], list[np.ndarray]]:
    return lambda motion, nonlinear: list(forces(motion, poles.moved_to(np.log(nonlinear)), held).T)
