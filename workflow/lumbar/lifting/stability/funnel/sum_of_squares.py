"""V̇/ρ as polynomials in normal coordinates z (`exact_funnel`), and the sum-of-squares programme of one knot for Clarabel.

A polynomial is a vector of coefficients over `monomials`, by increasing total degree; a Taylor polynomial replaces the sine.
The programme (Eqs 4.5 and 4.6, ρ̇ a variable), with v(z) the polynomial of V̇/ρ and d the sine's Taylor degree,

    minimise r  subject to  r − v(z) − L(z)·(1 − |z|²) = b(z)ᵀG·b(z),   G ⪰ 0,   L free of degree d − 1

proves that V̇/ρ ≤ r on V = ρ. The thesis's alternation needs L; a status other than "solved" is never a result.
"""

from functools import cache
from math import factorial

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import NormalForm


def monomials(degree: int) -> list[tuple[int, int]]:
    """Return the exponents of all monomials in two variables up to a degree.

    Parameters
    ----------
    degree : int
        Largest total degree.
    """
    return [(total - second, second) for total in range(degree + 1) for second in range(total + 1)]


def growth_polynomial(form: NormalForm, level: np.ndarray, degree: int) -> np.ndarray:
    """Return the coefficients of V̇/ρ in z in 1/s, shape (..., monomials of degree + 1), by a Taylor polynomial of sin(θ0 + e).

    Parameters
    ----------
    form : NormalForm
        V̇/ρ in normal coordinates, entries of shape (...).
    level : numpy.ndarray, shape (...)
        ρ, dimensionless.
    degree : int
        Degree of the Taylor polynomial.
    """
    index = {exponents: position for position, exponents in enumerate(monomials(degree + 1))}
    coefficients = np.zeros((*np.shape(level), len(index)))
    coefficients[..., index[2, 0]] = -form.alpha
    coefficients[..., index[1, 1]] = -2 * form.beta
    coefficients[..., index[0, 2]] = -form.gamma
    semi_axis, kappa = form.amplitude * np.sqrt(level), form.coupling / np.sqrt(level)
    sine, cosine = np.sin(form.angle), np.cos(form.angle)
    derivatives = (sine, cosine, -sine, -cosine)
    for power in range(2, degree + 1):
        taylor = derivatives[power % 4] / factorial(power)
        coefficients[..., index[power, 1]] = -kappa * taylor * semi_axis**power
    return coefficients


@cache
def harmonics_of_monomials(degree: int) -> np.ndarray:
    """Return the exact matrix from coefficients of monomials to harmonics 1, cos φ, sin φ, …, shape (2·degree + 1, monomials).

    Parameters
    ----------
    degree : int
        Largest total degree.
    """
    samples = 4 * (degree + 1)
    angle = 2 * np.pi * np.arange(samples) / samples
    values = np.stack([np.cos(angle) ** i * np.sin(angle) ** j for i, j in monomials(degree)], axis=1)
    projection = harmonics(degree, angle) * (2 / samples)
    projection[0] /= 2
    unit = 2.0**degree
    return np.round(projection @ values * unit) / unit


def harmonics(order: int, angle: np.ndarray) -> np.ndarray:
    """Return the values of 1, cos φ, sin φ, …, cos nφ, sin nφ, shape (2n + 1, angles).

    Parameters
    ----------
    order : int
        n.
    angle : numpy.ndarray, shape (angles,)
        φ in rad.
    """
    rows = [np.ones_like(angle)]
    for multiple in range(1, order + 1):
        rows += [np.cos(multiple * angle), np.sin(multiple * angle)]
    return np.stack(rows)


NEGLIGIBLE = 1e-8
"""Largest last Newton step in rad to a maximum: the remaining error of the maximum is about the square of the step."""


def circle_maximum(coefficients: np.ndarray, degree: int) -> np.ndarray:
    """Return the largest value on the unit circle, shape (...), by Newton's method from the best sample of each sector.

    Parameters
    ----------
    coefficients : numpy.ndarray, shape (..., monomials)
        Coefficients of polynomials over `monomials`.
    degree : int
        Total degree of the polynomials.
    """
    # The best sample of every part of the circle.
    amplitudes = coefficients @ harmonics_of_monomials(degree).T
    samples, parts = 16 * (degree + 1), 2 * (degree + 1)
    angle = 2 * np.pi * np.arange(samples) / samples
    waves = harmonics(degree, angle)
    values = amplitudes @ waves
    within = values.reshape(*values.shape[:-1], parts, -1).argmax(axis=-1)
    position = angle[within + np.arange(parts) * (samples // parts)]
    # The sum of aₖ cos kφ + bₖ sin kφ is the real part of the sum of cₖzᵏ with cₖ = aₖ − ibₖ and z = exp iφ.
    complex_amplitudes = amplitudes[..., 1::2] - 1j * amplitudes[..., 2::2]
    multiple = np.arange(1, degree + 1)
    first, second = 1j * multiple * complex_amplitudes, -(multiple**2) * complex_amplitudes
    for _ in range(5):
        # Newton step towards the peak, no longer than the distance of two samples.
        powers = _powers(position, degree)
        slope, bend = (np.matmul(powers, part[..., None])[..., 0].real for part in (first, second))
        step = np.where(bend < 0, -slope / np.where(bend < 0, bend, -1.0), 0.0)
        position = position + np.clip(step, -angle[1], angle[1])
        if np.abs(step).max(initial=0.0) < NEGLIGIBLE:
            break
    waves = np.matmul(_powers(position, degree), complex_amplitudes[..., None])[..., 0].real
    return np.maximum(amplitudes[..., 0] + waves.max(axis=-1), values.max(axis=-1))


def _powers(angle: np.ndarray, degree: int) -> np.ndarray:
    """Return z, z², …, zⁿ of z = exp iφ, shape (angles, n)."""
    return np.multiply.accumulate(np.repeat(np.exp(1j * angle)[..., None], degree, axis=-1), axis=-1)


def gram_map(degree: int) -> np.ndarray:
    """Return Γ from scaled upper triangles of G, by columns, to coefficients of bᵀGb, shape (monomials of degree + 1, triangle).

    Parameters
    ----------
    degree : int
        The sine's Taylor degree.
    """
    index = {exponents: position for position, exponents in enumerate(monomials(degree + 1))}
    basis = monomials((degree + 1) // 2)
    triangle = [(row, column) for column in range(len(basis)) for row in range(column + 1)]
    matrix = np.zeros((len(index), len(triangle)))
    for entry, (row, column) in enumerate(triangle):
        exponents = (basis[row][0] + basis[column][0], basis[row][1] + basis[column][1])
        matrix[index[exponents], entry] = 1.0 if row == column else np.sqrt(2.0)
    return matrix


def circle_map(degree: int) -> np.ndarray:
    """Return the matrix, shape (monomials of degree + 1, monomials of degree − 1), from L to L·(1 − |z|²) by coefficients.

    Parameters
    ----------
    degree : int
        The sine's Taylor degree.
    """
    index = {exponents: position for position, exponents in enumerate(monomials(degree + 1))}
    matrix = np.zeros((len(index), len(monomials(degree - 1))))
    for column, (i, j) in enumerate(monomials(degree - 1)):
        matrix[index[i, j], column] += 1.0
        matrix[index[i + 2, j], column] -= 1.0
        matrix[index[i, j + 2], column] -= 1.0
    return matrix


class SumOfSquares:
    """Programme that minimises cᵀy so that polynomials affine in y are sums of squares; one set-up serves many targets.

    In normal form: minimise cᵀy subject to F·y + Σ Γ·g = target, where each g holds the upper triangle, column by
    column, of a positive semidefinite Gram matrix G (off-diagonal entries times √2) and Γ·g the coefficients of bᵀGb
    (Eq. 2.13) in any basis of polynomials.

    Parameters
    ----------
    cost : numpy.ndarray, shape (free,)
        c.
    free : numpy.ndarray, shape (coefficients, free)
        F.
    grams : list of numpy.ndarray, shape (coefficients, triangle)
        Γ of each Gram matrix.
    tolerance : float, default 1e-8
        Tolerance of gaps and residuals.
    """

    def __init__(self, cost: np.ndarray, free: np.ndarray, grams: list[np.ndarray], tolerance: float = 1e-8):
        import clarabel
        from scipy import sparse

        rows = np.hstack([free, *grams])
        self._equations, variables = rows.shape
        self._free = len(cost)
        entries = variables - self._free
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.presolve_enable = False  # otherwise the target cannot be exchanged
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
        # A matrix of size n has n(n + 1)/2 entries.
        sizes = [int(np.sqrt(2 * gram.shape[1])) for gram in grams]
        self._target = np.zeros(self._equations + entries)
        self._solved = clarabel.SolverStatus.Solved
        self._solver = clarabel.DefaultSolver(
            sparse.csc_matrix((variables, variables)),
            np.concatenate([cost, np.zeros(entries)]),
            sparse.csc_matrix(np.vstack([rows, np.eye(variables)[self._free :] * -1.0])),
            self._target,
            [clarabel.ZeroConeT(self._equations), *map(clarabel.PSDTriangleConeT, sizes)],
            settings,
        )
        self.status = ""

    def solve(self, target: np.ndarray) -> np.ndarray | None:
        """Return y, shape (free,), if the solver's status is "solved"; None for any other status, also for "almost solved".

        Parameters
        ----------
        target : numpy.ndarray, shape (coefficients,)
            Right-hand side.
        """
        self._target[: self._equations] = target
        self._solver.update(b=self._target)
        solution = self._solver.solve()
        self.status = str(solution.status)
        return np.array(solution.x[: self._free]) if solution.status == self._solved else None


class Certificate:
    """Eq. 4.6 with ρ given and ρ̇ a variable, for one Taylor degree and many knots.

    Parameters
    ----------
    degree : int
        The sine's Taylor degree.
    accuracy : float, default 1e-8
        Tolerance of the solver.
    """

    def __init__(self, degree: int, accuracy: float = 1e-8):
        constant = np.eye(len(monomials(degree + 1)))[:, :1]
        # r − v − L·(1 − |z|²) = bᵀGb
        free = np.hstack([-constant, circle_map(degree)])
        self._programme = SumOfSquares(np.eye(free.shape[1])[0], free, [gram_map(degree)], accuracy)

    def solve(self, coefficients: np.ndarray, label: str) -> tuple[float, np.ndarray]:
        """Return the smallest certified rate r and the coefficients of L, shape (monomials of degree − 1,), both in 1/s.

        Parameters
        ----------
        coefficients : numpy.ndarray, shape (monomials of degree + 1,)
            v = V̇/ρ in 1/s.
        label : str
            Name of the pendulum, for messages.

        Raises
        ------
        NumericalError
            If the solver does not reach an optimum.
        """
        scale = float(np.abs(coefficients).max())
        solution = self._programme.solve(-coefficients / scale)
        if solution is None:
            raise NumericalError(
                f"{label}: the sum-of-squares programme ended as {self._programme.status}", label
            )
        return float(solution[0]) * scale, solution[1:] * scale
