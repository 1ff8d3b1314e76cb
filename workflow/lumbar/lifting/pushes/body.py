"""A body of three links on flat feet in the sagittal plane: equations of motion, energy, force on the ground.

Links are legs (ankle to hip), trunk with head (hip to shoulder) and arms with the box (shoulder to box), each at an
angle θ from straight up, forward positive. With a_ki the way from joint i to the centre of link k along link i,
A = Σ_k m_k·a_ki·a_kj (+ I_i on the diagonal) and B_i = Σ_k m_k·a_ki, Lagrange's equations are

    Σ_j A_ij·cos(θi − θj)·θ̈j + Σ_j A_ij·sin(θi − θj)·θ̇j² − g·B_i·sin θi = Q_i

A torque τ of a joint acts forward on the link above it and backward on the one below: Q = Pᵀτ, as joint angles are
φ = Pθ. The feet are flat and without mass; the centre of pressure follows from the forces between feet and ground.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LINKS = ("legs", "trunk", "arms")
GRAVITY = 9.81
JOINT_ANGLES = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
"""P of φ = Pθ."""


@dataclass(frozen=True)
class Bodies:
    """Bodies that are computed together; the last axis counts bodies."""

    inertia: np.ndarray
    """Shape (3, 3, bodies): A in kg·m²."""
    first_moment: np.ndarray
    """Shape (3, bodies): B in kg·m."""
    mass: np.ndarray
    """Shape (bodies,): all links and the box, without the feet, in kg."""
    lengths: np.ndarray
    """Shape (3, bodies): of the links, in m."""
    ankle_height: np.ndarray
    """Shape (bodies,): of the ankles above the ground, in m."""

    def take(self, index: np.ndarray) -> Bodies:
        """Return some of the bodies, or one of them several times."""
        return Bodies(*(getattr(self, name)[..., index] for name in self.__dataclass_fields__))


def bodies_of_links(masses, centres, lengths, inertias, ankle_height) -> Bodies:
    """Put links together, in SI units; all but the ankles' height have shape (3, bodies), centres count from the lower joint."""
    masses, centres, lengths, inertias = (
        np.asarray(item, dtype=float) for item in (masses, centres, lengths, inertias)
    )
    # a[k, i]: how far link i carries the centre of link k.
    reach = np.stack(
        [
            [lengths[i] if i < k else centres[k] if i == k else 0 * masses[k] for i in range(3)]
            for k in range(3)
        ]
    )
    inertia = np.einsum("kn,kin,kjn->ijn", masses, reach, reach)
    inertia[range(3), range(3)] += inertias
    return Bodies(
        inertia,
        np.einsum("kn,kin->in", masses, reach),
        masses.sum(axis=0),
        lengths,
        np.asarray(ankle_height, dtype=float),
    )


def mass_matrix(bodies: Bodies, angle: np.ndarray) -> np.ndarray:
    """Return M(θ) in kg·m², shape (3, 3, bodies), for angles of shape (3, bodies)."""
    s, c = np.sin(angle), np.cos(angle)
    return bodies.inertia * (c[:, None] * c + s[:, None] * s)


def centrifugal(bodies: Bodies, angle: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return Σ_j A_ij·sin(θi − θj)·θ̇j² in N·m, shape (3, bodies)."""
    s, c, squared = np.sin(angle), np.cos(angle), rate**2
    pulled = [(bodies.inertia * part).sum(axis=1) for part in (c * squared, s * squared)]
    return s * pulled[0] - c * pulled[1]


def weight_torque(bodies: Bodies, angle: np.ndarray) -> np.ndarray:
    """Return g·B·sin θ in N·m, shape (3, bodies): what gravity pulls each link over with."""
    return GRAVITY * bodies.first_moment * np.sin(angle)


def solve(matrix: np.ndarray, *right: np.ndarray) -> list[np.ndarray]:
    """Solve symmetric 3×3 systems by cofactors; matrix of shape (3, 3, n), each right side (3, n)."""
    (a, b, c), (_, d, e), (_, _, f) = matrix
    c00, c01, c02 = d * f - e * e, c * e - b * f, b * e - c * d
    c11, c12, c22 = a * f - c * c, b * c - a * e, a * d - b * b
    scale = 1 / (a * c00 + b * c01 + c * c02)
    cofactors = (c00, c01, c02), (c01, c11, c12), (c02, c12, c22)
    return [scale * np.stack([p * x + q * y + r * z for p, q, r in cofactors]) for x, y, z in right]


def inverse_dynamics(bodies: Bodies, angle, rate, acceleration) -> np.ndarray:
    """Return the joint torques in N·m that a motion takes, shape (3, bodies): ankle, hip, shoulder."""
    generalised = (
        np.einsum("ijn,jn->in", mass_matrix(bodies, angle), acceleration)
        + centrifugal(bodies, angle, rate)
        - weight_torque(bodies, angle)
    )
    # Q = Pᵀτ from the top down: every joint carries what is above it.
    return np.cumsum(generalised[::-1], axis=0)[::-1]


def centre_of_mass(bodies: Bodies, angle: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return x, z, ẋ, ż of the centre of mass from the ankles, each of shape (bodies,); m and m/s."""
    s, c = np.sin(angle), np.cos(angle)
    share = bodies.first_moment / bodies.mass
    return (
        (share * s).sum(axis=0),
        (share * c).sum(axis=0),
        (share * c * rate).sum(axis=0),
        -(share * s * rate).sum(axis=0),
    )


def ground_force(bodies: Bodies, angle, rate, acceleration, push=0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return the ground's horizontal and vertical force on the feet in N, each of shape (bodies,).

    Angles, rates and accelerations have shape (3, bodies); `push` is a horizontal force on the body in N.
    """
    s, c = np.sin(angle), np.cos(angle)
    moment = bodies.first_moment
    horizontal = (moment * (c * acceleration - s * rate**2)).sum(axis=0) - push
    vertical = bodies.mass * GRAVITY - (moment * (s * acceleration + c * rate**2)).sum(axis=0)
    return horizontal, vertical


def centre_of_pressure(bodies: Bodies, ankle_torque, horizontal, vertical) -> np.ndarray:
    """Return how far ahead of the ankles the ground's force acts, in m: −(τ + h·F_x)/F_z."""
    return -(ankle_torque + bodies.ankle_height * horizontal) / vertical


def push_torque(bodies: Bodies, angle: np.ndarray, force: np.ndarray, share: float) -> np.ndarray:
    """Return what a horizontal force on the trunk does to each link, shape (3, bodies), in N·m.

    The force in N, forward positive, has shape (bodies,) and acts at this share of the way from hips to shoulders.
    """
    lever = np.stack([bodies.lengths[0], share * bodies.lengths[1], 0 * bodies.mass])
    return force * lever * np.cos(angle)
