"""Tables and figures of basins: percent differences, changed weights, the lift that is shown."""

import numpy as np
import pandas as pd
import pytest
from stability_cases import SETTINGS, lift

from lumbar.lifting.stability.basins import CHECK_COLUMNS, areas_table, basins_of_lift, boa_columns
from lumbar.lifting.stability.changed_pendulums import varied_areas
from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import close_loops
from lumbar.lifting.stability.model.pendulum_trajectories import (
    COMS,
    PLANES,
    scale_to_unit_time,
)
from lumbar.lifting.stability.percent_differences import comparisons_of, percent_differences
from lumbar.publishing.figures.stability_figures import figure_4_3, select_lift
from study_settings import changed


@pytest.fixture(scope="module")
def basins():
    settings = changed(SETTINGS, checks=["thesis_method"])
    return basins_of_lift(lift(), settings, 1, [scale_to_unit_time(item) for item in lift()])


def test_figure_4_3_has_the_thesis_s_and_the_exact_funnels(basins):
    axes = np.reshape(figure_4_3(basins.funnels, SETTINGS).axes[:9], (3, 3))
    columns = [("thesis", "thesis"), ("thesis", "exact"), ("study", "exact")]
    rows = basins.funnels.query("com == 'abdomen' and plane == 'flexion_extension'")
    for names, panel, curve in zip(columns, axes[0], axes[2], strict=True):
        funnel = rows.set_index(["wording", "method"]).loc[[names]]
        assert ("certificate" in panel.get_title()) == (names[1] == "thesis")
        assert curve.lines[0].get_ydata() == pytest.approx(funnel["rho"].to_numpy())
        dashed = next(line for line in panel.lines if line.get_linestyle() == "--").get_xydata()
        x, y = dashed.T
        enclosed = 0.5 * abs(np.dot(x[:-1], y[1:]) - np.dot(x[1:], y[:-1]))
        assert enclosed == pytest.approx(funnel["area_rad2_s"].iloc[0], rel=2e-3)  # a polygon of 80 corners


def test_areas_table_omits_checks_that_were_not_made(basins):
    settings = changed(SETTINGS, checks=[])
    page = areas_table(basins_of_lift(lift(), settings, seed=1).summary, settings, "test")
    assert "exits" not in page.frame and "stability.checks" in page.to_html()
    assert set().union(*CHECK_COLUMNS.values()) <= set(basins.summary) == set(boa_columns())


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
    actual = percent_differences(rows_of(areas), "mean_area", comparisons_of(list(areas)))
    rows = {row["comparison"]: row for row in actual}
    assert rows["expert_vs_novice"]["lateral_bending"] == pytest.approx(10.0)
    assert rows["decrease_in_mass_expert"]["flexion_extension"] == pytest.approx(25.0)
    assert rows["decrease_in_mass_novice"]["flexion_extension"] == pytest.approx(-50.0)


def test_variants_change_the_named_weight():
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
    assert select_lift(facts, labels, "trained") == 2
    assert select_lift(facts, labels, "untrained") == 0
    assert select_lift(facts[:1], labels, "trained") == 0
    assert select_lift(facts[3:], labels, "trained") == 0
