"""Table 4.1 and its grid: the areas recomputed from the equations alone, the tables from areas by hand."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar
from test_stability_areas import SETTINGS, lift, states_and_facts

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.basins import basins_of_lift
from lumbar.lifting.stability.comparison import table_4_1_grid
from lumbar.lifting.stability.comparison.decomposition import decomposition_table
from lumbar.lifting.stability.comparison.percent_differences import Study
from lumbar.lifting.stability.comparison.table_4_1 import published_sentence, tables_4_1
from lumbar.lifting.stability.comparison.table_4_1_grid import (
    grid_areas,
    grid_differences,
    grid_table,
    survival_sentence,
    survivors,
)
from lumbar.lifting.stability.model.failures import join_rows
from lumbar.lifting.stability.model.trajectories import (
    COMS,
    PLANES,
    THESIS,
    Convention,
    LiftStates,
    conventions,
)
from lumbar.publishing.figures.people_figures import grid_figure
from lumbar.tables.described import columns_of

FAST = replace(SETTINGS, knots=101, checks=(), grid=replace(SETTINGS.grid, knots=101))
INVERTED = replace(FAST, pendulum=replace(FAST.pendulum, sign="inverted"))
OWN = Convention("inverted", "real", "with_box", "mid_ankle", "inner", "descent")
GRID = conventions(OWN)


def lift_states(subject="expert", box=23.0, duration=1.5, body=17.0, hips=True) -> LiftStates:
    """Pendulum states of one made lift about the ankles (1.1 m) and the hips (0.4 m)."""
    states, facts = states_and_facts(lift(subject=subject, box=box, duration=duration))
    masses = {com: {"without_box": body, "with_box": body + box} for com in COMS}
    facts |= {"subject": subject, "experience": subject, "box_mass_kg": box, "mass_kg": masses}
    if not hips:
        return LiftStates(states, facts)
    others = OWN.pendulum.others
    lengths = [0.4 if choice.pivot == "hip" else 1.1 for choice in others]
    facts["other_pendulums"] = [
        {**vars(choice), "length_m": {com: dict.fromkeys(PLANES, length) for com in COMS}, "missing": {}}
        for choice, length in zip(others, lengths, strict=True)
    ]
    return LiftStates(states, facts, pd.concat([states.assign(**vars(choice)) for choice in others]))


def study_of(lifts, settings, published):
    """What the tables of made lifts are made of."""
    boa, grid = [], []
    for item in lifts:
        found = item.trajectories(OWN)[0]
        thesis = item.trajectories(THESIS)[0]
        label = {"experience": item.facts["experience"]}
        boa.append(basins_of_lift(found, settings, 1, thesis).summary.assign(**label))
        grid.append(grid_areas(item, settings).assign(**label))
    return Study(lifts, join_rows(boa), join_rows(grid), settings, published, "test")


@pytest.fixture(scope="module")
def published(project):
    return pd.read_csv(project / "resources" / "thesis" / "table_4_1.csv")


@pytest.fixture(scope="module")
def study(published):
    """An expert with two boxes and a novice with one."""
    lifts = [lift_states(), lift_states(box=15.0), lift_states("novice", duration=1.9, body=15.0)]
    return study_of(lifts, INVERTED, published)


@pytest.fixture(scope="module")
def made(study):
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


@pytest.fixture(scope="module")
def fine():
    """One lift and its grid with more knots."""
    one = lift_states()
    return one, grid_areas(one, replace(INVERTED, grid=replace(INVERTED.grid, knots=801)))


@pytest.mark.parametrize(
    ("convention", "still"), [(THESIS, False), (OWN, False), (replace(OWN, pivot="hip"), True)]
)
def test_an_outsider_gets_the_same_area_from_the_file(fine, convention, still):
    """Of the flexion of the thorax, at 1e-6."""
    sign, time, mass, pivot = list(vars(convention).values())[:4]
    one, grid = fine
    regulator = INVERTED.regulator
    chosen = {
        **vars(convention),
        "subject": "expert",
        "box_mass_kg": 23.0,
        "com": "thorax",
        "plane": "flexion_extension",
    }
    cell = grid[(grid[list(chosen)] == pd.Series(chosen)).all(axis=1)].iloc[0]
    states = one.states
    rows = states[(states["com"] == "thorax") & (states["plane"] == "flexion_extension")]
    clock = rows["time_s"].to_numpy() / (rows["time_s"].iloc[-1] if time == "unit" else 1.0)
    angle = rows["angle_rad"].to_numpy() * (0.0 if still else 1.0)
    found = area_from_the_equations(
        clock, angle, one.facts["mass_kg"]["thorax"][mass], 1.1 if pivot == "mid_ankle" else 0.4, sign,
        (np.array(regulator.state_weight), 2.0 if pivot == "hip" else regulator.control_weight,
         np.array(regulator.terminal_weight)), 1.0, 9.81,
    )  # fmt: skip
    assert cell["null_area" if still else "mean_area"] == pytest.approx(found, rel=1e-6)


def test_every_convention_has_its_area_or_a_reason(study):
    assert list(study.grid.columns) == [*columns_of(table_4_1_grid.__file__, "grid_areas"), "experience"]
    assert len(study.grid) == 3 * len(GRID) * 6
    assert (study.grid["reason"] == "").all() and study.grid["mean_area"].notna().all()
    without = grid_areas(lift_states(hips=False), INVERTED)
    own = (without[list(vars(OWN.pendulum))] == list(vars(OWN.pendulum).values())).all(axis=1)
    assert without.loc[~own, "mean_area"].isna().all() and without.loc[own, "mean_area"].notna().all()
    assert without.loc[~own, "reason"].str.contains("no pendulum states of (?:mid_ankle|hip), ").all()


def test_one_lost_convention_leaves_the_others_their_areas(monkeypatch):
    def areas(trajectories, signs, settings):
        for item, sign in zip(trajectories, signs, strict=True):
            if (item.com, item.pivot, item.clock, sign) == ("pelvis", "hip", "unit", "inverted"):
                raise NumericalError(f"{item.label}: out of reach")
        return np.ones((len(trajectories), 2))

    monkeypatch.setattr(table_4_1_grid, "areas_with_null", areas)
    found = grid_areas(lift_states(), INVERTED)
    lost = found[found["mean_area"].isna()]
    assert len(found) == 6 * len(GRID) and len(lost) == 4
    assert set(lost["com"]) == {"pelvis"} and set(lost["mass"]) == {"with_box", "without_box"}
    assert lost["reason"].str.contains("out of reach").all()


def test_table_4_1_stands_beside_the_published_one(made, published):
    table, controls, _, missing = made
    assert missing.empty
    assert table.frame[["comparison", "com"]].equals(published[["comparison", "com"]])
    assert set(published.columns) <= set(table.frame.columns)
    assert (
        table.frame["lateral_bending_published_percent"].tolist()
        == published["lateral_bending_percent"].tolist()
    )
    status = table.frame.set_index("comparison")["status"]
    assert set(status["expert_vs_novice"]) == {"computed"}
    assert status["decrease_in_mass_novice"].str.startswith("not testable: one box mass").all()
    assert "–" in table.to_html() and "nan" not in table.to_latex() + controls.to_html()
    for name in ("percent", "lowest", "exponents"):
        assert not re.search(f"<th[^>]*>{name}", table.to_html() + controls.to_html())


def test_controls_hold_the_headline_within_its_range(made, study):
    table, controls, grid, _ = made
    rows = controls.frame[controls.frame["comparison"] == "expert_vs_novice"]
    assert ((rows["lowest_percent"] <= rows["percent"]) & (rows["percent"] <= rows["highest_percent"])).all()
    assert (rows["grid_lowest_percent"] <= rows["percent"] + 1e-3).all()
    first = rows.set_index(["com", "plane"]).loc[("pelvis", "flexion_extension"), "percent"]
    shown = table.frame.set_index(["comparison", "com"]).loc[("expert_vs_novice", "pelvis")]
    assert first == shown["flexion_extension_headline_percent"]
    assert rows["verdict"].str.contains("no interval").all()
    html = controls.to_html()
    assert "body mass ±10 %" in html and "neither varies the segment table" in html
    in_grid = grid.query(
        "comparison == 'expert_vs_novice' and com == 'pelvis' and plane == 'flexion_extension'"
    )
    cell = in_grid[(in_grid[list(vars(THESIS))] == list(vars(THESIS).values())).all(axis=1)]
    assert cell["percent"].item() == pytest.approx(shown["flexion_extension_percent"], abs=1e-3)


def grid_by_hand(values):
    """Areas of an expert and a novice with one box: ``{sign: (moving, still)}`` of the expert, the novice's are 1."""
    rows = [
        {"experience": who, "subject": who, "box_mass_kg": 23.0, "com": com, "plane": plane, "sign": sign, "time": "real",
         "mass": "with_box", "pivot": "hip", "segment_ends": "inner", "deposit_start": "descent",
         "mean_area": areas[0] if who == "expert" else 1.0,
         "null_area": areas[1] if who == "expert" else 1.0, "reason": ""}
        for who in ("expert", "novice") for sign, areas in values.items() for com in COMS for plane in PLANES
    ]  # fmt: skip
    return pd.DataFrame(rows)


def test_a_lighter_box_is_asked_for_where_it_counts():
    names = ["comparison", "com", "plane", "percent", "null_percent", *vars(THESIS)]
    counted = dict(
        zip(
            names,
            ["decrease_in_mass_expert", "pelvis", "frontal", 20.0, 19.0, *vars(THESIS).values()],
            strict=True,
        )
    )
    cells = [
        {**counted, "mass": mass, "percent": percent}
        for mass, percent in (("with_box", 20.0), ("without_box", -0.1))
    ]
    grid = pd.DataFrame(cells)
    assert survivors(grid) == [("decrease_in_mass_expert", "pelvis", "frontal")]
    assert "(decrease in mass expert: 1;" in survival_sentence(grid)
    people = grid.assign(comparison="expert_vs_novice")
    assert survivors(people) == []


def test_what_survives_the_grid_is_said():
    groups = ("expert", "novice")
    both = grid_differences(grid_by_hand({"hanging": (1.2, 1.05), "inverted": (1.5, 1.0)}), groups)
    row = both.iloc[0]
    assert row["percent"] == pytest.approx(20) and row["null_percent"] == pytest.approx(5)
    assert row["movement_points"] == pytest.approx(15) and len(survivors(both)) == 6
    assert survival_sentence(both).endswith(": expert vs novice: all")
    turned = grid_differences(grid_by_hand({"hanging": (0.9, 1.0), "inverted": (1.5, 1.0)}), groups)
    assert survival_sentence(turned).startswith(
        "Of 6 differences none keeps its sign under all conventions that can express them (expert vs novice: 2;"
    )
    moved = both[both["comparison"] == "movement_expert_23kg"]
    assert set(moved["percent"].round(6)) == {round(100 * (1.2 / 1.05 - 1), 6), 50.0}
    assert not grid_table(both, FAST, "test").to_html().count("grid_lowest")


def test_published_columns_contradict_one_another(published):
    text = published_sentence(published)
    assert "correlate -0.87" in text and "6 of 9 rows have opposite signs" in text


def test_the_picture_has_a_panel_per_comparison_and_shows_a_lone_lift(made, published):
    figure = grid_figure(made[2])
    assert [axis.get_title() for axis in figure.axes] == ["expert vs novice", "decrease in mass expert"]
    alone = grid_differences(
        grid_areas(lift_states(), FAST).assign(experience="expert"), ("expert", "novice")
    )
    assert [axis.get_title() for axis in grid_figure(alone).axes] == ["movement expert 23kg"]
