"""All claims, examined: the rows of ``claims.csv``, and their table for print."""

import pandas as pd

from lumbar.publishing.reproduction import basin_claims as basins
from lumbar.publishing.reproduction.article_claims import identification_sentences, rating_sentences
from lumbar.publishing.reproduction.claim import Claim, Results, examine, verdict
from lumbar.publishing.reproduction.table_cells import table_3_1_claims, table_3_2_claims, table_4_1_claims
from lumbar.settings.stability import GROUPS
from lumbar.tables.described import columns_of, described
from lumbar.tables.table import Table


def all_claims(
    thesis_tables: dict[str, pd.DataFrame], synthetic: bool, groups: tuple[str, str] = GROUPS
) -> list[Claim]:
    """Return every claim in the thesis's order.

    Parameters
    ----------
    thesis_tables : dict of str to pandas.DataFrame
        ``table_3_1``, ``table_3_2`` and ``table_4_1`` as published.
    synthetic : bool
        Whether the data are the synthetic twin.
    groups : tuple of str
        Whom the study compares in place of the thesis's expert and novice.
    """
    claims = [
        *identification_sentences(),
        *table_3_1_claims(thesis_tables["table_3_1"]),
        *rating_sentences(),
        *table_3_2_claims(thesis_tables["table_3_2"]),
        *basins.sentences(synthetic, groups),
        *table_4_1_claims(thesis_tables["table_4_1"], synthetic, groups),
    ]
    names = [claim.id for claim in claims]
    repeated = {name for name in names if names.count(name) > 1}
    if repeated:
        raise ValueError(f"claims named twice: {sorted(repeated)}")
    return claims


def examine_claims(claims: list[Claim], results: Results, synthetic: bool, source_label: str) -> pd.DataFrame:
    """Examine all claims on the results of one run.

    Columns ``claim, location, statement, thesis_value, this_run, verdict, criterion, remark, evidence, data``.
    """
    rows = []
    for claim in claims:
        finding = examine(claim, results)
        rows.append(
            {
                "claim": claim.id,
                "location": claim.location,
                "statement": claim.statement,
                "thesis_value": claim.thesis,
                "this_run": finding.value,
                "verdict": verdict(claim, finding, synthetic),
                "criterion": claim.criterion,
                "remark": finding.remark,
                "evidence": " ".join(claim.needs),
                "data": source_label,
            }
        )
    return pd.DataFrame(rows)


def _shown(value) -> str:
    return (
        f"{value:.4g}"
        if isinstance(value, float) and value == value
        else str(value if value == value else "–")
    )


def summary_table(claims: pd.DataFrame, source_label: str) -> Table:
    """Return the claims as a table: sentences first, then the cells of the published tables."""
    counts = claims.verdict.value_counts()
    notes = "; ".join(f"{verdict}: {counts[verdict]}" for verdict in counts.index)
    columns = columns_of("publishing/reproduction", "claims")
    frame = claims[columns].astype(object).where(claims[columns].notna(), None)
    for column in ("thesis_value", "this_run"):
        frame[column] = [_shown(value) if value is not None else "–" for value in frame[column]]
    return described(
        "publishing/reproduction",
        "claims",
        frame,
        source_label,
        {"count": len(claims), "verdicts": notes},
        first_rows=tuple((~claims.claim.str.startswith("table_")).to_numpy().nonzero()[0]),
    )
