"""Table 4.1 by the thesis's method after one, two and four alternations, from areas made by hand."""

from itertools import product
from types import SimpleNamespace

import pandas as pd
import pytest

from lumbar.lifting.stability.comparison.percent_differences import Study
from lumbar.lifting.stability.comparison.table_4_1 import alternations_table
from lumbar.lifting.stability.model.trajectories import COMS, PLANES, THESIS
from lumbar.settings.stability import StabilitySettings

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
    study = Study(lifts, pd.DataFrame(rows), pd.DataFrame(), StabilitySettings(), published, "test")
    return alternations_table(study)


def test_cells_of_the_basin_that_jumps_move_and_no_others(project):
    made = table(project, jumps=4.0)
    cells = made.frame.set_index(["comparison", "com", "plane"])
    assert cells.loc[("expert_vs_novice", "pelvis", "lateral_bending"), "published_percent"] == 4.44
    moved = cells[cells["thesis_percent"] != 0]["thesis_percent"].to_dict()
    assert moved == {
        ("expert_vs_novice", "pelvis", "lateral_bending"): pytest.approx(5.0),
        ("decrease_in_mass_expert", "pelvis", "lateral_bending"): pytest.approx(100 * (2 / 2.1 - 1)),
    }
    assert (cells[["after_1_percent", "exact_percent"]] == 0).all(axis=None)
    jumps, sizes, more, digits = made.notes
    assert "In 1 of 24 basins" in jumps
    assert (
        "expert 23 kg, pelvis, lateral bending: 8 knots from 0.015 T to 0.022 T, by up to 3.7, mean area +5.0 %"
        in jumps
    )
    assert "lateral bending: 7.5 % published, 0.0 exact, 0.0 after 1 alternation, 5.0 after 2" in sizes
    assert more == (
        "4 alternations in place of 2: a cell changes by 95 percentage points, the alternation has not converged"
    )
    # Of 2 rad²/s a hundredth is the last digit that means something.
    assert "the last of which is up to 0.5 % of an area" in digits


def test_where_nothing_jumps_it_says_so(project):
    jumps, _, more, _ = table(project, jumps=2.0).notes
    assert jumps == "In none of 24 basins a further alternation than the first has a multiplier at any knot"
    assert more == "4 alternations in place of 2: no cell changes"
