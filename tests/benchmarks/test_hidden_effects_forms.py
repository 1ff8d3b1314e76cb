"""Every building block of the generator against a closed form or an ODE solver."""

import ast
import sys

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hidden_effects.catalogue import MECHANISMS, OUTSIDE_FORMS, PAIRS, SINGLE, form_named
from hidden_effects.form import HiddenEffect, Scales, simulate
from hidden_effects.rate_independent import bouc_wen, dahl, rounded_play
from lumbar.base.errors import InputError
from lumbar.twin.kelvin_boltzmann import Tissue
from lumbar.twin.tool_motion import ToolMotion, draw_motions

TISSUE = Tissue(0.5, 1.0, 0.15)


def smooth_motion(duration: float = 4.0, step: float = 0.0005) -> ToolMotion:
    """Two sines whose reversals are of many sizes."""
    time = step * np.arange(round(duration / step) + 1)
    waves = ((3.0, 2 * np.pi * 0.7, 0.3), (1.5, 2 * np.pi * 2.3, 1.1))
    position = sum(a * np.sin(w * time + p) for a, w, p in waves)
    velocity = sum(a * w * np.cos(w * time + p) for a, w, p in waves)
    acceleration = sum(-a * w**2 * np.sin(w * time + p) for a, w, p in waves)
    return ToolMotion("multisine", step, position, velocity, acceleration)


def integrate(motion: ToolMotion, slope, start: float = 0.0) -> np.ndarray:
    """Solution of ds/dt = slope(s, z, v), by an adaptive solver kept from stepping over reversals."""
    time = motion.time
    found = solve_ivp(
        lambda t, s: slope(s, np.interp(t, time, motion.position), np.interp(t, time, motion.velocity)),
        (0.0, time[-1]),
        [start],
        t_eval=time,
        max_step=0.002,
        rtol=1e-7,
        atol=1e-9,
    )
    return found.y[0]


def test_imports_nothing_that_later_looks_for_the_effect(project):
    folder = project / "benchmarks" / "hidden_effects"
    own = ("hidden_effects", "lumbar.twin", "lumbar.base.files", "lumbar.base.errors")
    looking = {"diagnosing", "scores", "power_curve", "figures", "run"}
    generator = [file for file in folder.glob("*.py") if file.stem not in looking]
    assert len(generator) == 11
    for file in generator:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                root = name.split(".")[0]
                allowed = (
                    root in ("numpy", "scipy") or root in sys.stdlib_module_names or name.startswith(own)
                )
                assert allowed, f"{file.name} imports {name}"


def test_catalogue_covers_the_fifteen_mechanisms_with_distinct_forms():
    assert len(MECHANISMS) == 15
    labels = [form.label for form in (*SINGLE, *OUTSIDE_FORMS)]
    assert len(set(labels)) == len(labels)
    assert {mechanism for pair in PAIRS for mechanism in pair} <= set(MECHANISMS)
    with pytest.raises(InputError, match="there are: hardening_stiffness:cubic"):
        form_named("hardening_stiffness:quartic")


@pytest.mark.parametrize(
    ("operator", "given", "slope"),
    [
        (dahl, (0.8, 1.6), lambda s, z, v: v * np.maximum(1 - np.sign(v) * s, 0.0) ** 1.6 / 0.8),
        (
            bouc_wen,
            (0.8, 1.5, 0.8),
            lambda s, z, v: v * (1 - np.abs(s) ** 1.5 * (0.8 * np.sign(v * s) + 0.2)) / 0.8,
        ),
        (rounded_play, (0.6, 0.05), lambda s, z, v: v / (1 + np.exp(-(np.sign(v) * (z - s) - 0.6) / 0.05))),
    ],
)
def test_operators_solve_their_differential_equations(operator, given, slope):
    motion = smooth_motion()
    expected = integrate(motion, slope, start=motion.position[0] if operator is rounded_play else 0.0)
    assert np.allclose(operator(motion.position, *given), expected, atol=3e-3)


@pytest.mark.parametrize("form", [*SINGLE, *OUTSIDE_FORMS], ids=lambda form: form.label)
def test_every_form_is_weak_at_its_weakest_and_deterministic(form):
    motion = draw_motions(np.random.default_rng(2), 5.0, 0.0, schroeder=True, periods=2)["multisine"]
    scales = Scales.of(motion, TISSUE)
    shape = form.draw(np.random.default_rng(7), scales)
    assert shape == form.draw(np.random.default_rng(7), scales)
    weak = simulate(motion, TISSUE, [HiddenEffect(form, form.strength(scales, shape, 0.0), shape)])
    strong = [
        simulate(motion, TISSUE, [HiddenEffect(form, form.strength(scales, shape, 1.0), shape)]) for _ in "ab"
    ]
    base = TISSUE.force(motion)
    assert np.array_equal(*strong)
    assert np.std(weak - base) < 0.01 * base.std() < np.std(strong[0] - base)
