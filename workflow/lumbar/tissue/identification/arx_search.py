"""The exhaustive search of the thesis over structures and ridge coefficients (Eqs 3.6–3.9), judged by the free run.

One factorisation serves every order and every α. The full regressor matrix, with all lags up to the largest order of the
search, is reduced to the triangular factor R of a QR decomposition. The regressors of a smaller structure are combinations of
its columns, so that a structure has the singular values of a small matrix made from R, and each α costs one product with it.

Scaling. Input and output are demeaned. Every column of A, and b, is then divided by its root mean square, so that condition
number and α do not depend on units. α enters as in Eq. 3.7, ‖Ax − b‖² + α²‖x‖², with these columns (norm √N).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.records.record import Record
from lumbar.tissue.identification.metrics import free_run_errors, settling_time
from lumbar.tissue.models.transfer_function import ArxStructure, TransferFunction, full_regressors


@dataclass(frozen=True)
class IdentificationData:
    """Demeaned input and output of one record, shape (samples,)."""

    name: str
    inputs: np.ndarray
    outputs: np.ndarray
    input_offset: float
    """Mean that was subtracted from the input."""
    output_offset: float
    """Mean that was subtracted from the output."""
    sampling_time: float
    """Sampling time in seconds."""
    skip: int
    """Number of samples at the start that free-run errors omit."""

    @classmethod
    def from_record(cls, record: Record, settling_s: float | None = None) -> Self:
        """Demean a record with the channels ``input`` and ``output``; errors omit its first seconds (`settling_time`).

        Raises
        ------
        InputError
            If no samples, or no changes of the signals, remain after the settling time.
        """
        settling, name = settling_time(record, settling_s), record.source or record.name
        skip = round(settling / record.sampling_time)
        if len(record) - skip < 2:
            raise InputError(
                f"{name}: {record.duration:g} s long, but the first {settling:.3g} s (tissue.settling_s) do not count; record "
                "for longer or shorten it"
            )
        for role in ("input", "output"):
            if np.ptp(record[role][skip:]) == 0:
                raise InputError(
                    f"{name}: the {role} does not move after the first {settling:.3g} s (tissue.settling_s), which do not "
                    "count; shorten it or cut the record"
                )
        signals = record["input"], record["output"]
        demeaned, offsets = (
            [item - item.mean() for item in signals],
            [float(item.mean()) for item in signals],
        )
        return cls(record.name, *demeaned, *offsets, record.sampling_time, skip)


def free_run(model: TransferFunction, data: IdentificationData) -> dict[str, float] | None:
    """Return the errors after the settling time (Eqs 3.10–3.12); None for an unstable model, which has no free run."""
    if not model.stable:
        return None
    return free_run_errors(data.outputs[data.skip :], model.simulate(data.inputs)[data.skip :])


def one_step_nmse(model: TransferFunction, data: IdentificationData) -> float:
    """Return the NMSE of Eq. 3.13: ‖b − A x‖²/‖b‖² of the one-step-ahead prediction A x."""
    measured = data.outputs[model.largest_lag :]
    predicted = model.predict_one_step(data.inputs, data.outputs)
    return float(np.sum((measured - predicted) ** 2) / np.sum(measured**2))


class ReducedRegression:
    """The full ARX regression of one record, reduced to its triangular factor.

    Parameters
    ----------
    inputs, outputs : numpy.ndarray, shape (samples,)
        Demeaned signals.
    lag : int
        Largest lag of any structure.
    """

    def __init__(self, inputs: np.ndarray, outputs: np.ndarray, lag: int):
        self.lag = lag
        regressors = full_regressors(inputs, outputs, lag)
        target = outputs[lag:]
        self.rows = len(target)
        triangular = np.linalg.qr(np.column_stack([regressors, target]), mode="r")
        self._regressors, self._target = triangular[:, :-1], triangular[:, -1]

    def path(self, structure: ArxStructure) -> "RidgePath":
        """Return the decomposition for the ridge solutions of one structure."""
        regressors = self._regressors @ structure.combination(self.lag)
        return RidgePath.factorise(regressors, self._target, self.rows)


@dataclass(frozen=True)
class RidgePath:
    """Singular value decomposition of a standardised regression: ridge solutions for any α."""

    column_scale: np.ndarray
    """Root mean square by which each column was divided, shape (parameters,)."""
    target_scale: float
    """Root mean square of the target."""
    singular_values: np.ndarray
    """Singular values of the standardised A in descending order, shape (parameters,)."""
    rows: int
    """Number of equations, N − largest lag."""
    _right: np.ndarray
    _projected_target: np.ndarray
    _target_norm_squared: float

    @classmethod
    def factorise(cls, regressors: np.ndarray, target: np.ndarray, rows: int) -> "RidgePath":
        """Standardise and decompose a regression.

        `regressors` is A, shape (any, parameters), or a matrix with the same AᵀA; `target` is b, or a vector with the same Aᵀb
        and norm; `rows` is the number of rows of the actual A.
        """
        column_scale = np.linalg.norm(regressors, axis=0) / np.sqrt(rows)
        column_scale = np.where(column_scale > 0, column_scale, 1.0)
        target_scale = float(np.linalg.norm(target) / np.sqrt(rows))
        left, singular_values, right = np.linalg.svd(regressors / column_scale, full_matrices=False)
        target = target / target_scale
        projected, norm_squared = left.T @ target, float(target @ target)
        return cls(column_scale, target_scale, singular_values, rows, right, projected, norm_squared)

    @cached_property
    def rank(self) -> int:
        """Numerical rank of A, by the rule of `numpy.linalg.matrix_rank`."""
        values = self.singular_values
        tolerance = max(self.rows, values.size) * np.finfo(float).eps * values.max()
        return int((values > tolerance).sum())

    @property
    def condition_number(self) -> float | None:
        """cond(A) of Eq. 3.14 with standardised columns; None if A is rank deficient."""
        values = self.singular_values
        return None if self.rank < values.size else float(values.max() / values.min())

    def standardised_solution(self, alpha: float) -> np.ndarray:
        """Return the solution of Eq. 3.8 in standardised coefficients; if A is rank deficient, the solution of least norm."""
        values = self.singular_values[: self.rank]
        filtered = values / (values**2 + alpha**2) * self._projected_target[: self.rank]
        return self._right[: self.rank].T @ filtered

    def solution(self, alpha: float) -> np.ndarray:
        """Return the minimiser of Eq. 3.7 with ridge coefficient α ≥ 0, the solution of Eq. 3.8, in the units of the signals."""
        return self.standardised_solution(alpha) * self.target_scale / self.column_scale

    def residual_sum_of_squares(self, alpha: float) -> float:
        """Return ‖b − A x‖² with b standardised (its squared norm is N)."""
        rotated = self._right @ self.standardised_solution(alpha)
        inside = self._projected_target - self.singular_values * rotated
        outside = self._target_norm_squared - self._projected_target @ self._projected_target
        return float(inside @ inside + max(outside, 0.0))

    def standard_deviations(self, alpha: float) -> np.ndarray | None:
        """Return σ_i of Eq. 3.15 in standardised coefficients; None if AᵀA has no inverse.

        It is biased if the regressors have noise, as measured past outputs do: see `lumbar.tissue.identification.metrics`.
        """
        freedom = self.rows - self.singular_values.size
        if self.rank < self.singular_values.size or freedom <= 0:
            return None
        inverse_diagonal = np.sum((self._right / self.singular_values[:, None]) ** 2, axis=0)
        return np.sqrt(self.residual_sum_of_squares(alpha) / freedom * inverse_diagonal)


NEGLIGIBLE_POINTS = 0.1
"""Difference in %VAF up to which a lower order is as good; neither a hand nor a second record distinguishes the two."""


@dataclass(frozen=True, eq=False)
class ArxCandidate:
    """One point of the grid: a structure with one ridge coefficient; equal only to itself."""

    model: str
    structure: ArxStructure
    alpha: float
    path: RidgePath
    data: IdentificationData
    """Training record."""
    tests: Sequence[IdentificationData]

    @cached_property
    def transfer_function(self) -> TransferFunction:
        """The fitted model."""
        return self.structure.transfer_function(self.path.solution(self.alpha))

    @cached_property
    def training(self) -> dict[str, float] | None:
        """Errors on the training record; None for an unstable model."""
        return free_run(self.transfer_function, self.data)

    @cached_property
    def test_vaf_percent(self) -> float | None:
        """Mean %VAF of the free runs on the other records; None if there are no other records."""
        if not self.stable or not self.tests:
            return None
        runs = [free_run(self.transfer_function, test) for test in self.tests]
        return float(np.mean([run["vaf_percent"] for run in runs]))

    @property
    def stable(self) -> bool:
        """True if the candidate's model is stable, so that it has a free run."""
        return self.transfer_function.stable

    @property
    def condition(self) -> float:
        """Condition number of the candidate's regressors; ∞ if they are rank deficient."""
        return self.path.condition_number or np.inf

    def score(self, selection: str) -> float:
        """Return the %VAF for the selection of the candidate; −∞ if there is none."""
        if selection == "training":
            return -np.inf if self.training is None else self.training["vaf_percent"]
        return -np.inf if self.test_vaf_percent is None else self.test_vaf_percent


def search(
    model: str,
    structures: Iterable[ArxStructure],
    alphas: np.ndarray,
    regression: ReducedRegression,
    training: IdentificationData,
    tests: list[IdentificationData],
) -> list[ArxCandidate]:
    """Fit every structure with every α by ridge ARX; each candidate is simulated at the first use of its free run."""
    paths = [(structure, regression.path(structure)) for structure in structures]
    return [
        ArxCandidate(model, structure, alpha, path, training, tests)
        for structure, path in paths
        for alpha in alphas.tolist()
    ]


def eligible(candidates: list[ArxCandidate], condition_max: float | None) -> list[ArxCandidate]:
    """Return the stable candidates with reasonable conditioning; if there are none, those of the best conditioned structure."""
    stable = [item for item in candidates if item.stable]
    within = [item for item in stable if condition_max is None or item.condition <= condition_max]
    best = min((item.condition for item in stable), default=None)
    return within or [item for item in stable if item.condition == best]


def select(
    candidates: list[ArxCandidate], selection: str, condition_max: float | None
) -> tuple[ArxCandidate, str]:
    """Return the well-conditioned candidate with the highest %VAF, and a remark on it or an empty text.

    Parameters
    ----------
    candidates : list of ArxCandidate
        Candidates of one model.
    selection : str
        ``"training"``: %VAF of the free run on the training record, as in the thesis;
        ``"test"``: mean %VAF of the free runs on the other records.
    condition_max : float or None
        Largest condition number; None if the structure is given.

    Raises
    ------
    NumericalError
        If the list is empty.
    """
    if not candidates:
        raise NumericalError("nothing to select from")
    choice = eligible(candidates, condition_max)
    if not choice:
        return candidates[0], "unstable for every alpha"
    chosen = max(choice, key=lambda candidate: candidate.score(selection))
    if condition_max is not None and chosen.condition > condition_max:
        remark = f"every structure exceeds condition_max {condition_max:g}: the best conditioned one is shown"
        return chosen, remark
    order, orders = chosen.structure.order, {candidate.structure.order for candidate in choice}
    least = chosen.score(selection) - NEGLIGIBLE_POINTS
    near = min(item.structure.order for item in choice if item.score(selection) >= least)
    remarks = {
        "largest alpha of the grid": chosen.alpha == max(candidate.alpha for candidate in candidates),
        "highest order of the grid": order == max(orders) > min(orders),
        f"order {near} comes within {NEGLIGIBLE_POINTS:g} points of %VAF": near < order,
    }
    return chosen, "; ".join(remark for remark, applies in remarks.items() if applies)


def grid_rows(
    candidates: list[ArxCandidate], chosen: ArxCandidate, selection: str, condition_max: float | None
) -> list[dict]:
    """Return the rows of one model in ``tissue/search.csv``; None for a number that does not exist.

    Only `eligible` candidates have free runs; on other records, unless these decide the selection, only the best α per
    structure.
    """
    choice = eligible(candidates, condition_max)
    best = {item.structure: item for item in sorted(choice, key=lambda item: item.score(selection))}
    simulated = set(choice)
    tested = simulated if selection == "test" else set(best.values())
    rows = []
    for item in candidates:
        errors = dict.fromkeys(("vaf_percent", "fit_percent", "mean_residual"))
        if item in simulated and item.training:
            errors |= item.training
        rows.append(
            {
                "trained_on": item.data.name,
                "model": item.model,
                "order": item.structure.order,
                "input_lag_first": item.structure.input_lags[0],
                "input_lag_last": item.structure.input_lags[-1],
                "alpha": item.alpha,
                "parameters": item.structure.parameter_count,
                "rank": item.path.rank,
                "condition_number": item.path.condition_number,
                "stable": item.stable,
                **errors,
                "test_vaf_percent": item.test_vaf_percent if item in tested else None,
                "nmse_train": item.path.residual_sum_of_squares(item.alpha) / item.path.rows,
                "selected": item is chosen,
            }
        )
    return rows
