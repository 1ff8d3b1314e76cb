"""Identification of every model on one record by ridge ARX, as in the thesis, and by output error.

ARX minimises the one-step-ahead error and is biased towards fast poles if the output is noisy, because its regressors contain
the noise. The output-error fit minimises the error of the free run from the input only; it is consistent for any noise that is
independent of the input (Ljung, System Identification, 2nd ed., section 8.4).
"""

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import scipy

from lumbar.base.errors import InputError, NumericalError
from lumbar.records.record import Record, require_same_units
from lumbar.settings.tissue import TissueSettings
from lumbar.tissue.identification.arx_search import (
    ArxCandidate,
    IdentificationData,
    ReducedRegression,
    RidgePath,
    free_run,
    grid_rows,
    one_step_nmse,
    search,
    select,
)
from lumbar.tissue.identification.metrics import block_bootstrap, largest_relative_uncertainty
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.model_data import ARX, GIVEN, OUTPUT_ERROR, FittedParameter, Port, Scores, unit_of
from lumbar.tissue.models.tissue_models import (
    FIXED_STRUCTURE,
    HO,
    IL,
    KB,
    MODELS,
    TissueModel,
    higher_order_structures,
    inverted_linear,
)
from lumbar.tissue.models.transfer_function import ArxStructure, TransferFunction, full_regressors
from lumbar.tissue.signals.spectrum import motion_range

_UNSTABLE_PENALTY = 1e3  # multiple of the output's rms: makes the optimiser take a shorter step
_MAX_START_POLE = 0.995
_START_POLES = (-0.95, -0.5, 0.0, 0.3, 0.6, 0.8, 0.9, 0.97, 0.99, 0.999)
_MAX_STARTS = 3


@dataclass(frozen=True)
class OutputErrorFit:
    """A minimum of the simulation error."""

    coefficients: np.ndarray
    residuals: np.ndarray
    """Measured minus simulated output, shape (samples − skip,)."""
    sensitivities: np.ndarray
    """Derivatives of the simulated output by the coefficients, shape (samples − skip, parameters)."""
    converged: bool
    """False if the optimiser stopped in a nearly flat region, so that the data hardly determine the coefficients."""


def fit_output_error(
    structure: ArxStructure,
    inputs: np.ndarray,
    outputs: np.ndarray,
    starts: list[TransferFunction],
    skip: int,
) -> OutputErrorFit:
    """Minimise the squared simulation error by Levenberg–Marquardt with exact sensitivities.

    `inputs` and `outputs` are demeaned, shape (samples,). The fit begins at the best few of the `starts`, e.g. the ARX
    solution, and returns the lowest minimum of the `structure`. Errors omit the first `skip` samples.

    Raises
    ------
    NumericalError
        If no start leads to a stable model.
    """
    penalty = np.full(len(outputs) - skip, _UNSTABLE_PENALTY * np.sqrt(np.mean(outputs**2)))

    def residuals(coefficients):
        model = structure.transfer_function(coefficients)
        return (model.simulate(inputs) - outputs)[skip:] if model.stable else penalty

    def jacobian(coefficients):
        return simulation_sensitivities(structure, coefficients, inputs)[skip:]

    initials = [structure.coefficients(stabilise(start)) for start in starts]
    initials.sort(key=lambda coefficients: float(np.sum(residuals(coefficients) ** 2)))
    minima = [
        scipy.optimize.least_squares(
            residuals, initial, jac=jacobian, method="lm", x_scale="jac", xtol=1e-10, ftol=1e-12, max_nfev=300
        )
        for initial in initials[:_MAX_STARTS]
    ]
    stable = [minimum for minimum in minima if structure.transfer_function(minimum.x).stable]
    if not stable:
        raise NumericalError("no start of the output-error fit leads to a stable model")
    best = min(stable, key=lambda minimum: minimum.cost)
    return OutputErrorFit(best.x, -best.fun, best.jac, best.status > 0)


def simulation_sensitivities(
    structure: ArxStructure, coefficients: np.ndarray, inputs: np.ndarray
) -> np.ndarray:
    """Differentiate the free run with respect to every free coefficient, shape (samples, parameters).

    With ŷ = (B/A) u: ∂ŷ/∂b_j = z⁻ʲ u/A and ∂ŷ/∂(−a_i) = z⁻ⁱ ŷ/A, all started from rest at the first input.
    """
    model = structure.transfer_function(coefficients)
    inverse = TransferFunction((1.0,), model.denominator)
    filtered_input = inverse.simulate(inputs)
    filtered_output = inverse.simulate(model.simulate(inputs))
    lag = structure.largest_lag
    columns = [_delay(filtered_output, i) for i in range(1, lag + 1)]
    columns += [_delay(filtered_input, j) for j in range(lag + 1)]
    return np.column_stack(columns) @ structure.combination(lag)


def relaxation_starts(
    structure: ArxStructure, inputs: np.ndarray, outputs: np.ndarray, poles: tuple[float, ...] = _START_POLES
) -> list[TransferFunction]:
    """Return models of order 1 with poles spread over (−1, 1), for all relaxation times, each with its best numerator.

    The simulation error of a single-pole model can have several minima over its pole (Eq. 3.3 has), but for a given pole the
    numerator follows from linear least squares.
    """
    if structure.order != 1:
        return []
    lag = structure.largest_lag
    starts = []
    for pole in poles:
        filtered = TransferFunction((1.0,), (1.0, -pole)).simulate(inputs)
        delayed = np.column_stack([_delay(filtered, j) for j in range(lag + 1)])
        numerator, *_ = np.linalg.lstsq(delayed @ structure.combination(lag)[lag:, 1:], outputs)
        starts.append(structure.transfer_function(np.array([pole, *numerator])))
    return starts


def _delay(signal: np.ndarray, samples: int) -> np.ndarray:
    """Delay a signal by a number of samples; before the record it has its first value."""
    return np.concatenate([np.full(samples, signal[0]), signal[: len(signal) - samples]])


def stabilise(model: TransferFunction) -> TransferFunction:
    """Reflect poles outside the unit circle into it, for starting values."""
    if model.stable:
        return model
    poles = model.poles
    outside = np.abs(poles) >= 1.0
    poles[outside] = 1.0 / np.conj(poles[outside])
    size = np.abs(poles)
    poles = np.where(size > _MAX_START_POLE, poles * _MAX_START_POLE / np.maximum(size, 1e-300), poles)
    return TransferFunction(model.numerator, tuple(np.real(np.poly(poles))))


def identify(
    training: Record, tests: list[Record], settings: TissueSettings, seed: int
) -> tuple[list[FittedModel], list[dict]]:
    """Identify LE, MW, Maxwell, KB and HO on one record by both estimators; add the inverted linear model.

    Parameters
    ----------
    training : Record
        Record to fit.
    tests : list of Record
        Unseen records with another excitation, in the order of `Scores.tests`.
    settings : TissueSettings
        Search, ridge coefficients and bootstrap.
    seed : int
        Seed of the bootstrap.

    Returns
    -------
    models : list of FittedModel
        Identified models in the order of Table 3.1.
    grid : list of dict
        One row per point of the search (``tissue/search.csv``).

    Raises
    ------
    InputError
        If records have different units or sampling times, or the training record is too short.
    """
    require_same_units([training, *tests])
    for test in tests:
        if abs(test.sampling_time / training.sampling_time - 1) > 1e-4:
            raise InputError(
                f"{test.name} is sampled at {1 / test.sampling_time:g} Hz, {training.name} at "
                f"{1 / training.sampling_time:g} Hz: a discrete model has one rate; set tissue.rate_Hz"
            )
    data = IdentificationData.from_record(training, settings.settling_s)
    others = [IdentificationData.from_record(test, settings.settling_s) for test in tests]
    rule, lag, ridge = settings.search.selection, settings.search.order_max, settings.ridge
    if rule == "test" and not others:
        raise InputError(
            "tissue.search.selection is 'test', but the study has a single record: use 'training'"
        )
    if len(training) - lag <= 2 * (2 * lag + 1):
        raise InputError(
            f"{training.source or training.name}: {len(training)} samples are too few for order {lag}"
        )
    # The largest regression of the search contains all others; α is 0 or in geometric progression.
    regression = ReducedRegression(data.inputs, data.outputs, lag)
    alphas = np.concatenate([[0.0], np.geomspace(ridge.alpha_min, ridge.alpha_max, ridge.alpha_points)])
    estimators = _Estimators(training, data, others, settings, seed)
    fits, grid, nested = [], [], None
    for model in (*FIXED_STRUCTURE, HO):
        structures = [model.structure] if model.structure else higher_order_structures(lag)
        condition_max = None if model.structure else settings.search.condition_max
        candidates = search(model.name, structures, alphas, regression, data, others)
        chosen, remark = select(candidates, rule, condition_max)
        grid += grid_rows(candidates, chosen, rule, condition_max)
        fits += [estimators.arx(model, chosen, remark), estimators.output_error(model, chosen, nested)]
        if model is KB:
            nested = fits[-1].structure
    inverted = inverted_linear(settings.inverted_linear.force_max, settings.inverted_linear.travel)
    given = FittedModel(
        IL.name,
        inverted,
        data.sampling_time,
        *ports_of(training, 0.0, 0.0),
        base=IL.name,
        estimator=GIVEN,
        trained_on=training.name,
        no_parameters_because=f"{IL.name}: {IL.no_parameters_because}",
        scores=scores_of(inverted, data, others, free_parameters=0, rank=0),
        remark="not identified",
    )
    return [*fits, given], grid


def distinct(models: list[FittedModel]) -> list[FittedModel]:
    """Return the models of several identifications. Given models come last, without duplicates and without scores."""
    fitted = [model for model in models if model.estimator != GIVEN]
    given = {}
    for model in models:
        if model.estimator == GIVEN:
            scores = Scores(free_parameters=model.scores.free_parameters, rank=model.scores.rank)
            given[model.name] = replace(model, trained_on=None, scores=scores)
    return [*fitted, *given.values()]


def ports_of(record: Record, *offsets: float) -> tuple[Port, Port]:
    """Return the input and the output of a record with their values at rest (`offsets`)."""
    channels = zip((record.channels["input"], record.channels["output"]), offsets, strict=True)
    return tuple(Port(channel.quantity, channel.unit, offset) for channel, offset in channels)


def scores_of(
    structure: TransferFunction, data: IdentificationData, tests: list[IdentificationData], **more
) -> Scores:
    """Return the errors of the free run and of the prediction one step ahead; `more` are further fields."""
    trained, tested = free_run(structure, data), [free_run(structure, test) for test in tests]
    return Scores(
        **(trained or {}),
        nmse_train=one_step_nmse(structure, data),
        tests=tuple(test.name for test in tests),
        vaf_tests_percent=tuple(run and run["vaf_percent"] for run in tested),
        nmse_tests=tuple(one_step_nmse(structure, test) for test in tests),
        **more,
    )


@dataclass(frozen=True)
class _Regression:
    """Linear regression that has the coefficients as solution, at a minimum of the output error or with a ridge."""

    path: RidgePath
    regressors: np.ndarray
    target: np.ndarray
    alpha: float | None = None
    """Ridge coefficient of ARX; None for the output error."""


@dataclass(frozen=True)
class _Estimators:
    """Both estimators on one training record."""

    record: Record
    data: IdentificationData
    tests: list[IdentificationData]
    settings: TissueSettings
    seed: int

    def arx(self, model: TissueModel, chosen: ArxCandidate, remark: str) -> FittedModel:
        """Return the selected ridge ARX solution (Eq. 3.8) with its uncertainties."""
        structure, lag = chosen.structure, chosen.structure.largest_lag
        regressors = full_regressors(self.data.inputs, self.data.outputs, lag) @ structure.combination(lag)
        regression = _Regression(chosen.path, regressors, self.data.outputs[lag:], chosen.alpha)
        return self._fitted_model(model, structure, chosen.path.solution(chosen.alpha), regression, remark)

    def output_error(
        self, model: TissueModel, chosen: ArxCandidate, nested: TransferFunction | None
    ) -> FittedModel:
        """Fit the same structure to the free run, starting from ARX and from the simpler model that it contains."""
        structure, inputs, outputs = chosen.structure, self.data.inputs, self.data.outputs
        starts = [chosen.transfer_function, *relaxation_starts(structure, inputs, outputs)]
        if nested is not None and set(KB.structure.input_lags) <= set(structure.input_lags):
            starts.append(nested)
        fit = fit_output_error(structure, inputs, outputs, starts, self.data.skip)
        # Linearised about the minimum, the fit is a regression of the residuals on the sensitivities.
        path = RidgePath.factorise(fit.sensitivities, fit.residuals, len(fit.residuals))
        regression = _Regression(path, fit.sensitivities, fit.residuals)
        remark = "" if fit.converged else "not converged: the record hardly determines the coefficients"
        return self._fitted_model(model, structure, fit.coefficients, regression, remark)

    def _fitted_model(
        self,
        model: TissueModel,
        structure: ArxStructure,
        coefficients: np.ndarray,
        regression: _Regression,
        remark: str,
    ) -> FittedModel:
        """Return one fitted model with its errors, uncertainties and parameters."""
        path, alpha, settings = regression.path, regression.alpha, self.settings.bootstrap
        estimator = OUTPUT_ERROR if alpha is None else ARX
        deviations = path.standard_deviations(alpha or 0.0)
        if deviations is not None:
            deviations = deviations * path.target_scale / path.column_scale
        draws = spread = None
        if path.rank == regression.regressors.shape[1] and settings.resamples:
            stream = [sorted(MODELS).index(model.name), (ARX, OUTPUT_ERROR).index(estimator)]
            rng = np.random.default_rng([self.seed, *stream, *self.data.name.encode()])
            rows = max(1, round(settings.block_s / self.data.sampling_time))
            scaled = regression.regressors / path.column_scale
            draws = block_bootstrap(scaled, regression.target, rows, settings.resamples, rng, alpha or 0.0)
            draws = draws / path.column_scale
            if alpha is None:
                draws = coefficients + draws
            # Half the width of the central 68.27 %: σ of a normal distribution, robust to outliers.
            low, high = np.quantile(draws, [0.158655, 0.841345], axis=0)
            spread = (high - low) / 2.0
        fitted = structure.transfer_function(coefficients)
        if structure.order == 1 and fitted.poles[0] < 0:
            remark = "; ".join(filter(None, [remark, f"negative pole {fitted.poles[0]:.3f}: no relaxation"]))
        parameters, missing = self._parameters(model, structure, fitted, draws)
        return FittedModel(
            model.name,
            fitted,
            self.data.sampling_time,
            *ports_of(self.record, self.data.input_offset, self.data.output_offset),
            base=model.name,
            estimator=estimator,
            trained_on=self.data.name,
            alpha=alpha,
            parameters=parameters,
            no_parameters_because=missing,
            scores=scores_of(
                fitted,
                self.data,
                self.tests,
                free_parameters=structure.parameter_count,
                rank=path.rank,
                condition_number=path.condition_number,
                mru_percent=largest_relative_uncertainty(coefficients, deviations),
                mru_bootstrap_percent=largest_relative_uncertainty(coefficients, spread),
            ),
            remark=remark,
            valid_for=motion_range(self.record["input"], self.data.sampling_time),
        )

    def _parameters(
        self, model: TissueModel, structure: ArxStructure, fitted: TransferFunction, draws: np.ndarray | None
    ) -> tuple[tuple[FittedParameter, ...], str]:
        """Return parameters of the base and elements with bootstrap intervals, or the reason for their absence."""
        step, tail = self.data.sampling_time, (1.0 - self.settings.bootstrap.confidence) / 2.0
        try:
            values = model.physical_parameters(fitted, step)
        except NumericalError as error:
            return (), str(error)
        if draws is None:
            return (), f"{model.name}: not determined by this record (rank deficient)"
        resampled = []
        for draw in draws:
            with suppress(NumericalError):
                resampled.append(model.physical_parameters(structure.transfer_function(draw), step))
        if (lost := len(draws) - len(resampled)) > tail * len(draws):
            reason = f"{lost} of {len(draws)} resamples have no such parameters"
            return (), f"{model.name}: not determined by this record ({reason})"
        units = self.record.channels["input"].unit, self.record.channels["output"].unit
        parameters = []
        for item in (*model.base.linear, *model.base.nonlinear, *model.elements):
            low, high = np.quantile([sample[item.name] for sample in resampled], [tail, 1.0 - tail])
            unit, interval = unit_of(item.unit, *units), (values[item.name], float(low), float(high))
            derived = item in model.elements
            parameters.append(FittedParameter(item.name, item.latex_symbol, unit, *interval, derived=derived))
        return tuple(parameters), ""
