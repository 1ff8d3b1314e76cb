"""Table 4.1 and its controls: the areas recomputed from the equations alone, the null control by hand."""

import re

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar
from stability_cases import SETTINGS, add_thesis, lift, states_and_facts

from lumbar.lifting.stability.basins import basins_of_lift
from lumbar.lifting.stability.changed_pendulums import decomposition_table
from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import close_loops
from lumbar.lifting.stability.model.pendulum_trajectories import (
    COMS,
    THESIS,
    Convention,
    LiftStates,
    join_rows,
)
from lumbar.lifting.stability.percent_differences import ComparedLifts
from lumbar.lifting.stability.table_4_1 import published_note, tables_4_1
from refusing import has_tokens

FAST = SETTINGS.model_copy(update={"knots": 101, "checks": ()})
INVERTED = FAST.model_copy(update={"pendulum": FAST.pendulum.model_copy(update={"sign": "inverted"})})
OWN = Convention("inverted", "real", "with_box", "mid_ankle", "inner", "descent")


def lift_states(subject="expert", box=23.0, duration=1.5, body=17.0, thesis=True) -> LiftStates:
    """Pendulum states of one made lift, by the thesis's choice with another length."""
    states, facts = states_and_facts(lift(subject=subject, box=box, duration=duration))
    masses = {com: {"without_box": body, "with_box": body + box} for com in COMS}
    facts |= {"subject": subject, "experience": subject, "box_mass_kg": box, "mass_kg": masses}
    if not thesis:
        return LiftStates(states, facts)
    return LiftStates(states, add_thesis(facts, 1.05), states)


def study_of(lifts, settings, published):
    """Inputs of the tables of made lifts."""
    boa = []
    for item in lifts:
        actual = item.trajectories(OWN)[0]
        thesis = item.trajectories(THESIS)[0]
        summary = basins_of_lift(actual, settings, 1, thesis).summary
        boa.append(summary.assign(experience=item.facts["experience"]))
    return ComparedLifts(lifts, join_rows(boa), settings, published, "test")


@pytest.fixture(scope="module")
def published(project):
    return pd.read_csv(project / "resources" / "thesis" / "table_4_1.csv")


@pytest.fixture(scope="module")
def study(published):
    """An expert with two boxes and a novice with one."""
    lifts = [lift_states(), lift_states(box=15.0), lift_states("novice", duration=1.9, body=15.0)]
    return study_of(lifts, INVERTED, published)


@pytest.fixture(scope="module")
def tables_made(study):
    return tables_4_1(study, decomposition_table(study)[0].frame)


def area_from_the_equations(time, angle, mass, length, sign, weights, damping, gravity):
    """Average cross-section straight from Eqs 4.1-4.4 and d ln ρ/dt = max V̇/ρ, sharing no code with the library.

    `time` and `angle` as in ``pendulum.csv``; Riccati equation and level by scipy's adaptive DOP853 and LSODA; the ellipse
    V = ρ by the eigenvectors of S, its maximum by a dense scan and a bounded search.
    """
    q, r, qf = weights
    inertia, torque = mass * length**2, {"hanging": 1, "inverted": -1}[sign] * mass * gravity * length
    path, end = CubicSpline(time, angle), time[-1]
    b = np.array([[0.0], [1 / inertia]])

    def linear(t):
        return np.array([[0, 1], [-torque * np.cos(path(t)) / inertia, -damping / inertia]])

    def riccati(t, flat):
        s, a = flat.reshape(2, 2), linear(t)
        return -(q - s @ b @ b.T @ s / r + s @ a + a.T @ s).ravel()

    tight = {"rtol": 1e-10, "atol": 1e-10, "dense_output": True}
    cost = solve_ivp(riccati, (end, time[0]), qf.ravel(), method="DOP853", **tight).sol

    def growth(t, level):
        s = cost(t).reshape(2, 2)
        rate = riccati(t, s.ravel()).reshape(2, 2)
        gain = b.T @ s / r
        eigen, vectors = np.linalg.eigh(s / level)
        axes = vectors / np.sqrt(eigen)

        def value(phi):
            x = axes @ np.array([np.cos(phi), np.sin(phi)])
            full = torque * (np.sin(path(t) + x[0]) - np.sin(path(t)))
            flow = np.array([x[1], (-damping * x[1] - full - (gain @ x)[0]) / inertia])
            return (np.einsum("i...,ij,j...", x, rate, x) + 2 * np.einsum("i...,ij,j...", x, s, flow)) / level

        scan = np.linspace(0, 2 * np.pi, 400, endpoint=False)
        values = value(scan)
        peaks = np.flatnonzero((values >= np.roll(values, 1)) & (values >= np.roll(values, -1)))
        best = [
            minimize_scalar(lambda phi: -value(phi), bounds=(scan[k] - 0.02, scan[k] + 0.02), method="bounded",
                            options={"xatol": 1e-9}).fun
            for k in peaks[np.argsort(values[peaks])[-2:]]
        ]  # fmt: skip
        return -min(best)

    level = solve_ivp(
        lambda t, y: [growth(t, np.exp(y[0]))], (end, time[0]), [0.0], method="DOP853",
        rtol=1e-8, atol=1e-9, dense_output=True,
    ).sol  # fmt: skip
    section = lambda t: np.pi * np.exp(level(t)[0]) / np.sqrt(np.linalg.det(cost(t).reshape(2, 2)))  # noqa: E731
    return quad(section, time[0], end, epsrel=1e-8, limit=200)[0] / (end - time[0])


def areas_from_the_file(one, convention, still=False):
    """Average cross-section of the flexion of the thorax, computed from ``pendulum.csv`` alone."""
    regulator = INVERTED.regulator
    states = one.states
    rows = states[(states["com"] == "thorax") & (states["plane"] == "flexion_extension")]
    clock = rows["time_s"].to_numpy() / (rows["time_s"].iloc[-1] if convention.time == "unit" else 1.0)
    angle = rows["angle_rad"].to_numpy() * (0.0 if still else 1.0)
    return area_from_the_equations(
        clock, angle, one.facts["mass_kg"]["thorax"][convention.mass], 1.1 if convention == OWN else 1.05,
        convention.sign, (np.array(regulator.state_weight), regulator.control_weight,
        np.array(regulator.terminal_weight)), 1.0, 9.81,
    )  # fmt: skip


@pytest.mark.parametrize("convention", [THESIS, OWN])
def test_an_outsider_gets_the_same_area_from_the_file(convention):
    """For the flexion of the thorax, at 1e-6."""
    one = lift_states()
    actual, _ = one.trajectories(convention)
    item = next(item for item in actual if (item.com, item.plane) == ("thorax", "flexion_extension"))
    loops = close_loops([item], convention.sign, INVERTED.model_copy(update={"knots": 801}))
    assert exact_funnels(loops).mean_area[0] == pytest.approx(areas_from_the_file(one, convention), rel=1e-6)


@pytest.mark.nightly
def test_null_control_compares_the_same_pendulums_standing_still(tables_made):
    """Standing still, expert and novice differ in mass and duration only."""
    lifts = lift_states(), lift_states("novice", duration=1.9, body=15.0)
    expert, novice = (areas_from_the_file(one, OWN, still=True) for one in lifts)
    rows = tables_made.controls.frame.set_index(["comparison", "com", "plane"])
    row = rows.loc[("expert_vs_novice", "thorax", "flexion_extension")]
    assert row["null_percent"] == pytest.approx(100 * (expert / novice - 1), abs=0.01)
    assert abs(row["null_percent"] - row["percent"]) > 0.1


def test_missing_thesis_pendulums_are_reported():
    actual, failures = lift_states(thesis=False).trajectories(THESIS)
    assert actual == [] and len(failures) == 6
    tokens = "mid_ankle, skin, wrist_minimum…'lumbar lift'…thesis_pendulum.csv"
    assert all(has_tokens(item.reason, tokens) for item in failures)
    assert len(lift_states(thesis=False).trajectories(OWN)[0]) == 6


def test_table_4_1_includes_the_published_columns(tables_made, published):
    table, controls = tables_made.table, tables_made.controls
    assert tables_made.missing.empty
    assert table.frame[["comparison", "com"]].equals(published[["comparison", "com"]])
    assert set(published.columns) <= set(table.frame.columns)
    assert (
        table.frame["lateral_bending_published_percent"].tolist()
        == published["lateral_bending_percent"].tolist()
    )
    status = table.frame.set_index("comparison")["status"]
    assert set(status["expert_vs_novice"]) == {"computed"}
    assert status["decrease_in_mass_novice"].str.startswith("not testable: ").all()
    assert "–" in table.to_html() and "nan" not in table.to_latex() + controls.to_html()
    for name in ("percent", "lowest", "exponents"):
        assert not re.search(f"<th[^>]*>{name}", table.to_html() + controls.to_html())


def test_controls_contain_the_headline_within_its_range(tables_made, study):
    table, controls = tables_made.table, tables_made.controls
    rows = controls.frame[controls.frame["comparison"] == "expert_vs_novice"]
    assert ((rows["lowest_percent"] <= rows["percent"]) & (rows["percent"] <= rows["highest_percent"])).all()
    first = rows.set_index(["com", "plane"]).loc[("pelvis", "flexion_extension"), "percent"]
    shown = table.frame.set_index(["comparison", "com"]).loc[("expert_vs_novice", "pelvis")]
    assert first == shown["flexion_extension_headline_percent"]
    assert rows["verdict"].str.contains("1 person").all()
    html = controls.to_html()
    assert "±10 %" in html
    of_thesis = rows.set_index(["com", "plane"]).loc[("pelvis", "flexion_extension"), "thesis_percent"]
    assert of_thesis == shown["flexion_extension_percent"]


def test_published_columns_contradict_one_another(published):
    text = published_note(published)
    assert has_tokens(text, "-0.87…6 of 9")
