"""Net moments in closed form and by Lagrange's equations; the tables of measures."""

import numpy as np
import pandas as pd
import pytest
import sympy
from lifting_cases import hide_markers, trial_of, true_recording

import lumbar
from lumbar.lifting.measures.back_load import Link, net_moment
from lumbar.lifting.measures.lift_values import long_table, measures_page, write_measures
from lumbar.tables.table import SYNTHETIC_TWIN
from study_settings import subject_settings

G = 9.81
RATE = 1000.0
TIME = np.arange(0, 2, 1 / RATE)


def test_a_body_at_rest_needs_its_weight_times_the_arm():
    joint = np.zeros((10, 3))
    trunk = Link(40.0, np.tile([0.0, 0.2, 0.3], (10, 1)), np.tile([0.0, 0.4, 0.6], (10, 1)), 0.1)
    box = Link(np.full(10, 15.0), np.tile([0.1, 0.5, 0.2], (10, 1)))
    moment = net_moment(joint, [trunk, box], 100.0, G)
    assert moment[:, 0] == pytest.approx(G * (40 * 0.2 + 15 * 0.5))  # extension, about the axis to the right
    assert moment[:, 1] == pytest.approx(-G * 15 * 0.1)  # the box at the right is held by bending left
    assert moment[:, 2] == pytest.approx(0, abs=1e-9)


def angles():
    """Inclinations of two links, radians from straight up, and their first two derivatives."""
    t = sympy.Symbol("t")
    expressions = 0.6 + 0.5 * sympy.sin(2.1 * t), 0.9 - 0.7 * sympy.cos(3.3 * t)
    return t, expressions


def test_two_links_agree_with_lagrange_s_equations():
    """Moment about the lower joint: d/dt ∂L/∂q̇ − ∂L/∂q of the chain turned as a whole, by symbolic differentiation."""
    t, inclinations = angles()
    turn = sympy.Function("turn")(t)
    lengths, centres, masses, gyrations = (0.45, 0.6), (0.25, 0.3), (30.0, 12.0), (0.12, 0.17)
    kinetic = potential = 0
    base = sympy.Matrix([0, 0])
    for q, length, centre, mass, k in zip(inclinations, lengths, centres, masses, gyrations, strict=True):
        along = sympy.Matrix([sympy.sin(q + turn), sympy.cos(q + turn)])
        place = base + centre * along
        speed = place.diff(t)
        kinetic += mass / 2 * (speed.dot(speed) + k**2 * sympy.diff(q + turn, t) ** 2)
        potential += mass * G * place[1]
        base = base + length * along
    lagrangian = kinetic - potential
    moment = sympy.diff(lagrangian.diff(turn.diff(t)), t) - lagrangian.diff(turn)
    expected = sympy.lambdify(t, -moment.subs(turn, 0).doit(), "numpy")(TIME)

    q = [sympy.lambdify(t, expression, "numpy")(TIME) for expression in inclinations]
    axes = [np.stack([0 * angle, np.sin(angle), np.cos(angle)], axis=1) for angle in q]
    second = lengths[0] * axes[0] + centres[1] * axes[1]
    links = [
        Link(masses[0], centres[0] * axes[0], axes[0], gyrations[0]),
        Link(masses[1], second, axes[1], gyrations[1]),
    ]
    actual = net_moment(np.zeros((len(TIME), 3)), links, RATE, G)
    # An inclination grows forward, against the rotation about the axis to the right.
    assert actual[5:-5, 0] == pytest.approx(expected[5:-5], rel=1e-4, abs=0.01)
    assert np.abs(actual[:, 1:]).max() < 1e-9


def test_a_body_in_free_flight_needs_no_moment_about_its_own_centre():
    """Two masses on a slender rod that tumbles and falls: all angular momentum about the common centre is kept."""
    centre = np.stack([0.3 * TIME, 1.1 * TIME, 2 * TIME - 0.5 * G * TIME**2], axis=1)
    axis = np.stack([np.cos(3 * TIME), 0.6 * np.sin(3 * TIME), 0.8 * np.sin(3 * TIME)], axis=1)
    links = [Link(4.0, centre + 0.3 * axis, axis, 0.2), Link(6.0, centre - 0.2 * axis, axis, 0.1)]
    assert np.abs(net_moment(centre, links, RATE, G)[5:-5]).max() < 1e-3


@pytest.fixture(scope="module")
def table():
    """Two measured lifts, the second without feet."""
    lifts = []
    for person, hidden in (("expert", ()), ("novice", ("TOE", "HEEL"))):
        recording = hide_markers(true_recording(f"{person}_23kg"), *hidden)
        lift = lumbar.lift(recording, subject_settings(person), trial=trial_of(23.0))
        lifts.append((lumbar.measure_movement(lift).values, lift.facts))
    return long_table(lifts, {"expert": "expert", "novice": "novice"})


def test_page_has_group_means_and_missing_measures(table):
    page = measures_page(table, SYNTHETIC_TWIN)
    rows = page.frame.set_index(["measure", "plane"])
    again = table[(table["measure"] == "l5s1_moment_peak") & (table["plane"] == "all")].set_index("group")[
        "value"
    ]
    assert rows.loc[("l5s1_moment_peak", "all"), "expert 23 kg"] == again["expert"]
    assert np.isnan(rows.loc[("margin_of_stability", "all"), "novice 23 kg"])
    assert any("L_HEEL" in note for note in page.notes)
    doubled = measures_page(pd.concat([table, table.assign(lift="again", value=table["value"] + 2)]), "x")
    mean = doubled.frame.set_index(["measure", "plane"]).loc[("l5s1_moment_peak", "all"), "expert 23 kg"]
    assert mean == pytest.approx(again["expert"] + 1)


def test_the_long_table_is_the_csv_and_the_page_the_rest(table, tmp_path):
    write_measures(tmp_path / "movement_measures", table, SYNTHETIC_TWIN)
    read = pd.read_csv(tmp_path / "movement_measures.csv", keep_default_na=False, na_values=[""])
    assert len(read) == len(table)
    assert set(read["data"]) == {SYNTHETIC_TWIN}
    assert "Hof, Gazendam" in (tmp_path / "movement_measures.html").read_text(encoding="utf-8")
    assert r"\begin{tabular}" in (tmp_path / "movement_measures.tex").read_text(encoding="utf-8")
