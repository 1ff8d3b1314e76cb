"""The areas of all basins and their checks as a published table."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lumbar.lifting.stability.basins import CHECK_COLUMNS, COLUMNS, DTYPES
from lumbar.tables.table import Table

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.stability import StabilitySettings


AREA_HEADERS = {
    "mean_area": "Average section (rad²/s)",
    "initial_area": "Section at t = 0 (rad²/s)",
    "minimum_area": "Smallest section (rad²/s)",
    "final_area": "Goal set (rad²/s)",
    "liouville_area": "Bound by Liouville (rad²/s)",
}
"""Words over the columns of areas."""


def as_counts(column: pd.Series):
    """Return counts with empty cells as objects, which print as whole numbers."""
    import pandas as pd

    return pd.Series([None if pd.isna(item) else int(item) for item in column], dtype=object).to_numpy()


def _shares(boa: pd.DataFrame) -> list[str]:
    """Say how much of everything that reaches the goal set the exact basins hold: what the choice of V leaves."""
    notes = []
    for (sign, time, mass), rows in boa[boa["method"] == "exact"].groupby(
        ["sign", "time", "mass"], sort=False
    ):
        share = 100 * rows["initial_area"] / rows["liouville_area"]
        notes.append(
            f"At t = 0 the exact basins ({sign}, {time} time, {mass.replace('_', ' ')}) hold {share.min():.2g} to "
            f"{share.max():.2g} % of the states that reach the goal set under the same regulator"
        )
    return notes


def checks_note(settings: StabilitySettings) -> str:
    """Say which checks were made; what belongs to another has no column."""
    others = [check for check in (*CHECK_COLUMNS, "extended") if check not in settings.checks]
    return f"Checks made (stability.checks): {', '.join(settings.checks) or 'none'}; not chosen: {', '.join(others) or 'none'}"


def areas_table(boa: pd.DataFrame, settings: StabilitySettings, data: str) -> Table:
    """Return the areas of all basins and their checks as a published table, without the columns of checks not chosen."""
    chosen = [check for check in CHECK_COLUMNS if check in settings.checks]
    left_out = {name for check in CHECK_COLUMNS if check not in chosen for name in CHECK_COLUMNS[check]}
    shown = [name for name in COLUMNS if name not in left_out]
    optional = {name for check in chosen for name in CHECK_COLUMNS[check]}
    frame = boa[shown].assign(**{name: as_counts(boa[name]) for name in DTYPES if name in shown})
    drawn = (frame["method"] == "exact") & (frame["sign"] == settings.pendulum.sign)
    drawn &= (frame["time"] == settings.pendulum.time) & (frame["mass"] == settings.pendulum.mass)
    return Table(
        title="Areas of all basins of attraction, and what was checked of each.",
        frame=frame,
        definitions=COLUMNS,
        data=data,
        notes=(*_shares(boa), checks_note(settings)),
        may_be_empty=frozenset(optional),
        headers=AREA_HEADERS,
        first=("subject", "box_mass_kg", "com", "plane", "duration_s", *list(AREA_HEADERS)[:4]),
        first_rows=tuple(drawn.to_numpy().nonzero()[0]),
    )
