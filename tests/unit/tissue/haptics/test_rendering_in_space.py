"""The loop of matrices: against that of one axis along principal axes, and against all poles of the loop."""

from dataclasses import replace

import numpy as np
import pytest
from spatial_models import BRANCH, FRAME, RELAXATION, STIFFNESS, spatial_export

from lumbar.base.errors import InputError
from lumbar.settings.runtime import DeviceSettings, RuntimeSettings
from lumbar.tissue.haptics import closed_loop, ticks
from lumbar.tissue.haptics.closed_loop import SampledModel, propagation
from lumbar.tissue.haptics.in_space import SpatialLoop
from lumbar.tissue.haptics.loop_verdict import judge_loop
from lumbar.tissue.haptics.rendered_model import render_model
from study_settings import changed

STEP, LONG = 1e-3, 1500
DEVICE = DeviceSettings()


def branch_impulse(decay: float) -> np.ndarray:
    """Elongation of a Maxwell branch after a position of 1 for a sample."""
    constant = -(1.0 - decay) / np.log(decay)
    return constant * np.r_[1.0, (decay - 1.0) * decay ** np.arange(LONG - 1)]


def loop_of(spring: np.ndarray, branch: np.ndarray, decay: float, delay: float = 0.0) -> SpatialLoop:
    """KB with these matrices in N/m."""
    impulse = np.multiply.outer(branch_impulse(decay), branch)
    impulse[0] += spring
    clock = SampledModel("KB", np.ones(1), np.ones(1), STEP).late(delay)
    if whole := len(clock.numerator) - 1:
        impulse = np.concatenate([np.zeros((whole, *spring.shape)), impulse])
    return SpatialLoop("KB", impulse, replace(clock, numerator=np.ones(1)))


def radius(spring, branch, decay: float, gain: float, device: DeviceSettings) -> float:
    """Largest pole of the loop of KB, device and hand, state by state."""
    axes, constant = np.eye(len(spring)), -(1.0 - decay) / np.log(decay)
    moves, by_force = propagation(device, STEP)
    by_state = np.hstack([spring + constant * branch, 0 * spring, decay * branch, -constant * branch])
    stylus = np.hstack([np.kron(moves, axes), np.zeros((2 * len(axes), 2 * len(axes)))])
    stylus -= gain * np.vstack([by_force[0] * by_state, by_force[1] * by_state])
    branches = np.hstack([constant * axes, 0 * axes, decay * axes, -constant * axes])
    before = np.hstack([axes, 0 * axes, 0 * axes, 0 * axes])
    return float(np.abs(np.linalg.eigvals(np.vstack([stylus, branches, before]))).max())


def drawn(generator) -> np.ndarray:
    """A semidefinite matrix in N/m, with axes of its own."""
    root = generator.standard_normal((3, generator.integers(1, 4)))
    return 10 ** generator.uniform(1.5, 4.0) * root @ root.T


@pytest.mark.nightly
def test_below_the_largest_gain_every_pole_is_inside_and_above_one_is_not():
    """Springs and branches whose axes differ, so that no direction is a loop of its own."""
    generator, bounded = np.random.default_rng(4), 0
    for _ in range(25):
        spring, branch, decay = drawn(generator), drawn(generator), generator.uniform(0.9, 0.98)
        device = DEVICE.model_copy(
            update={"damping_N_s_m": generator.uniform(0.1, 6.0), "mass_kg": generator.uniform(0.05, 0.5)}
        )
        limit = loop_of(spring, branch, decay).largest_stable_gain(device)
        assert np.linalg.norm(limit.direction) == pytest.approx(1.0)
        for share in (0.01, 0.3, 0.9, 0.9995):
            assert radius(spring, branch, decay, share * min(limit.gain, 1e6), device) < 1.0
        if np.isfinite(limit.gain):
            assert radius(spring, branch, decay, 1.0005 * limit.gain, device) > 1.0
            assert limit.frequency > 0
            bounded += 1
    assert bounded > 20


def test_no_direction_needs_more_damping_than_the_matrix():
    generator = np.random.default_rng(5)
    for delay in (0.0, 0.0004, 0.0013):
        spring, branch = drawn(generator), drawn(generator)
        loop = loop_of(spring, branch, 0.97, delay)
        needed, worst = loop.required_damping()

        def along(direction, loop=loop):
            projected = np.einsum("i,sij,j->s", direction, loop.impulse, direction)
            return ticks.required_damping(replace(loop.unit, numerator=projected))

        others = [along(item / np.linalg.norm(item)) for item in generator.standard_normal((30, 3))]
        assert max(others) <= needed * (1 + 1e-9)
        if not delay:
            assert along(worst) == pytest.approx(needed, rel=1e-6)


def test_a_spring_that_pushes_on_is_never_stable():
    loop = loop_of(np.diag([500.0, -1.0, 200.0]), np.zeros((3, 3)), 0.97)
    needed, direction = loop.required_damping()
    assert (needed, abs(direction[1])) == (np.inf, pytest.approx(1.0))
    free = DEVICE.model_copy(update={"hand_stiffness_N_m": 0.0})
    assert loop.largest_stable_gain(free).gain == 0.0
    held = DEVICE.model_copy(update={"hand_stiffness_N_m": 0.5})
    assert loop.largest_stable_gain(held).gain == pytest.approx(0.5)


def test_principal_axes_are_loops_of_their_own():
    """Orthotropic KB as it is exported: damping and gain are those along the stiffest axis, which is returned."""
    model = render_model(spatial_export({}, moving_average_ms=3.0), DEVICE)
    (loop,), damping, limits = model.loops, [], []
    for spring, branch in zip(1e3 * STIFFNESS, 1e3 * BRANCH, strict=True):
        impulse = branch * branch_impulse(np.exp(-STEP / RELAXATION)) + spring * (np.arange(LONG) == 0)
        one = SampledModel("KB", np.convolve(impulse, np.full(3, 1 / 3)), np.ones(1), STEP)
        damping.append(ticks.required_damping(one))
        limits.append(closed_loop.largest_stable_gain(one, DEVICE))
    needed, direction = loop.required_damping()
    limit = loop.largest_stable_gain(DEVICE)
    assert needed == pytest.approx(max(damping), rel=1e-9)
    assert limit.gain == pytest.approx(min(item.gain for item in limits), rel=1e-4)
    assert limit.frequency == pytest.approx(limits[0].frequency, rel=1e-3)
    assert abs(direction @ FRAME[:, 0]) == pytest.approx(1.0, abs=1e-9)
    assert abs(limit.direction @ FRAME[:, 0]) == pytest.approx(1.0, abs=1e-6)
    assert model.reach is None


def test_sines_need_no_more_than_the_required_damping():
    """Along the direction that is returned one of them takes all of it; along others less."""
    model = spatial_export({}, ("x", "z"))
    needed, worst = render_model(model, DEVICE).loops[0].required_damping()
    taken = {}
    for direction in (worst, worst[::-1] * [1.0, -1.0], np.array([1.0, 0.0])):
        needs = []
        for angle in np.geomspace(1e-3, 3.1, 80):
            path = np.multiply.outer(np.cos(angle * np.arange(12_001)), direction)
            moved = np.diff(path, axis=0)[-10_000:]
            work = np.sum(model.dynamics.response(path)[:-1][-10_000:] * moved)
            needs.append(-1e3 * STEP * work / np.sum(moved**2))
        taken[tuple(direction)] = max(needs)
    assert max(taken.values()) == taken[tuple(worst)] <= needed * 1.001
    assert taken[tuple(worst)] > 0.98 * needed
    assert min(taken.values()) < 0.95 * needed


@pytest.mark.nightly
def test_an_export_is_judged_along_the_worst_direction(zig_cache, tmp_path):
    settings = RuntimeSettings(compiler_cache=str(zig_cache))
    model = spatial_export({}, moving_average_ms=3.0)
    verdict = judge_loop(model, settings)
    assert verdict.passive
    np.testing.assert_allclose(np.abs(verdict.analysis.damping_direction), [0.73, 0.56, 0.4], atol=0.005)
    soft = changed(settings, device={"mass_kg": 0.02, "damping_N_s_m": 0.5})
    judged = judge_loop(model, soft)
    assert not judged.stable and judged.run.oscillates
    with pytest.raises(InputError, match="rate_Hz is 300"):
        judge_loop(model, changed(settings, device={"rate_Hz": 300.0}))
