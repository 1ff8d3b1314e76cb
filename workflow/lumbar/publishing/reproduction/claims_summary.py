"""The claims as a table for print: verdicts counted by place in the thesis, and the sentences one by one."""

from __future__ import annotations

import pandas as pd

from lumbar.tables.table import Table

DEFINITIONS = {
    "location": "Section or table of the thesis",
    "statement": "What the thesis says",
    "thesis_value": "The thesis's value",
    "this_run": "This run's counterpart",
    "verdict": (
        "holds; does not hold; built into the data (agrees, but the synthetic data were made to show it); cannot be "
        "tested on this data"
    ),
    "criterion": "When this run is said to agree",
}


def _shown(value) -> str:
    return (
        f"{value:.4g}"
        if isinstance(value, float) and value == value
        else str(value if value == value else "–")
    )


def summary_table(claims: pd.DataFrame, data: str) -> Table:
    """Return the claims as a table: sentences first, then the cells of the published tables."""
    counts = claims.verdict.value_counts()
    notes = "; ".join(f"{verdict}: {counts[verdict]}" for verdict in counts.index)
    frame = claims[list(DEFINITIONS)].astype(object).where(claims[list(DEFINITIONS)].notna(), None)
    for column in ("thesis_value", "this_run"):
        frame[column] = [_shown(value) if value is not None else "–" for value in frame[column]]
    return Table(
        title="Claims of the thesis against this run.",
        frame=frame,
        definitions=DEFINITIONS,
        data=data,
        notes=(f"{len(claims)} claims. {notes}",),
        first=tuple(DEFINITIONS),
        first_rows=tuple((~claims.claim.str.startswith("table_")).to_numpy().nonzero()[0]),
    )
