"""Compare the default study's tables with the reference kept here: what moved, by how much, is it allowed.

``python tests/reference/check_results.py`` exits with 1 when a number moved more than its tolerance;
``--update`` takes the present numbers as the new reference.
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import yaml

FOLDER = Path(__file__).resolve().parent
PROJECT = FOLDER.parent.parent


@dataclass(frozen=True)
class Movement:
    """One cell that is not what the reference says."""

    table: str
    row: str
    column: str
    reference: object
    found: object
    allowed: float
    within: bool

    def __str__(self) -> str:
        verdict = "allowed" if self.within else "NOT ALLOWED"
        change = ""
        if isinstance(self.reference, float) and isinstance(self.found, float):
            change = f" (moved by {self.found - self.reference:+.4g}, tolerance {self.allowed:.4g})"
        return f"{verdict}: {self.table} [{self.row}] {self.column}: {self.reference} -> {self.found}{change}"


def compare(reference: pd.DataFrame, found: pd.DataFrame, table: str, settings: dict) -> list[Movement]:
    """Return every cell of a table that differs between then and now, with its tolerance.

    Of the settings, ``keys`` are columns that name a row; ``relative`` and ``absolute`` tolerances by column, ``default`` for
    the others: a number may move by ``absolute + relative * |reference|``. ``columns`` is what the reference keeps beside the
    keys, where that is not everything, ``rows`` a list of tolerances of their own, each for the rows whose keys are as in
    ``where``.
    """
    keys = settings["keys"]
    missing = [column for column in reference.columns if column not in found.columns]
    movements = [Movement(table, "-", column, "present", "missing", 0.0, False) for column in missing]
    movements += [
        Movement(table, "-", column, "missing", "present", 0.0, False)
        for column in keys
        if column not in reference
    ]
    if any(movement.column in keys for movement in movements):
        return movements
    then, now = (frame.set_index(keys) for frame in (reference.drop(columns=missing), found))
    for key in then.index.difference(now.index):
        movements.append(Movement(table, _name(key), "-", "present", "missing", 0.0, False))
    for key in then.index.intersection(now.index):
        own = _tolerances(key, settings)
        for column in then.columns:
            movements.extend(_cell(then.at[key, column], now.at[key, column], table, _name(key), column, own))
    return movements


def _tolerances(key, settings: dict) -> dict:
    """Return the table's settings with the tolerances of one row in place of the table's."""
    row = dict(zip(settings["keys"], key if isinstance(key, tuple) else (key,), strict=True))
    for special in settings.get("rows", ()):
        if all(row[name] == value for name, value in special["where"].items()):
            return {**settings, **special}
    return settings


def _name(key) -> str:
    return ", ".join(map(str, key)) if isinstance(key, tuple) else str(key)


def _cell(then, now, table: str, row: str, column: str, settings: dict) -> list[Movement]:
    if pd.isna(then) and pd.isna(now):
        return []
    if isinstance(then, str) or isinstance(now, str) or pd.isna(then) or pd.isna(now):
        return [] if then == now else [Movement(table, row, column, then, now, 0.0, False)]
    relative = settings.get("relative", {})
    absolute = settings.get("absolute", {})
    allowed = absolute.get(column, absolute.get("default", 0.0))
    allowed += relative.get(column, relative.get("default", 0.0)) * abs(float(then))
    moved = abs(float(now) - float(then))
    if moved == 0:
        return []
    return [Movement(table, row, column, float(then), float(now), allowed, moved <= allowed)]


def reference_name(name: str, settings: dict) -> str:
    """File name of a table's reference."""
    return settings.get("kept_as", Path(name).name)


def _moved(reference: pd.DataFrame, found: Path, name: str, settings: dict) -> list[Movement]:
    kept = [*settings["keys"], *settings["columns"]] if "columns" in settings else list(reference.columns)
    return compare(reference[kept], pd.read_csv(found), name, settings)


def main(arguments: list[str] | None = None) -> int:
    """Run the comparison; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--results", type=Path, default=PROJECT / "results" / "thesis")
    parser.add_argument("--reference", type=Path, default=FOLDER)
    parser.add_argument("--update", action="store_true", help="take the present numbers as the new reference")
    options = parser.parse_args(arguments)
    tables = yaml.safe_load((options.reference / "tolerances.yaml").read_text(encoding="utf-8"))
    if options.update:
        for name, settings in tables.items():
            frame = pd.read_csv(options.results / name, dtype=str, keep_default_na=False)
            kept = [*settings["keys"], *settings["columns"]] if "columns" in settings else list(frame.columns)
            frame[kept].to_csv(
                options.reference / reference_name(name, settings), index=False, lineterminator="\n"
            )
        print(f"{len(tables)} tables taken as reference")
        return 0
    failed = cells = 0
    for name, settings in tables.items():
        reference = pd.read_csv(options.reference / reference_name(name, settings))
        cells += reference.size
        if not (options.results / name).is_file():
            print(f"NOT ALLOWED: {name}: missing; run the default study first")
            failed += 1
            continue
        for movement in compare(reference, pd.read_csv(options.results / name), name, settings):
            print(movement)
            failed += not movement.within
    print(f"{cells} cells of {len(tables)} tables compared: {failed} moved more than allowed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
