"""Passive models: fits of springs next to Maxwell branches with stiffnesses of 0 or more, and their cost in %VAF.

Such a network takes energy at every frequency and can be discretised at every rate. For given relaxation times the error of the
free run is quadratic in the stiffnesses: the best fit is a convex programme. The condition that a device is passive with the
averaged, held and delayed force too (`lumbar.tissue.haptics.ticks`) is a second-order cone at every frequency. The sampled
admittance of hand and device is −(1 − exp(−jωT))/T · Σₙ exp(−jωₙτ) Yₙ/ωₙ², ωₙ = ω + 2πn/T, for forces late by a part τ of the
sampling time, and every Yₙ may lie anywhere in the disc of centre and radius 1/(2b). The loop has no pole for any of them if
|2b − L S(τ)| > |L| S(0), with L = (1 − exp(−jωT)) H/T and S(τ) = Σₙ exp(−jωₙτ)/ωₙ²: with p + jq = L S(τ) and r = S(0)/|S(τ)|
p + √(r² p² + (r² − 1) q²) ≤ 2b, and L is linear in the stiffnesses.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import clarabel
import numpy as np
import scipy

from lumbar.base.errors import NumericalError
from lumbar.base.files import write_json
from lumbar.records.record import Record
from lumbar.settings.runtime import RuntimeSettings
from lumbar.tables.table import Table, table_from_schema
from lumbar.tissue.haptics.closed_loop import SampledModel, all_angles
from lumbar.tissue.haptics.device_table import device_text, finite
from lumbar.tissue.haptics.loop_verdict import LoopAnalysis, analyse
from lumbar.tissue.haptics.rendered_model import export_at, is_renderable, render_model, scale_of
from lumbar.tissue.identification.arx_search import IdentificationData
from lumbar.tissue.identification.identify_tissue import ports_of, scores_of
from lumbar.tissue.models.fitted_model import FittedModel, models_document
from lumbar.tissue.models.model_data import ARX, OUTPUT_ERROR
from lumbar.tissue.models.transfer_function import TransferFunction
from lumbar.tissue.signals.spectrum import motion_range

_MAX_RELAXATION_S, _RELAXATION_TIMES = 20.0, 25
"""Longest relaxation time, and number of times from half a sample to it."""
_ANGLES = 120
_NEGLIGIBLE_SHARE = 1e-4
"""Share of the largest stiffness below which a branch is omitted."""
_DAMPING_RESERVE = 2e-3
"""Reserve as a share of the device's damping: cones exist at some frequencies only, and the solver has a tolerance."""
_ROUNDING = 1e-9
PASSIVE = "passive"
"""Name of the estimator of passive fits."""
_STRUCTURES = {"LE": (True, 0), "Maxwell": (False, 1), "KB": (True, 1), "HO": (True, None)}
"""By model: True if there is a spring, and the number of Maxwell branches (None: as many as the data require)."""
_FREE_FITS = {ARX: "free, ridge ARX", OUTPUT_ERROR: "free, output error"}


@dataclass(frozen=True)
class Branches:
    """A network of a spring and Maxwell branches in parallel."""

    stiffnesses: tuple[float, ...]
    """Stiffness of each branch, in output unit per input unit."""
    times: tuple[float, ...]
    """Relaxation time of each branch in seconds; infinite for the spring."""

    def transfer_function(self, sampling_time: float) -> TransferFunction:
        """Return the ramp-invariant transfer function at a sampling time in seconds."""
        poles = [float(np.exp(-sampling_time / time)) for time in self.times if np.isfinite(time)]
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


def unit_branch(time: float, sampling_time: float) -> TransferFunction:
    """Return a branch of stiffness 1: τ/T (1 − a)(1 − z⁻¹)/(1 − a z⁻¹) with a = exp(−T/τ), or 1 for the spring (τ = ∞)."""
    if not np.isfinite(time):
        return TransferFunction((1.0,))
    share = -np.expm1(-sampling_time / time) * time / sampling_time
    return TransferFunction((share, -share), (1.0, -float(np.exp(-sampling_time / time))))


def _response(model: TransferFunction, angles: np.ndarray) -> np.ndarray:
    return SampledModel("", np.array(model.numerator), np.array(model.denominator), 1.0).response(angles)


@dataclass(frozen=True)
class DeviceCondition:
    """The condition of a device on the force that it renders."""

    damping: float
    """Damping of the device, N·s/m."""
    rendering: SampledModel
    """A unit spring as the device renders it, with average, rate and delay, in N/m."""

    def columns(self, times: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        """Return L S(τ) of every branch at every angle, complex, shape (angles, branches); and S(0)/|S(τ)|, shape (angles,)."""
        angles, period, delay = all_angles(_ANGLES), self.rendering.sampling_time, self.rendering.delay
        forward = np.exp(1j * angles)
        in_time = period**2 / (2.0 * (1.0 - np.cos(angles)))
        late = in_time.astype(complex)
        if delay:
            # −T times the transform of max(kT − τ, 0), a double integrator sampled late.
            late = -period * (period * forward / (forward - 1.0) ** 2 - delay / (forward - 1.0))
        hold = self.rendering.response(angles) * (1.0 - np.exp(-1j * angles)) / period * late
        responses = [_response(unit_branch(time, period), angles) for time in times]
        return hold[:, None] * np.column_stack(responses), in_time / np.abs(late)


def fit_branches(
    data: IdentificationData, times: Sequence[float], condition: DeviceCondition | None = None
) -> tuple[Branches, float]:
    """Fit stiffnesses for given relaxation times to the free run; return those above 0 and the sum of the squared errors.

    Times are in seconds, infinite for the spring. With a condition, the device that renders the model is passive too.

    Raises
    ------
    NumericalError
        If the solver does not solve the programme.
    """
    regressors = np.column_stack(
        [unit_branch(time, data.sampling_time).simulate(data.inputs) for time in times]
    )[data.skip :]
    # Minimise ‖R k − q‖² subject to k ≥ 0 and the cones of the device.
    orthonormal, factor = np.linalg.qr(regressors)
    projected = orthonormal.T @ data.outputs[data.skip :]
    # The solver's tolerances are absolute: scale the stiffnesses to similar sizes.
    size = np.linalg.norm(factor, axis=0)
    scaled, count = factor / size, len(size)
    rows, bounds, cones = [-np.eye(count)], [np.zeros(count)], [clarabel.NonnegativeConeT(count)]
    if condition is not None:
        values, ratio = condition.columns(times)
        for value, r in zip(values / size / condition.damping, ratio, strict=True):
            # (2 − p, r p, √(r² − 1) q) is in the cone; p and q are per unit of the device's damping.
            imaginary = -np.sqrt(max(r * r - 1.0, 0.0)) * value.imag
            rows.append(np.vstack([value.real, -r * value.real, imaginary]))
            bounds.append(np.array([2.0 * (1.0 - _DAMPING_RESERVE), 0.0, 0.0]))
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
    solution = solver.solve()
    if solution.status not in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved):
        raise NumericalError(f"the passive fit is not solved: {solution.status}")
    stiffnesses = np.maximum(np.array(solution.x), 0.0) / size
    used = stiffnesses > _NEGLIGIBLE_SHARE * stiffnesses.max(initial=0.0)
    error = data.outputs[data.skip :] - regressors[:, used] @ stiffnesses[used]
    branches = Branches(tuple(stiffnesses[used].tolist()), tuple(np.array(times)[used].tolist()))
    return branches, float(error @ error)


def fit_passive(
    data: IdentificationData, spring: bool, branches: int | None, condition: DeviceCondition | None = None
) -> Branches:
    """Fit a passive model with or without a spring, relaxation times included.

    The model has 0 or 1 Maxwell branch with the best relaxation time, or (None) as many branches as the data require.
    """
    first = [np.inf] if spring else []
    times = np.geomspace(data.sampling_time / 2.0, _MAX_RELAXATION_S, _RELAXATION_TIMES)
    if branches == 0:
        return fit_branches(data, first, condition)[0]
    if branches is None:
        return fit_branches(data, [*first, *times], condition)[0]

    def error(logarithm: float) -> float:
        return fit_branches(data, [*first, float(np.exp(logarithm))], condition)[1]

    coarse = np.log(times[::2])
    best = int(np.argmin([error(logarithm) for logarithm in coarse]))
    ends = coarse[max(best - 1, 0)], coarse[min(best + 1, len(coarse) - 1)]
    minimum = scipy.optimize.minimize_scalar(error, bounds=ends, method="bounded", options={"xatol": 1e-4})
    return fit_branches(data, [*first, float(np.exp(minimum.x))], condition)[0]


@dataclass(frozen=True)
class PassiveFits:
    """Free and passive fits of one record."""

    free: tuple[FittedModel, ...]
    """Identified models, by both estimators."""
    passive: tuple[FittedModel, ...]
    """Models ``<model>-passive``, and ``<model>-passive-<rate>Hz``, with which the device too is passive at this rate."""
    settings: RuntimeSettings
    rates: tuple[float, float]
    """Rate of identification and rate of the servo, in Hz."""

    def table(self, source_label: str) -> Table:
        """Return the table model × (free, passive); `source_label` is the source of the records."""
        rows = []
        for name in dict.fromkeys(model.name for model in self.free):
            free = {model.estimator: model for model in self.free if model.name == name}
            best = free[OUTPUT_ERROR].scores.vaf_percent if OUTPUT_ERROR in free else None
            for estimator, model in free.items():
                fit = _FREE_FITS.get(estimator, estimator)
                rows.append(self._row(name, fit, "as identified", model, best))
            for model in self.passive:
                base, _, ending = model.name.partition(f"-{PASSIVE}")
                if base == name:
                    fit = f"{PASSIVE}{f' on the device at {ending[1:]}' if ending else ''}"
                    rows.append(self._row(name, fit, model.remark, model, best))
            if name not in _STRUCTURES and OUTPUT_ERROR in free:
                row = {"model": name, "fit": PASSIVE, "consists_of": "none but 0", "takes_energy": "yes"}
                rows.append({**row, "vaf_percent": 0.0, "vaf_cost": best})
        slow, servo = self.rates
        facts = {"device": device_text(self.settings.device), "own": slow, "servo": servo}
        return table_from_schema("tissue/haptics", "passive_fits", rows, source_label, facts)

    def _row(self, name: str, fit: str, consists_of: str, model: FittedModel, best: float | None) -> dict:
        vaf, estimator = model.scores.vaf_percent, model.estimator
        tests = [value for value in model.scores.vaf_tests_percent if value is not None]
        analyses: list[LoopAnalysis | None] = []
        for rate in self.rates if is_renderable(model) else ():
            try:
                device, exported = self.settings.device, export_at(model, self.settings, rate)
                analyses.append(analyse(render_model(exported, device), device))
            except NumericalError:  # no counterpart at this rate
                analyses.append(None)
        slow, servo = analyses or (None, None)
        return {
            "model": name,
            "fit": fit,
            "consists_of": consists_of,
            "takes_energy": "yes" if takes_energy(model.structure) else "NO",
            "vaf_percent": vaf,
            "vaf_cost": None if None in (best, vaf) or estimator == ARX else round(best - vaf, 6) + 0.0,
            "vaf_tests_percent": float(np.mean(tests)) if tests else None,
            "damping_at_own_rate_N_s_m": slow and finite(slow.damping),
            "damping_at_servo_rate_N_s_m": servo and finite(servo.damping),
            "gain_at_servo_rate": servo and finite(servo.gain),
        }

    def save(self, folder: Path, source_label: str) -> None:
        """Write ``passive_models.json`` and the table ``passive_fits``."""
        write_json(folder / "passive_models.json", models_document(self.passive, source_label))
        self.table(source_label).write(folder / "passive_fits")

    def __str__(self) -> str:
        return "\n".join(
            f"{model.name}: {model.scores.vaf_percent:.1f} %VAF, {model.remark}" for model in self.passive
        )


def fit_passive_models(
    models: Sequence[FittedModel],
    records: Sequence[Record],
    train: str,
    settings: RuntimeSettings,
    settling_s: float | None,
) -> PassiveFits:
    """Fit the exported models again as passive models.

    Fits for the device are omitted if the records are not of a length and a force.

    Parameters
    ----------
    models : sequence of FittedModel
        Identified models.
    records : sequence of Record
        Records that the models were identified on.
    train : str
        Name of the record to fit on.
    settings : RuntimeSettings
        Settings; only ``models``, moving average and device are used.
    settling_s : float or None
        Seconds at the start of each record that do not count; None for the default.
    """
    free = tuple(
        model
        for model in models
        if model.discrete and model.trained_on == train and model.name in settings.models
    )
    training = next(record for record in records if record.name == train)
    data = IdentificationData.from_record(training, settling_s)
    tests = [
        IdentificationData.from_record(record, settling_s) for record in records if record is not training
    ]
    device = settings.device
    rates = (slower := 1.0 / training.sampling_time, max(slower, device.rate_Hz))
    position, force = ports_of(training, data.input_offset, data.output_offset)

    def fitted(name: str, branches: Branches) -> FittedModel:
        structure = branches.transfer_function(data.sampling_time)
        return FittedModel(
            name=name,
            structure=structure,
            sampling_time=data.sampling_time,
            input=position,
            output=force,
            estimator=PASSIVE,
            trained_on=train,
            no_parameters_because=f"springs in parallel: {branches}",
            scores=scores_of(structure, data, tests),
            remark=str(branches),
            valid_for=motion_range(training["input"], data.sampling_time),
        )

    passive = []
    for name in dict.fromkeys(model.name for model in free if model.name in _STRUCTURES):
        branches = fit_passive(data, *_STRUCTURES[name])
        plain = fitted(f"{name}-{PASSIVE}", branches)
        passive.append(plain)
        for rate in dict.fromkeys(rates if is_renderable(plain) else ()):
            exported = export_at(plain, settings.model_copy(update={"output_rate_limit": None}), rate)
            safe = branches
            if not analyse(render_model(exported, device), device).passive:
                # A static force of 1 per unit of position, as the device renders it at this rate.
                metre, newton = scale_of(plain)
                average = np.full(exported.moving_average, newton / metre / exported.moving_average)
                rendering = SampledModel("", average, np.ones(1), 1.0 / rate).late(1e-3 * device.delay_ms)
                condition = DeviceCondition(device.damping_N_s_m, rendering)
                safe = fit_passive(data, *_STRUCTURES[name], condition)
            passive.append(fitted(f"{name}-{PASSIVE}-{rate:.4g}Hz", safe))
    return PassiveFits(free, tuple(passive), settings, rates)


def takes_energy(structure: TransferFunction) -> bool:
    """Return whether a discrete model takes energy at every frequency: H(1) ≥ 0, and Im H(exp(jωT)) ≥ 0 for 0 < ωT < π.

    If the work between two samples is the mean of their forces times the displacement, a sine of amplitude 1 does the work
    π Im H in a cycle; a spring with a negative stiffness would release energy without end.
    """
    response = _response(structure, all_angles())
    rounding = _ROUNDING * np.abs(response).max()
    return bool(
        structure.stable and structure.static_gain >= -rounding and (response.imag >= -rounding).all()
    )
