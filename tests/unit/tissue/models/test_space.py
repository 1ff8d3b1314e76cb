"""Equations and bases in space: what holds in any frame, what is left of them along one axis, what means nothing."""

import numpy as np
import pytest
import scipy

from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.expression import Symbol, parse, to_text
from lumbar.tissue.models.motion import JoinedMotions, Motion, SpatialMotion
from lumbar.tissue.models.space import (
    PlaneContact,
    SpatialBase,
    Symmetry,
    force_sensor_effects,
    frame_of,
    turn,
)
from lumbar.tissue.models.spatial_equation import vectorise
from lumbar.tissue.models.structure import Structure

XYZ = ("x", "y", "z")
TIME = np.arange(800) * 0.01


def _motion(axes: int, seed: int = 0) -> SpatialMotion:
    rng = np.random.default_rng(seed)
    waves = [
        sum(rng.normal() * np.sin(2 * np.pi * f * TIME + rng.uniform(0, 6)) / f for f in (0.3, 0.7, 1.1, 1.9))
        for _ in range(axes)
    ]
    return SpatialMotion(tuple(Motion(TIME, wave, 0.01) for wave in waves), names=XYZ[:axes])


def _rotate(motion: SpatialMotion, matrix: np.ndarray) -> SpatialMotion:
    rows = matrix @ motion.position.reshape(len(matrix), -1)
    return SpatialMotion(tuple(Motion(TIME, row, 0.01) for row in rows), names=motion.names)


def _force(base, motion: SpatialMotion, linear, nonlinear=(), forms=()) -> np.ndarray:
    """Return the force of a base with forms, shape (axes, samples)."""
    result = Structure(base.structural, forms).simulate(motion, np.array(linear), np.array(nonlinear))
    return result.reshape(len(motion.names), -1)


FORMS = [
    (form, form.to_space(XYZ))
    for effect in TISSUE.values()
    if effect.to_space(XYZ)[0] is not None and effect.name not in ("delay", "saturation")
    for form in effect.forms
    if not form.one_axis and (not form.hand_written or form.hand_written.spatial)
]


def _numbers(form, motion) -> np.ndarray:
    scales = [1.0 if item.scale == "force" else motion.scale(item.scale) for item in form.nonlinear]
    return np.array([item.grid(scale, 0.01)[0] for item, scale in zip(form.nonlinear, scales, strict=True)])


def _forces(form, motion: SpatialMotion, nonlinear) -> np.ndarray:
    """Shape (linear parameters, axes, samples); of a form at the output what it makes of a force."""
    if form.place == "output":
        force = motion.position + 0.3 * motion.velocity
        return form.output_transform(force, motion, nonlinear).reshape(1, len(motion.names), -1)
    return np.array([item.reshape(len(motion.names), -1) for item in form.columns(motion, nonlinear)])


@pytest.mark.parametrize(("form", "spatial"), FORMS, ids=[form.key for form, _ in FORMS])
def test_form_is_invariant_under_rotation(form, spatial):
    """A rotated motion has the rotated force; a force with one parameter per axis (a drift) is independent of the motion."""
    motion, matrix = _motion(3), turn(np.array([0.4, -0.7, 0.2]))
    nonlinear = _numbers(spatial, motion)
    forces, turned = (_forces(spatial, item, nonlinear) for item in (motion, _rotate(motion, matrix)))
    assert np.isfinite(forces).all() and np.any(forces)
    wanted = forces if len(spatial.linear) > len(form.linear) else matrix @ forces
    assert np.allclose(turned, wanted, atol=1e-9 * np.abs(forces).max())


@pytest.mark.parametrize(("form", "spatial"), FORMS, ids=[form.key for form, _ in FORMS])
def test_spatial_form_along_one_axis_matches_one_axis_form(form, spatial):
    motion = _motion(1)
    along = SpatialMotion((motion.parts[0], *(Motion(TIME, 0 * TIME, 0.01),) * 2), names=XYZ)
    nonlinear = _numbers(form, motion.parts[0])
    if form.effect == "hysteresis":
        nonlinear = 20 * nonlinear  # both round the turning point between two samples
    result = _forces(spatial, along, nonlinear)
    if form.place == "output":
        force = motion.position + 0.3 * motion.velocity
        single = form.output_transform(force, motion.parts[0], nonlinear)[None]
    else:
        single = np.array(form.columns(motion.parts[0], nonlinear))
    of_x = result[:: 3 if len(spatial.linear) > len(form.linear) else 1]
    # A state in closed form is exact where the solver takes the position as straight in a quarter of a sample.
    tolerance = 1e-3 if form.solution and "hysteresis" in form.key else 1e-9
    assert np.allclose(of_x[:, 0], single, atol=tolerance * np.abs(single).max())
    assert np.allclose(of_x[:, 1:], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "components"),
    [
        ("v*abs(v)", [f"sqrt(max(v_x*v_x + v_y*v_y, 1e-300))*v_{axis}" for axis in "xy"]),
        ("dot(z, v)*z", [f"(z_x*v_x + z_y*v_y)*z_{axis}" for axis in "xy"]),
        ("norm(z)", ["sqrt(max(z_x*z_x + z_y*z_y, 1e-300))"]),
    ],
)
def test_an_expression_in_components(text, components):
    vectors = {name: (Symbol(f"{name}_x"), Symbol(f"{name}_y")) for name in "zv"}
    read = vectorise(parse(text), vectors)
    parts = read if isinstance(read, tuple) else (read,)
    assert [*map(to_text, parts)] == [to_text(parse(item)) for item in components]


@pytest.mark.parametrize(
    "name", ["quadratic_stiffness", "contact_loss", "depth_dependent_damping", "backlash"]
)
def test_effect_without_form_in_space_gives_reason(name):
    result, without = TISSUE[name].to_space(XYZ)
    assert result is None
    assert without.keys() == {form.key for form in TISSUE[name].forms}
    assert all(without.values())


def _base(symmetry: Symmetry, kind: str = "KB") -> SpatialBase:
    frames = [turn(np.array([0.3, 0.8, -0.5])), turn(np.array([-0.2, 0.1, 0.6]))]
    frames = frames[: 2 if symmetry is Symmetry.FULL else 1]
    return SpatialBase(BASES[kind], symmetry, XYZ, tuple(tuple(frame.ravel()) for frame in frames))


@pytest.mark.parametrize("symmetry", Symmetry)
def test_spatial_base_matches_its_matrices(symmetry):
    """Forces of the columns are K_e z + K_b q with the matrices that it tells, q by an independent integration."""
    base, motion = _base(symmetry), _motion(3)
    rng = np.random.default_rng(1)
    linear = rng.uniform(0.3, 2.0, len(base.linear))
    nonlinear = np.array([0.15, *np.exp(rng.normal(0, 0.2, len(base.nonlinear) - 1))])
    result = _force(base, motion, linear, nonlinear)
    matrices = base.matrices(linear, nonlinear)
    for matrix in matrices.values():
        assert np.linalg.eigvalsh(matrix)[0] > 0 and np.allclose(matrix, matrix.T)
    splines = [scipy.interpolate.make_interp_spline(TIME, part.position, k=5) for part in motion.parts]

    def rate(time, q):
        return [spline(time, 1) - value / 0.15 for spline, value in zip(splines, q, strict=True)]

    q = scipy.integrate.solve_ivp(rate, (0, TIME[-1]), np.zeros(3), t_eval=TIME, rtol=1e-10, atol=1e-12).y
    wanted = matrices["spring_stiffness"] @ motion.position.reshape(3, -1) + matrices["branch_stiffness"] @ q
    assert np.allclose(result, wanted, atol=1e-5 * np.abs(wanted).max())


def test_held_base_keeps_its_frames():
    base, motion = _base(Symmetry.FULL), _motion(3)
    nonlinear = np.array([0.15, *np.exp([0.1, -0.2, 0.3, 0.0, 0.2, -0.1])])
    linear = np.arange(1.0, 7.0)
    held = base.freeze(nonlinear)
    assert [item.name for item in held.nonlinear] == ["relaxation_time"]
    before, after = _force(base, motion, linear, nonlinear), _force(held, motion, linear, nonlinear[:1])
    assert np.allclose(before, after, atol=1e-12)


def test_plane_contact_has_normal_force_and_friction():
    normal = np.array([0.6, 0.0, 0.8])
    plane = PlaneContact(BASES["LE-contact"], XYZ, (tuple(frame_of(normal).ravel()),), 0.2, 1.0)
    motion = _motion(3)
    forces = _force(plane, motion, [2.0, 0.5], [1e-3, 1.0, 1.0, 1.0])
    position, velocity = motion.position.reshape(3, -1), motion.velocity.reshape(3, -1)
    into = 2.0 * np.maximum(normal @ position - 0.2, 0.0)
    assert np.allclose(normal @ forces, into, atol=1e-9)
    along = velocity - np.outer(normal, normal @ velocity)
    touching = into > 0
    assert np.allclose(np.linalg.norm(forces - np.outer(normal, into), axis=0), 0.25 * into, atol=1e-3)
    assert np.all(np.sum(forces * along, axis=0)[touching] > 0) and not forces[:, ~touching].any()


def test_force_sensor_rotates_and_mixes_forces():
    effects, motion = force_sensor_effects(XYZ), _motion(3)
    base = _base(Symmetry.ISOTROPIC, "LE")
    plain, vector = _force(base, motion, [2.0]), np.array([0.1, -0.2, 0.3])
    turned = _force(base, motion, [2.0], np.exp(vector), effects["turned_frame"].forms)
    assert np.allclose(turned, turn(vector) @ plain)
    mixed = _force(base, motion, [2.0], np.exp([0.1, 0.0, 0.0, 0.0, 0.0, -0.05]), effects["crosstalk"].forms)
    matrix = np.array([[1, 0.1, 0], [0, 1, 0], [0, -0.05, 1]])
    assert np.allclose(mixed, matrix @ plain)


@pytest.mark.parametrize(
    ("zeros", "wanted"), [((1, 2, 3), (1, 2, 3, 1, 2, 3)), ((1, 2, 3, 4, 5, 6), (1, 2, 3, 4, 5, 6))]
)
def test_zero_is_added_to_its_channel(zeros, wanted):
    """Zeros are common to all records, or one per record."""
    motions = JoinedMotions((_motion(3), _motion(3, 1)))
    structure = Structure(_base(Symmetry.ISOTROPIC, "LE").structural)
    fit = Fit(structure, np.zeros(1), np.zeros(0), 0.0, zeros=np.array(zeros, float))
    assert np.allclose(fit.simulate(motions), np.repeat(np.array(wanted, float), len(TIME)))


def test_a_form_of_one_channel_leaves_the_others():
    forms = TISSUE["saturation"].to_space(XYZ)[0].forms
    names = ["sharp", "sharp_x", "sharp_y", "sharp_z"]
    names += ["sharp_xy", "sharp_xz", "sharp_yz", "sharp_xyz", "soft", "rounded"]
    assert [form.name for form in forms] == names
    motion, limit = _motion(3), np.array([0.2])
    result = forms[2].output_transform(motion.position, motion, limit).reshape(3, -1)
    position = motion.position.reshape(3, -1)
    assert np.array_equal(result[[0, 2]], position[[0, 2]]) and np.array_equal(
        result[1], np.clip(position[1], -0.2, 0.2)
    )
    result = forms[5].output_transform(motion.position, motion, np.array([0.3, 0.1])).reshape(3, -1)
    assert [item.name for item in forms[5].nonlinear] == ["limit_x", "limit_z"]
    limits = np.array([0.3, np.inf, 0.1])
    assert np.array_equal(result, np.clip(position.T, -limits, limits).T)
