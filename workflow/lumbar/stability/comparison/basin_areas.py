"""The areas of all basins and their checks as a published table."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lumbar.stability.basins import COLUMNS
from lumbar.tables import Table

if TYPE_CHECKING:
    import pandas as pd


def areas_table(boa: pd.DataFrame, data: str) -> Table:
    """Return the areas of all basins and their checks as a published table."""
    import pandas as pd

    # Counts with empty cells: as objects they print as whole numbers.
    counts = pd.Series([None if pd.isna(item) else int(item) for item in boa["control_exits"]], dtype=object)
    frame = boa[list(COLUMNS)].assign(control_exits=counts.to_numpy())
    optional = {"control_exits", "proved_share", "proved_area_ratio"}
    optional |= {name for name in COLUMNS if name.startswith("sos_")}
    optional |= {"violation_share", "unsolved_share", "euler_error"}
    return Table(
        title="Areas of all basins of attraction, and what was checked of each.",
        frame=frame,
        definitions=COLUMNS,
        data=data,
        may_be_empty=frozenset(optional),
    )
