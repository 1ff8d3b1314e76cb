"""The report of a study as one self-contained HTML page that begins with failures and warnings."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from lumbar.base.files import read_json
from lumbar.base.templates import template
from lumbar.publishing.reproduction.claim import DOES_NOT_HOLD
from lumbar.publishing.study_report.contents import Chapter, claim_row
from lumbar.tables.layout import split_number

FAILS, WARNS = "fails", "warns"
_WARNING = re.compile(r"^(?:\w*Warning|WARNING): (.*(?:\n  .*)*)", flags=re.M)
_PENDULUM = re.compile(r"^[^:]*\((?:hanging|inverted)\): ")
"""Lift, centre and plane at the beginning of a reason, which the line already names."""
_REPORTED_BY_FILES = ("lift", "stability_tables")
"""Stages with warnings in their results too: lifts without a pendulum, missing basins."""


@dataclass(frozen=True)
class Trouble:
    """One thing that a reader should know before any result."""

    grade: str
    """``"fails"`` or ``"warns"``."""
    where: str
    """Stage, lift, record set or file."""
    sentence: str


def recordings(results: Path) -> list[dict]:
    """Return the row of every recording that was checked, with findings of marker recordings."""
    sheets = {
        Path(sheet["file"]).name: sheet
        for sheet in map(read_json, sorted(results.glob("lifting/*/quality.json")))
    }
    rows = []
    for path in sorted(results.glob("checked/*.json")):
        for entry in read_json(path)["recordings"]:
            sheet = sheets.get(entry["file"].rpartition("/")[2], {})
            missing = sheet.get("missing_share")
            markers = entry.get("markers")
            rows.append(
                {
                    "chapter": path.stem,
                    "name": entry.get("name") or entry["file"],
                    "channels": entry.get("quantities", "") if markers is None else f"{len(markers)} markers",
                    "missing_percent": None if missing is None else 100 * missing,
                    "findings": tuple(map(_finding, sheet.get("findings", ()))),
                    "rate_Hz": entry.get("rate_Hz"),
                    "duration_s": entry.get("duration_s"),
                }
            )
    return rows


def _finding(finding: dict) -> str:
    markers = ", ".join(finding["markers"]) or "all markers"
    return (
        f"{_readable(finding['kind'])} ({finding['outcome']}): {markers} from {finding['start_s']:.2f} s for "
        f"{finding['length_s']:.2f} s: {finding['evidence']}"
    )


def _readable(name: str) -> str:
    """Return a name of files and settings as text."""
    return name.replace("_", " ")


def troubles(results: Path) -> list[Trouble]:
    """Return what fails, then what warns."""
    found = [
        Trouble(FAILS if "(error)" in finding else WARNS, _readable(item["name"]), finding)
        for item in recordings(results)
        for finding in item["findings"]
    ]
    for part in (_lift_troubles, _diagnosis_troubles, _basin_troubles, _fmu_troubles):
        found += part(results)
    # Warnings that stages wrote to their logs.
    for path in sorted((results / "logs").rglob("*.log")):
        stage = path.relative_to(results / "logs").with_suffix("")
        if stage.parts[0] not in _REPORTED_BY_FILES:
            warnings = _WARNING.findall(path.read_text(encoding="utf-8"))
            found += [Trouble(WARNS, _readable(stage.as_posix()), text.strip()) for text in warnings]
    return sorted(dict.fromkeys(found), key=lambda item: item.grade != FAILS)


def _lift_troubles(results: Path) -> Iterator[Trouble]:
    for path in sorted(results.glob("lifting/*/pendulum.json")):
        facts = read_json(path)
        lift = _readable(facts["lift"])
        if facts.get("no_deposit"):
            yield Trouble(FAILS, lift, f"no deposit: {facts['no_deposit']}")
        for what, why in facts.get("missing", {}).items():
            yield Trouble(FAILS, lift, f"no {_readable(what)}: {why}")
        for words in facts.get("assumptions", ()):
            yield Trouble(WARNS, lift, f"assumed: {words}")


def _diagnosis_troubles(results: Path) -> Iterator[Trouble]:
    for path in sorted(results.glob("improvement/*/diagnosis.json")):
        where, found = f"diagnosis of {_readable(path.parent.name)}", read_json(path)
        if found["verdict"] == "unexplained":
            yield Trouble(FAILS, where, "something is missing, and no effect of the catalogue explains it")
        if found["verdict"] == "tied":
            names = (
                _readable(name).replace("+", " and ") for name in (*found["selected"], *found["tied_with"])
            )
            yield Trouble(WARNS, where, f"these cannot be distinguished on these records: {', '.join(names)}")
        if found["complete"] is False:
            yield Trouble(WARNS, where, "the error that is left is above 1.2 times the noise floor")
        if found["noise_floor_rms"] is None:
            yield Trouble(WARNS, where, "no record repeats, so the noise floor is not known")
        for finding in found.get("findings", ()):
            yield Trouble(WARNS, where, finding["sentence"])


def _basin_troubles(results: Path) -> Iterator[Trouble]:
    missing = _table(results / "stability" / "failures.csv")
    for row in () if missing is None else missing.itertuples():
        lift = f"{row.subject} {row.box_mass_kg:g} kg, {row.com}, {row.plane}".replace("_", " ")
        yield Trouble(FAILS, lift, f"{_readable(row.basin)}: {_PENDULUM.sub('', row.reason)}")
    areas = _table(results / "stability" / "boa.csv")
    if areas is None:
        return
    exact = areas[areas["method"] == "exact"]
    left, starts = exact["exits"].sum(), exact["simulated_starts"].sum()
    if left:
        yield Trouble(FAILS, "basins", f"{left:g} of {starts:g} simulated starts leave an exact basin")
    if (exact["control_exits"] == 0).any():
        yield Trouble(WARNS, "basins", "a basin made too large on purpose was not found out by simulation")
    open_ = int((exact["proved_share"] < 1).sum())
    if open_:
        yield Trouble(
            WARNS, "basins", f"{open_} of {len(exact)} exact basins are not proved over the whole movement"
        )


def _fmu_troubles(results: Path) -> Iterator[Trouble]:
    checks = _table(results / "runtime" / "fmu_check.csv")
    for row in () if checks is None else checks.itertuples():
        if row.schema_problems:
            yield Trouble(FAILS, row.file, f"{row.schema_problems} problems found by fmpy")
        if row.relative_error > row.tolerance:
            yield Trouble(
                FAILS, row.file, f"off its model by {row.relative_error:.2g} (allowed: {row.tolerance:.2g})"
            )


def _table(path: Path) -> pd.DataFrame | None:
    return pd.read_csv(path) if path.is_file() else None


PAGE = "publishing/study_report/report.html.jinja"


@dataclass(frozen=True)
class StudyFacts:
    """Facts in the head of the page."""

    name: str
    title: str
    source_label: str
    people: tuple[str, ...]
    """Person and box of every lift."""
    seed: int
    versions: dict[str, str]


def report_page(
    facts: StudyFacts, results: Path, made: Sequence[Chapter], claims: pd.DataFrame | None
) -> str:
    """Return the page; failures and warnings are read from the folder of results."""
    found = troubles(results)
    rows = [] if claims is None else list(claims[claims["verdict"] == DOES_NOT_HOLD].itertuples())
    entries = [entry for chapter in made for entry in chapter.entries]
    return template(PAGE).render(
        facts=facts,
        chapters=made,
        told=[(entry.key, entry.title, entry.sentence) for entry in entries if entry.sentence],
        failing=[item for item in found if item.grade == FAILS],
        warning=[item for item in found if item.grade != FAILS],
        recordings=recordings(results),
        sentences=[claim_row(row) for row in rows if not row.claim.startswith("table_")],
        cells=[claim_row(row) for row in rows if row.claim.startswith("table_")],
        counted=() if claims is None else list(claims["verdict"].value_counts().items()),
        missing=[entry for entry in entries if entry.missing],
        pages=[entry for entry in entries if entry.page],
        split=split_number,
    )
