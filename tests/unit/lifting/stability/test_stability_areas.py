"""Trajectories, all basins of a lift, Table 4.1 and its figures: bad input, definitions, reproducibility."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from lifting_cases import minimum_jerk

from lumbar.base.errors import InputError
from lumbar.lifting.stability.basins import CHECK_COLUMNS, areas_table, basins_of_lift, boa_columns
from lumbar.lifting.stability.changed_pendulums import varied_areas
from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import close_loops
from lumbar.lifting.stability.model.pendulum_trajectories import (
    COMS,
    PLANES,
    find_problems,
    in_unit_time,
    trajectories_of_lift,
)
from lumbar.lifting.stability.percent_differences import comparisons_of, percent_differences
from lumbar.publishing.figures.stability_figures import figure_4_3, shown_lift
from lumbar.settings.stability import StabilitySettings
from study_settings import changed

SETTINGS = changed(
    StabilitySettings(),
    pendulum={"sign": "hanging"},
    regulator={"control_weight": 1e-3},
    knots=201,
    checks=["simulation", "thesis_method", "proof"],
    proof={"margin_1_s": 0.05},
    thesis_method={"knots": 5},
    attack={"starts": 400, "control_overstated": 0.3},
    fewer_knots=101,
    lyapunov_shares=[0.0, 1.0],
)


def lift(subject="expert", box=23.0, mass=33.0, duration=1.5):
    return [
        minimum_jerk(
            subject=subject, box=box, com=com, plane=plane, mass=mass, duration=duration, start=start
        )
        for com in COMS
        for plane, start in zip(PLANES, (0.1, 0.4), strict=True)
    ]


def states_and_facts(items):
    frames = [
        pd.DataFrame(
            {
                "com": item.com,
                "plane": item.plane,
                "time_s": item.time,
                "angle_rad": item.angle,
                "angular_velocity_rad_s": item.angular_velocity,
                "angular_acceleration_rad_s2": item.angular_acceleration,
            }
        )
        for item in items
    ]
    facts = {
        "subject": "expert",
        "experience": "expert",
        "box_mass_kg": 23,
        "pivot": "mid_ankle",
        "segment_ends": "inner",
        "deposit_start": "descent",
        "mass_kg": {com: {"with_box": 40.0, "without_box": 17.0} for com in COMS},
        "length_m": {com: dict.fromkeys(PLANES, 1.1) for com in COMS},
        "box": {"share": "by_mass"},
    }
    return pd.concat(frames), facts


@pytest.fixture(scope="module")
def basins():
    return basins_of_lift(lift(), SETTINGS, 1, [in_unit_time(item) for item in lift()])


def test_mass_with_and_without_the_box():
    states, facts = states_and_facts(lift())
    assert trajectories_of_lift(states, facts, "with_box")[0][0].mass_kg == 40.0
    found, _ = trajectories_of_lift(states, facts, "without_box")
    assert found[0].mass_kg == 17.0
    assert [(item.com, item.plane) for item in found] == [(com, plane) for com in COMS for plane in PLANES]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda item: {"angle": item.angle + 3.0}, "angle 3.4 rad; .* within ±π"),
        (lambda item: {"time": np.where(np.arange(400) == 7, 0.0, item.time)}, "sample 8: time 0 s after"),
        (lambda item: {"time": item.time[:5]}, "5 samples; at least 20"),
        (lambda item: {"length_m": 0.02}, "length_m: 0.02; .*another pivot"),
        (lambda item: {"mass_kg": 0.0}, "mass_kg: 0; a positive mass"),
        (lambda item: {"angle": np.where(np.arange(400) == 3, np.nan, item.angle)}, "sample 4: angle is nan"),
        (lambda item: {"angular_velocity": 2 * item.angular_velocity}, "strays from the angle by"),
    ],
)
def test_bad_trajectories_are_named(change, message):
    item = minimum_jerk()
    problems = find_problems(replace(item, **change(item)))
    with pytest.raises(InputError, match=message):
        problems.raise_if_any()
    assert problems.subject == "expert 23 kg, abdomen, flexion_extension"


def test_unsound_trajectories_drop_out_alone_and_named():
    states, facts = states_and_facts(lift())
    facts["length_m"]["pelvis"] = dict.fromkeys(PLANES, 0.02)
    states = states[~((states["com"] == "thorax") & (states["plane"] == "lateral_bending"))]
    sound, failures = trajectories_of_lift(states, facts, "with_box")
    assert [(item.com, item.plane) for item in sound] == [
        ("thorax", "flexion_extension"),
        ("abdomen", "lateral_bending"),
        ("abdomen", "flexion_extension"),
    ]
    found = {(item.com, item.plane): item.reason for item in failures}
    assert found["thorax", "lateral_bending"].startswith("0 samples; at least 20")
    assert found["pelvis", "flexion_extension"].startswith("length_m: 0.02")
    assert {item.subject for item in failures} == {"expert"} and len(failures) == 3


def test_summary_holds_every_engine_and_convention(basins):
    summary = basins.summary
    assert list(summary.columns) == boa_columns()
    counts = summary.groupby(["method", "time"]).size().to_dict()
    assert counts == {
        ("exact", "real"): 6,
        ("exact", "unit"): 6,
        ("thesis", "unit"): 6,
    }
    assert set(summary.loc[summary["time"] == "unit", "duration_s"]) == {1.0}
    areas = summary[["mean_area", "initial_area", "minimum_area", "final_area"]]
    assert np.isfinite(areas).all(axis=None) and (areas > 0).all(axis=None)
    exact = summary[summary["method"] == "exact"]
    assert (exact["exits"] == 0).all() and (exact["control_exits"] > 0).all()
    assert (exact["initial_area"] < exact["liouville_area"]).all()
    assert exact["final_area"].to_numpy() == pytest.approx(np.pi / np.sqrt(1000))


@pytest.mark.parametrize(
    ("wording", "method", "time", "digits"),
    [
        ("study", "exact", "real", 1e-4),
        ("thesis", "exact", "unit", 1e-4),
        ("thesis", "thesis", "unit", 1e-2),  # printed with the digits that it has
    ],
)
def test_funnel_file_gives_the_areas(basins, wording, method, time, digits):
    one = basins.funnels.query(
        "wording == @wording and method == @method and com == 'pelvis' and plane == 'lateral_bending'"
    )
    area = np.pi * one["rho"] / np.sqrt(one["s11"] * one["s22"] - one["s12"] ** 2)
    assert area.to_numpy() == pytest.approx(one["area_rad2_s"].to_numpy())
    row = basins.summary.query(
        "com == 'pelvis' and plane == 'lateral_bending' and method == @method and time == @time"
    ).iloc[0]
    mean = np.trapezoid(area, one["time_s"]) / one["time_s"].iloc[-1]
    assert mean == pytest.approx(row["mean_area"], rel=digits)


def test_figure_4_3_draws_the_thesiss_funnel_beside_the_exact_ones(basins):
    axes = np.reshape(figure_4_3(basins.funnels, SETTINGS).axes[:9], (3, 3))
    columns = [("thesis", "thesis"), ("thesis", "exact"), ("study", "exact")]
    rows = basins.funnels.query("com == 'abdomen' and plane == 'flexion_extension'")
    for names, panel, curve in zip(columns, axes[0], axes[2], strict=True):
        funnel = rows.set_index(["wording", "method"]).loc[[names]]
        assert ("no certificate" in panel.get_title()) == (names[1] == "thesis")
        assert curve.lines[0].get_ydata() == pytest.approx(funnel["rho"].to_numpy())
        dashed = next(line for line in panel.lines if line.get_label() == "basin at t = 0").get_xydata()
        x, y = dashed.T
        enclosed = 0.5 * abs(np.dot(x[:-1], y[1:]) - np.dot(x[1:], y[:-1]))
        assert enclosed == pytest.approx(funnel["area_rad2_s"].iloc[0], rel=2e-3)  # a polygon of 80 corners


def test_same_seed_same_rows_and_checks_may_be_left_out(basins):
    settings = SETTINGS.model_copy(update={"checks": ("simulation", "proof")})
    again = basins_of_lift(lift(), settings, seed=1).summary
    exact = basins.summary.query("method == 'exact' and time == 'real'").reset_index(drop=True)
    pd.testing.assert_frame_equal(again, exact, check_dtype=False)
    other = basins_of_lift(lift(), settings, seed=2).summary
    assert (other["exits"] == 0).all()
    assert other["control_exits"].tolist() != again["control_exits"].tolist()
    bare = basins_of_lift(lift(), SETTINGS.model_copy(update={"checks": ()}), seed=1).summary
    assert bare["mean_area"].to_numpy() == pytest.approx(again["mean_area"].to_numpy(), rel=1e-12)
    for names in CHECK_COLUMNS.values():
        assert bare[list(names)].isna().all(axis=None)
    page = areas_table(bare, SETTINGS.model_copy(update={"checks": ()}), "test")
    assert "exits" not in page.frame and "not chosen: simulation" in page.to_html()


def rows_of(values):
    return pd.DataFrame(
        [
            {"experience": name, "box_mass_kg": box, "com": com, "plane": plane, "mean_area": area}
            for (name, box), area in values.items()
            for com in COMS
            for plane in PLANES
        ]
    )


def test_percent_differences_by_hand():
    areas = {("expert", 23.0): 2.2, ("expert", 15.0): 2.75, ("novice", 23.0): 2.0, ("novice", 15.0): 1.0}
    found = percent_differences(rows_of(areas), "mean_area", comparisons_of(list(areas)))
    rows = {row["comparison"]: row for row in found}
    assert rows["expert_vs_novice"]["lateral_bending"] == pytest.approx(10.0)
    assert rows["decrease_in_mass_expert"]["flexion_extension"] == pytest.approx(25.0)
    assert rows["decrease_in_mass_novice"]["flexion_extension"] == pytest.approx(-50.0)


def test_variants_are_what_they_say():
    items = lift()[:2]
    fine = SETTINGS.model_copy(update={"fewer_knots": SETTINGS.knots})
    varied = varied_areas(dict.fromkeys(("R/", "b*"), items), fine)
    doubled = changed(SETTINGS, pendulum={"damping_N_m_s": 2.0})
    assert varied["b*"] == pytest.approx(
        exact_funnels(close_loops(items, "hanging", doubled)).mean_area, rel=1e-7
    )
    regulator = {"control_weight": 5e-4}
    halved = changed(SETTINGS, regulator=regulator)
    assert varied["R/"] == pytest.approx(
        exact_funnels(close_loops(items, "hanging", halved)).mean_area, rel=1e-7
    )


def test_shown_lift_is_the_groups_heaviest_that_has_a_deposit():
    facts = [
        {"subject": "ann", "box_mass_kg": 30, "duration_s": 1.0},
        {"subject": "bob", "box_mass_kg": 15, "duration_s": 1.0},
        {"subject": "bob", "box_mass_kg": 23, "duration_s": 1.0},
        {"subject": "bob", "box_mass_kg": 40, "duration_s": None},
    ]
    labels = {"ann": "untrained", "bob": "trained"}
    assert shown_lift(facts, labels, "trained") == 2
    assert shown_lift(facts, labels, "untrained") == 0
    assert shown_lift(facts[:1], labels, "trained") == 0
    assert shown_lift(facts[3:], labels, "trained") == 0
