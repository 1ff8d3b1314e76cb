"""What the pages say of the choices behind Table 4.1, against the reference results of the default study."""

import pandas as pd
import pytest

from lumbar.lifting.stability.comparison.table_4_1_grid import CHOICES, single_changes
from lumbar.lifting.stability.model.trajectories import THESIS, Convention

HEADLINE = Convention("inverted", "real", "with_box", "mid_ankle", "inner", "descent")
"""Of the default study."""


@pytest.fixture(scope="module")
def changes(project):
    """By choice: signs turned and largest move in percentage points, in the thesis's wording and in the headline."""
    grid = pd.read_csv(project / "tests" / "reference" / "table_4_1_grid.csv")
    if not set(CHOICES) <= set(grid.columns):
        pytest.skip("the reference results are older than the grid's choices: make update-reference")
    found = {}
    for base in (THESIS, HEADLINE):
        for choice, rows in single_changes(grid, base).groupby("choice", sort=False):
            turned = int((rows["changed"] * rows["percent"] < 0).sum())
            found.setdefault(choice, []).append((turned, (rows["changed"] - rows["percent"]).abs().max()))
    return found


def test_basins_md_has_what_each_choice_changes(project, changes):
    page = (project / "docs" / "lifting" / "basins.md").read_text(encoding="utf-8")
    assert len(changes) == len(CHOICES)
    for choice, sides in changes.items():
        cells = [f"{turned} sign{'' if turned == 1 else 's'}, {moved:.1f} points" for turned, moved in sides]
        assert f"| {choice} | {' | '.join(cells)} |" in page


def test_centres_of_mass_md_has_what_the_ends_of_segments_change(project, changes):
    page = " ".join((project / "docs" / "lifting" / "centres_of_mass.md").read_text(encoding="utf-8").split())
    (turned, moved), (none, most) = changes["segment ends"]
    assert f"**{turned} of the 18 signs in the thesis's wording**" in page and none == 0
    assert f"more than {moved:.1f} percentage points" in page and f"by up to {most:.1f} points" in page
