"""The simulator of the cases in space against a scalar integration and the law of contact."""

import numpy as np
import pytest
from make_cases import CASES, draw_motions, draw_tissue, draw_truth
from scipy.integrate import solve_ivp
from space_motions import OVERSAMPLING, Motion, from_lines
from space_tissue import measured_force, tissue_force

SEED = 7


def _truth(name: str) -> tuple[dict, Motion]:
    rng = np.random.default_rng([SEED, len(name)])
    motion = draw_motions(rng, CASES[name])["loops"]
    return draw_truth(rng, CASES[name], motion), motion


def test_along_a_principal_axis_the_tissue_is_a_scalar_one():
    rng = np.random.default_rng(2)
    tissue = draw_tissue(rng, {"base": "KB", "symmetry": "orthotropic"}, 3)
    axis = np.array(tissue["K_e_axes"])[:, 1]
    elastic, relaxing = tissue["K_e_principal"][1], tissue["K_1_principal"][1]
    effects = {
        "coulomb_friction": {"Fc": 0.3, "vs": 1.0},
        "hysteresis": {"Fh": 0.4, "d": 0.5},
        "hardening_stiffness": {"k3": 0.02},
        "quadratic_damping": {"c2": 1e-3},
        "inertia": {"m": 2e-3},
        "softening": {"ks": 0.1, "s0": 10.0},
    }
    motion = from_lines(np.array([0, 0.3, 2.0, 0.7j])[:, None] * axis, 0.5, 2)
    turn = np.pi * np.arange(4)[:, None]
    sizes, shifts = np.array([[0], [0.3], [2.0], [0.7]]), np.array([[0], [0], [0], [np.pi / 2]])

    def wave(time, order):
        return np.sum(sizes * turn**order * np.cos(turn * time + shifts + order * np.pi / 2), axis=0)

    def rates(time, state):
        speed = wave(time, 1)[0]
        return [
            speed - state[0] / tissue["tau_s"],
            speed * (1 - state[1] * np.sign(speed)) / effects["hysteresis"]["d"],
            abs(speed),
        ]

    time = motion.time[::OVERSAMPLING]
    q, r, path = solve_ivp(
        rates, (0, time[-1]), [0, 0, 0], t_eval=time, max_step=0.01, rtol=1e-7, atol=1e-9
    ).y
    z, v, a = (wave(time, order) for order in range(3))
    scalar = elastic * z + relaxing * q + 0.3 * np.tanh(v) + 0.4 * r + 0.02 * z**3
    scalar += 1e-3 * abs(v) * v + 2e-3 * a + 0.1 * z * np.expm1(-path / 10)
    force = tissue_force({"tissue": tissue, "effects": effects}, motion)[::OVERSAMPLING]
    assert force == pytest.approx(np.outer(scalar, axis), abs=2e-5 * np.abs(scalar).max())


def test_contact_pushes_along_its_normal_and_rubs_across_it():
    truth, motion = _truth("contact_plane")
    plane = truth["effects"]["contact_plane"]
    force, normal = measured_force(truth, motion), np.array(plane["n"])
    pressed = force @ normal
    across = force - np.outer(pressed, normal)
    depth = motion.position @ normal - plane["d0"]
    assert np.abs(pressed - plane["k"] * np.where(depth > 0, depth, 0.0)).max() < 1e-12 * pressed.max()
    assert (np.linalg.norm(across, axis=1) <= plane["mu"] * pressed + 1e-12).all()
    assert np.sum(across * motion.velocity, axis=1).min() >= -1e-12
    assert 0.1 < np.mean(depth > 0) < 0.9
