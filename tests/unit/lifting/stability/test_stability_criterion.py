"""What alternations change in Table 4.1, and the claims on basins; against areas by hand."""

import re
from itertools import product
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from stability_cases import SETTINGS, lift

from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import close_loops
from lumbar.lifting.stability.model.pendulum_trajectories import COMS, PLANES, THESIS
from lumbar.lifting.stability.percent_differences import ComparedLifts
from lumbar.lifting.stability.table_4_1 import alternations_table
from lumbar.publishing.reproduction.claim import UntestableError
from lumbar.publishing.reproduction.claims import MAX_RATIO, sentence_claims
from lumbar.settings.lifting import StabilitySettings
from refusing import has_tokens

FAST = SETTINGS.model_copy(update={"knots": 253, "checks": ()})


def test_reach_is_the_farthest_point_of_the_ellipses():
    funnels = exact_funnels(close_loops(lift(), "inverted", FAST))
    circle = np.linspace(0, 2 * np.pi, 2001)
    for index in range(2):
        farthest = np.zeros(2)
        for cost, level in zip(funnels.cost[:, index], funnels.level[:, index], strict=True):
            eigen, vectors = np.linalg.eigh(cost[[0, 1, 1, 2]].reshape(2, 2) / level)
            border = vectors / np.sqrt(eigen) @ [np.cos(circle), np.sin(circle)]
            farthest = np.maximum(farthest, np.abs(border).max(axis=1))
        assert funnels.reach[index] == pytest.approx(farthest, rel=1e-5)


@pytest.mark.parametrize(("reach", "agrees"), [(0.5, False), (0.09, True), (0.0005, False)])
def test_the_claim_is_judged_in_both_states(reach, agrees):
    claim = next(item for item in sentence_claims("basins") if item.id == "basins_like_states")
    row = {
        "method": "exact",
        "sign": "hanging",
        "time": "unit",
        "angle_range_rad": 0.01,
        "angle_reach_rad": reach,
    }
    row |= {"velocity_range_rad_s": 0.1, "velocity_reach_rad_s": 0.5}
    actual = claim.judge({"boa": pd.DataFrame([row])})
    assert actual.agrees is agrees and has_tokens(actual.value, f"{reach / 0.01:.3g}…angle")
    fast = {**row, "velocity_reach_rad_s": 0.1 * MAX_RATIO * 1.01}
    assert claim.judge({"boa": pd.DataFrame([fast])}).agrees is False
    still = {**row, "angle_range_rad": 0.0}
    with pytest.raises(UntestableError):
        claim.judge({"boa": pd.DataFrame([still])})


def judged(name, results):
    claim = next(item for item in sentence_claims("basins") if item.id == name)
    return claim.judge(results).agrees


def test_movements_are_asked_for_comparison_by_comparison():
    """Differences between boxes, large and from the mass, do not decide on those between people; one without its null on none."""
    cells = [
        {"comparison": comparison, "percent": percent, "null_percent": null}
        for comparison, percent, null in (
            ("expert_vs_novice", 2.0, 0.2),
            ("decrease_in_mass_expert", 20.0, 19.9),
            ("decrease_in_mass_novice", 20.0, 19.9),
            ("expert_vs_novice", 9.0, np.nan),
        )
    ]
    results = {"table_4_1_controls": pd.DataFrame(cells)}
    assert judged("trajectories_matter", results) is True
    assert judged("trajectories_matter_with_mass", results) is False


def test_the_thesis_s_basins_and_ours_are_two_claims():
    rows = [
        {"method": "thesis", "simulated_starts": 200, "exits": 53},
        {"method": "exact", "simulated_starts": 200, "exits": 0},
    ]
    results = {"boa": pd.DataFrame(rows)}
    assert judged("basins_reach_goal", results) is False
    assert judged("exact_is_invariant", results) is True


JUMPING = ("expert", 23.0, "pelvis", "lateral_bending")


def table(project, jumps):
    """Areas of 2 rad²/s; where it jumps 2.1 after two alternations and `jumps` after four."""
    rows = []
    for experience, box, com, plane in product(("expert", "novice"), (15.0, 23.0), COMS, PLANES):
        here = (experience, box, com, plane) == JUMPING and jumps > 2.0
        row = {
            "subject": experience,
            "experience": experience,
            "box_mass_kg": box,
            "com": com,
            "plane": plane,
        }
        row |= vars(THESIS)
        row |= {"mean_area_after_1": 2.0, "mean_area_after_4": jumps if here else 2.0}
        row |= {
            "jumped_knots": 8 if here else 0,
            "largest_jump": 3.7 if here else 1.0,
            "first_jump": 0.015,
            "last_jump": 0.022,
        }
        rows += [
            row | {"method": "exact", "mean_area": 2.0},
            row | {"method": "thesis", "mean_area": 2.1 if here else 2.0},
        ]
    lifts = [
        SimpleNamespace(facts={"experience": name, "box_mass_kg": box})
        for name, box in product(("expert", "novice"), (15.0, 23.0))
    ]
    published = pd.read_csv(project / "resources" / "thesis" / "table_4_1.csv")
    study = ComparedLifts(lifts, pd.DataFrame(rows), StabilitySettings(), published, "test")
    return alternations_table(study)


def test_cells_of_the_basin_that_jumps_move_and_no_others(project):
    tables = table(project, jumps=4.0)
    cells = tables.frame.set_index(["comparison", "com", "plane"])
    assert cells.loc[("expert_vs_novice", "pelvis", "lateral_bending"), "published_percent"] == 4.44
    moved = cells[cells["thesis_percent"] != 0]["thesis_percent"].to_dict()
    assert moved == {
        ("expert_vs_novice", "pelvis", "lateral_bending"): 5,
        (
            "decrease_in_mass_expert",
            "pelvis",
            "lateral_bending",
        ): -5,  # 100·(2/2.1 − 1) = −4.76, in whole points
    }
    assert ">-5<" in tables.to_html() and "4.8" not in tables.to_html()
    assert (cells[["after_1_percent", "exact_percent"]] == 0).all(axis=None)
    jumps, sizes, more, digits = tables.notes
    assert re.findall(r"[-+]?\d+\.\d+", jumps) == ["0.015", "0.022", "3.7"]
    assert has_tokens(sizes.split(";")[0], "7.5 % published, 0.0 exact, 0 after 1 alternation, 5 after 2")
    assert "95" in more
    # The last significant digit of 2 rad²/s is a hundredth.
    assert has_tokens(digits, "up to 1 %…up to 0.5 %")


def test_table_without_jumps_reports_none(project):
    assert table(project, jumps=2.0).frame["after_4_percent"].eq(0).all()
