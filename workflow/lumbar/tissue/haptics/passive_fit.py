"""Identification within the passive models: a spring beside Maxwell branches, with stiffnesses of 0 or more.

Such a network takes energy at every frequency and can be had at every rate. For given relaxation times the error of the
free run is quadratic in the stiffnesses: the best fit is a convex programme. That a device shall be passive with the
averaged, held and delayed force too (`lumbar.tissue.haptics.passivity`) is a second-order cone at every frequency. The sampled
admittance of hand and device is −(1 − exp(−jωT))/T · Σₙ exp(−jωₙτ) Yₙ/ωₙ², ωₙ = ω + 2πn/T, for forces late by a part τ of the
sampling time, and every Yₙ may lie anywhere in the disc of centre and radius 1/(2b). The loop has no pole for any of them where
|2b − L S(τ)| > |L| S(0), with L = (1 − exp(−jωT)) H/T and S(τ) = Σₙ exp(−jωₙτ)/ωₙ²: with p + jq = L S(τ) and r = S(0)/|S(τ)|
p + √(r² p² + (r² − 1) q²) ≤ 2b, and L is linear in the stiffnesses.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import clarabel
import numpy as np
import scipy

from lumbar.base.errors import NumericalError
from lumbar.tissue.haptics.closed_loop import SampledModel, all_angles
from lumbar.tissue.identification.arx_search import IdentificationData
from lumbar.tissue.models.transfer_function import TransferFunction

SLOWEST_S, TIMES = 20.0, 25
"""Relaxation times that are tried: from half a sample up to these seconds."""
_ANGLES = 120
_NEGLIGIBLE = 1e-4
"""Share of the largest stiffness below which a branch is left out."""
_MARGIN = 2e-3
"""Share of the device's damping that is kept back: the cones are laid at some frequencies, to a solver's tolerance."""


@dataclass(frozen=True)
class Branches:
    """A spring beside Maxwell branches."""

    stiffnesses: tuple[float, ...]
    """Output unit per input unit."""
    times: tuple[float, ...]
    """Relaxation times in seconds; infinite for the spring."""

    def transfer_function(self, sampling_time: float) -> TransferFunction:
        """The ramp-invariant transfer function at a sampling time in seconds."""
        poles = [_pole(time, sampling_time) for time in self.times if np.isfinite(time)]
        numerator = np.zeros(len(poles) + 1)
        for stiffness, time in zip(self.stiffnesses, self.times, strict=True):
            branch = unit_branch(time, sampling_time)
            others = [pole for pole in poles if pole != -branch.denominator[-1]]
            numerator += stiffness * np.convolve(branch.numerator, np.atleast_1d(np.poly(others)))
        return TransferFunction(tuple(numerator), tuple(np.atleast_1d(np.poly(poles))))

    def __str__(self) -> str:
        return " + ".join(
            f"{stiffness:.3g} relaxing in {time:.3g} s" if np.isfinite(time) else f"spring of {stiffness:.3g}"
            for stiffness, time in zip(self.stiffnesses, self.times, strict=True)
        )


def _pole(time: float, sampling_time: float) -> float:
    return float(np.exp(-sampling_time / time))


def unit_branch(time: float, sampling_time: float) -> TransferFunction:
    """Return a branch of stiffness 1: τ/T (1 − a)(1 − z⁻¹)/(1 − a z⁻¹) with a = exp(−T/τ), or 1 for the spring."""
    if not np.isfinite(time):
        return TransferFunction((1.0,))
    share = -np.expm1(-sampling_time / time) * time / sampling_time
    return TransferFunction((share, -share), (1.0, -_pole(time, sampling_time)))


def alias_sums(model: SampledModel, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """S(0) and S(τ) of the condition at every angle, in s²; shapes of `angles`."""
    period, forward = model.sampling_time, np.exp(1j * angles)
    in_time = period**2 / (2.0 * (1.0 - np.cos(angles)))
    if not model.delay:
        return in_time, in_time.astype(complex)
    # −T times the transform of max(kT − τ, 0), a double integrator sampled late.
    return in_time, -period * (period * forward / (forward - 1.0) ** 2 - model.delay / (forward - 1.0))


@dataclass(frozen=True)
class DeviceCondition:
    """What a device asks of the force that it renders."""

    damping: float
    """Of the device, N·s/m."""
    rendering: SampledModel
    """How a static force of 1 per unit of position would be rendered: average, rate, delay, in N/m."""

    def columns(self, times: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        """L S(τ) of every branch at every angle, complex, shape (angles, branches); and S(0)/|S(τ)|, shape (angles,)."""
        angles, period = all_angles(_ANGLES), self.rendering.sampling_time
        in_time, late = alias_sums(self.rendering, angles)
        held = self.rendering.response(angles) * (1.0 - np.exp(-1j * angles)) / period * late
        branches = [SampledModel.of("", unit_branch(time, period), period) for time in times]
        responses = [branch.response(angles) for branch in branches]
        return held[:, None] * np.column_stack(responses), in_time / np.abs(late)


def fit_branches(
    data: IdentificationData, times: Sequence[float], condition: DeviceCondition | None = None
) -> tuple[Branches, float]:
    """Fit the stiffnesses for given relaxation times to the free run: those above 0, and the sum of the squared errors.

    Parameters
    ----------
    times : sequence of float
        Seconds; infinite for the spring.
    condition : DeviceCondition, optional
        Without it the model is passive; with it the device that renders it, too.

    Raises
    ------
    NumericalError
        If the solver does not solve the programme.
    """
    regressors = np.column_stack(
        [unit_branch(time, data.sampling_time).simulate(data.inputs) for time in times]
    )[data.skip :]
    reduced, target = np.linalg.qr(regressors)
    projected = reduced.T @ data.outputs[data.skip :]
    stiffnesses = _solve(
        target, projected, condition and condition.columns(times), condition and condition.damping
    )
    kept = stiffnesses > _NEGLIGIBLE * stiffnesses.max(initial=0.0)
    chosen = Branches(tuple(stiffnesses[kept].tolist()), tuple(np.array(times)[kept].tolist()))
    error = data.outputs[data.skip :] - regressors[:, kept] @ stiffnesses[kept]
    return chosen, float(error @ error)


def _solve(factor: np.ndarray, projected: np.ndarray, columns, damping: float | None) -> np.ndarray:
    """Minimise ‖R k − q‖² subject to k ≥ 0 and the cones of the device."""
    count = factor.shape[1]
    size = np.linalg.norm(factor, axis=0)  # stiffnesses of like size: the solver's tolerances are absolute
    scaled = factor / size
    rows, bounds, cones = [-np.eye(count)], [np.zeros(count)], [clarabel.NonnegativeConeT(count)]
    if columns is not None:
        values, ratio = columns
        values = values / size / damping
        for value, r in zip(values, ratio, strict=True):
            # (2 − p, r p, √(r² − 1) q) in the cone; p and q per unit of the device's damping.
            rows.append(
                np.vstack([value.real, -r * value.real, -np.sqrt(max(r * r - 1.0, 0.0)) * value.imag])
            )
            bounds.append(np.array([2.0 * (1.0 - _MARGIN), 0.0, 0.0]))
            cones.append(clarabel.SecondOrderConeT(3))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solver = clarabel.DefaultSolver(
        scipy.sparse.csc_matrix(np.triu(scaled.T @ scaled)),
        -scaled.T @ projected,
        scipy.sparse.csc_matrix(np.vstack(rows)),
        np.concatenate(bounds),
        cones,
        settings,
    )
    found = solver.solve()
    if found.status not in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved):
        raise NumericalError(f"the passive fit is not solved: {found.status}")
    return np.maximum(np.array(found.x), 0.0) / size


def fit_passive(
    data: IdentificationData, spring: bool, branches: int | None, condition: DeviceCondition | None = None
) -> Branches:
    """Fit the passive model of a structure, relaxation times included.

    Parameters
    ----------
    branches : int or None
        0 or 1 Maxwell branch with the best relaxation time; None for as many as the data ask for.
    """
    beside = [np.inf] if spring else []
    times = np.geomspace(data.sampling_time / 2.0, SLOWEST_S, TIMES)
    if branches == 0:
        return fit_branches(data, beside, condition)[0]
    if branches is None:
        return fit_branches(data, [*beside, *times], condition)[0]

    def error(logarithm: float) -> float:
        return fit_branches(data, [*beside, float(np.exp(logarithm))], condition)[1]

    coarse = np.log(times[::2])
    best = int(np.argmin([error(logarithm) for logarithm in coarse]))
    ends = coarse[max(best - 1, 0)], coarse[min(best + 1, len(coarse) - 1)]
    found = scipy.optimize.minimize_scalar(error, bounds=ends, method="bounded", options={"xatol": 1e-4})
    return fit_branches(data, [*beside, float(np.exp(found.x))], condition)[0]
