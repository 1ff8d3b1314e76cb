"""The torque's limits, a better V, and verdicts: closed forms and brute force."""

from dataclasses import replace

import numpy as np
import pytest
from lifting_cases import GRAVITY, WEIGHTS, minimum_jerk, pendulums_of

from lumbar.lifting.measures.compare_groups import Difference
from lumbar.lifting.stability.funnel.exact_funnel import best_of_family, exact_funnels, reachable_area
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import feedforward_torque, regulate
from lumbar.lifting.stability.model.torque_limits import exceeds, reference_of, torque_range
from lumbar.lifting.stability.table_4_1 import verdict
from lumbar.settings.lifting import StabilitySettings
from refusing import has_tokens


def loops_of(items, sign, **keywords):
    return regulate(pendulums_of(items, sign, **{"knots": 201, **keywords}), WEIGHTS)


def test_reference_torque_is_inverse_dynamics():
    item = minimum_jerk()
    actual = reference_of(pendulums_of([item], "inverted", knots=401)).torque[:, 0]
    expected = np.interp(
        np.linspace(0, item.duration, 801), item.time, feedforward_torque(item, "inverted", 1.0, GRAVITY)
    )
    assert actual[20:-20] == pytest.approx(expected[20:-20], abs=0.02)


def test_ankle_torque_keeps_the_pressure_below_the_foot():
    """Levers of the weight: 0.2 m ahead of the ankle, 0.06 m behind it, 0.17 m to a side."""
    item, settings = minimum_jerk(mass=30.0), StabilitySettings()
    ahead, behind = torque_range(item, settings)
    assert (ahead, behind) == pytest.approx((-30 * 9.81 * 0.2, 30 * 9.81 * 0.06))
    aside = torque_range(minimum_jerk(mass=30.0, plane="lateral_bending"), settings)
    assert aside == pytest.approx((-30 * 9.81 * 0.17, 30 * 9.81 * 0.17))


def test_limit_is_exceeded_if_a_state_of_the_funnel_needs_more():
    """Against the torque at 2,000 points on the edge of every cross-section."""
    loops = loops_of([minimum_jerk()], "inverted")
    level, reference = exact_funnels(loops).level, reference_of(loops.pendulums)
    circle = np.linspace(0, 2 * np.pi, 2001)
    required = []
    for knot, rho in enumerate(level[:, 0]):
        s11, s12, s22 = loops.cost[2 * knot, 0]
        eigen, vectors = np.linalg.eigh(np.array([[s11, s12], [s12, s22]]) / rho)
        edge = vectors / np.sqrt(eigen) @ [np.cos(circle), np.sin(circle)]
        required.append(reference.torque[2 * knot, 0] - loops.gains[2 * knot, 0] @ edge)
    lowest, highest = np.min(required), np.max(required)
    for low, high, beyond in (
        (lowest - 0.1, highest + 0.1, False),
        (lowest + 0.1, highest + 0.1, True),
        (lowest - 0.1, highest - 0.1, True),
    ):
        assert exceeds(loops, level, reference, low, high).tolist() == [beyond]


def test_best_v_of_a_linear_loop_reaches_liouvilles_area():
    """Without gravity λ = 0 maps the goal set back exactly: no set can be larger."""
    loops = loops_of([minimum_jerk()], "hanging", gravity=0.0)
    best = best_of_family(loops, 1.0, [0.0, 0.5, 1.0])
    assert best.area[0] == pytest.approx(reachable_area(loops), rel=1e-5)
    assert best.mean_area > 1.01 * exact_funnels(loops).mean_area


def test_verdict_names_what_changes_the_sign():
    changed = {"Q divided": 9.0, "R divided": 11.0}
    unknown = Difference(3.0, 2.0, (1, 5), remark="no interval: 1 person (expert), at least 3 are needed")
    survives = verdict(10.0, 0.9, changed, unknown)
    assert not any(words in survives for words in ("duration", "Q divided", "sign"))
    assert has_tokens(verdict(10.0, 0.1, changed, unknown), "90 %…duration")
    assert has_tokens(verdict(10.0, 0.9, {**changed, "Q divided": -1.0}, unknown), "sign…Q divided")
    known = Difference(2.2, 2.0, (5, 5), low=-0.04, high=0.4)
    assert has_tokens(verdict(10.0, 0.9, changed, known), "interval…0")
    # In percent of the mean that is compared with.
    assert "[+5.00, +20.00]" in verdict(10.0, 0.9, changed, replace(known, low=0.1))
    assert verdict(None, None, {}, unknown).startswith("not testable")
