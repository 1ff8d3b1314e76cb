"""What makes the differences of Table 4.1: parts of every headline difference of the default study, for docs/lifting/basins.md.

    python benchmarks/table_4_1_parts.py [--results results/thesis] [--markdown docs/lifting/basins.md]

Needs ``snakemake table_4_1_parts``. With ``--markdown`` the table goes into that page.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from one_thread import PROJECT  # isort: skip

import pandas as pd

from acceptance_page import show_section

PARTS = ("duration", "length", "mass", "start", "course")


def report(table: pd.DataFrame) -> list[str]:
    """One row per comparison, centre of mass and plane: the difference and its parts, in points."""
    sums = table[[f"{part}_percent" for part in PARTS]].sum(axis=1)
    if (sums - table["percent"]).abs().max() > 1e-6:
        raise ValueError("the parts do not add up to the differences")
    lines = [f"| comparison | centre of mass, plane | difference | {' | '.join(PARTS)} |", "|---" * 8 + "|"]
    for row in table.to_dict("records"):
        where = f"{row['com']}, {row['plane'].replace('_', ' ')}"
        numbers = [row["percent"], *(row[f"{part}_percent"] for part in PARTS)]
        comparison = row["comparison"].replace("_vs_", " against ").replace("_", " ")
        lines.append(f"| {comparison} | {where} | " + " | ".join(map(_signed, numbers)) + " |")
    return lines


def _signed(value: float) -> str:
    text = f"{value:+.1f}".replace("-", "−")
    return "0.0" if text[1:] == "0.0" else text


def main() -> None:
    """Print the table, and write it into a page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--results", type=Path, default=PROJECT / "results" / "thesis")
    parser.add_argument("--markdown", type=Path)
    options = parser.parse_args()
    source = options.results / "tables" / "table_4_1_parts.csv"
    if not source.is_file():
        sys.exit(f"{source}: not there; make it first: snakemake --cores 2 table_4_1_parts")
    show_section(options.markdown, "parts of Table 4.1", report(pd.read_csv(source)))


if __name__ == "__main__":
    main()
