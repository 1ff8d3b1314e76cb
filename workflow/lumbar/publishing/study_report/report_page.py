"""Report of a study as one self-contained HTML page: main results, failures, a grid of all artefacts, and the chapters."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from lumbar.base.files import read_json
from lumbar.base.templates import template
from lumbar.publishing.reproduction.claim import DOES_NOT_HOLD
from lumbar.publishing.study_report.contents import Chapter, format_value
from lumbar.publishing.study_report.main_results import main_results, read_diagnoses
from lumbar.tables.table_layout import split_number

FAILS, WARNS = "fails", "warns"
_WARNING = re.compile(r"^(?:\w*Warning|WARNING): (.*(?:\n  .*)*)", flags=re.M)
_STAGES_WITH_FILES = ("lift", "stability_tables")
"""Stages with warnings in their results in addition to the log: lifts without a pendulum, missing basins."""


@dataclass(frozen=True)
class Trouble:
    """A failure or warning that a reader should know before any result."""

    grade: str
    """Severity: ``"fails"`` or ``"warns"``."""
    where: str
    """Name of the stage, lift, record set or file."""
    sentence: str


def recordings(results: Path) -> list[dict]:
    """Return a row for every checked recording; rows of marker recordings have findings."""
    sheets = {}
    for path in sorted(results.glob("lifting/*/quality.json")):
        sheet = read_json(path)
        sheets[Path(sheet["file"]).name] = sheet
    rows = []
    for path in sorted(results.glob("checked/*.json")):
        for entry in read_json(path)["recordings"]:
            sheet = sheets.get(entry["file"].rpartition("/")[2], {})
            missing, markers = sheet.get("missing_share"), entry.get("markers")
            findings = [
                f"{_spell_out(item['kind'])} ({item['outcome']}): {', '.join(item['markers']) or 'all markers'} from "
                f"{item['start_s']:.2f} s for {item['length_s']:.2f} s: {item['evidence']}"
                for item in sheet.get("findings", ())
            ]
            rows.append(
                {
                    "chapter": path.stem,
                    "name": entry.get("name") or entry["file"],
                    "channels": entry.get("quantities", "") if markers is None else f"{len(markers)} markers",
                    "missing_percent": None if missing is None else 100 * missing,
                    "findings": tuple(findings),
                    "rate_Hz": entry.get("rate_Hz"),
                    "duration_s": entry.get("duration_s"),
                }
            )
    return rows


def _spell_out(name: str) -> str:
    """Return a name from files or settings as printed text."""
    return name.replace("_", " ")


def troubles(results: Path) -> dict[str, list[Trouble]]:
    """Return the troubles of a study's results by kind, failures before warnings; kinds without troubles are left out."""
    every = {kind: dict.fromkeys(part(results)) for kind, part in _TROUBLES.items()}
    return {kind: sorted(some, key=lambda item: item.grade != FAILS) for kind, some in every.items() if some}


def _recording_troubles(results: Path) -> Iterator[Trouble]:
    for item in recordings(results):
        for finding in item["findings"]:
            yield Trouble(FAILS if "(error)" in finding else WARNS, _spell_out(item["name"]), finding)


def _lift_troubles(results: Path) -> Iterator[Trouble]:
    for path in sorted(results.glob("lifting/*/pendulum.json")):
        facts = read_json(path)
        lift = _spell_out(facts["lift"])
        if facts.get("no_deposit"):
            yield Trouble(FAILS, lift, f"no deposit: {facts['no_deposit']}")
        for name, reason in facts.get("missing", {}).items():
            yield Trouble(FAILS, lift, f"no {_spell_out(name)}: {reason}")
        for assumption in facts.get("assumptions", ()):
            yield Trouble(WARNS, lift, f"assumed: {assumption}")


def _diagnosis_troubles(results: Path) -> Iterator[Trouble]:
    for name, diagnosis in read_diagnoses(results).items():
        where = f"diagnosis of {_spell_out(name)}"
        if diagnosis["verdict"] == "unexplained":
            yield Trouble(FAILS, where, "something is missing, and no effect of the catalogue explains it")
        if diagnosis["verdict"] == "tied":
            tied = [*diagnosis["selected"], *diagnosis["tied_with"]]
            names = ", ".join(_spell_out(name).replace("+", " and ") for name in tied)
            yield Trouble(WARNS, where, f"these cannot be distinguished on these records: {names}")
        if diagnosis["complete"] is False:
            yield Trouble(WARNS, where, "the error that is left is above 1.2 times the noise floor")
        if diagnosis["noise_floor_rms"] is None:
            yield Trouble(WARNS, where, "no record repeats, so the noise floor is not known")
        for finding in diagnosis.get("findings", ()):
            yield Trouble(WARNS, where, finding["sentence"])


def _basin_troubles(results: Path) -> Iterator[Trouble]:
    for row in _rows(results / "stability" / "failures.csv").itertuples():
        lift = _spell_out(f"{row.subject} {row.box_mass_kg:g} kg, {row.com}, {row.plane}")
        yield Trouble(FAILS, lift, f"{_spell_out(row.basin)}: {row.reason}")
    areas = _rows(results / "stability" / "boa.csv")
    if areas.empty:
        return
    exact = areas[areas["method"] == "exact"]
    left, starts = exact["exits"].sum(), exact["simulated_starts"].sum()
    if left:
        yield Trouble(FAILS, "basins", f"{left:g} of {starts:g} simulated starts leave an exact basin")
    if (exact["control_exits"] == 0).any():
        yield Trouble(WARNS, "basins", "the simulation did not detect a basin made too large on purpose")
    unproved = int((exact["proved_share"] < 1).sum())
    if unproved:
        sentence = f"{unproved} of {len(exact)} exact basins are not proved over the whole movement"
        yield Trouble(WARNS, "basins", sentence)


def _fmu_troubles(results: Path) -> Iterator[Trouble]:
    for row in _rows(results / "runtime" / "fmu_check.csv").itertuples():
        if row.schema_problems:
            yield Trouble(FAILS, row.file, f"{row.schema_problems} problems found by fmpy")
        if row.relative_error > row.tolerance:
            sentence = f"off its model by {row.relative_error:.2g} (allowed: {row.tolerance:.2g})"
            yield Trouble(FAILS, row.file, sentence)


def _log_troubles(results: Path) -> Iterator[Trouble]:
    for path in sorted((results / "logs").rglob("*.log")):
        stage = path.relative_to(results / "logs").with_suffix("")
        if stage.parts[0] not in _STAGES_WITH_FILES:
            for text in _WARNING.findall(path.read_text(encoding="utf-8")):
                yield Trouble(WARNS, _spell_out(stage.as_posix()), text.strip())


_TROUBLES = {
    "Recordings": _recording_troubles,
    "Lifts": _lift_troubles,
    "Diagnoses": _diagnosis_troubles,
    "Basins of attraction": _basin_troubles,
    "FMUs": _fmu_troubles,
    "Logs": _log_troubles,
}
"""Function that yields the troubles of each kind from a study's results."""


def _rows(path: Path) -> pd.DataFrame:
    """Return the rows of a table of the results; empty if the table was not made."""
    return pd.read_csv(path) if path.is_file() else pd.DataFrame()


PAGE = "publishing/study_report/report.html.jinja"


def report_page(
    facts: dict[str, Any], results: Path, made: Sequence[Chapter], claims: pd.DataFrame | None
) -> str:
    """Return the report's page, with failures and warnings from the folder of results.

    `facts` is the head of the page: ``name``, ``title``, ``source_label``, ``people`` (subject and box of every lift),
    ``seed`` and ``versions`` by package. `results` is ``results/<study>``, `made` the contents of the page, `claims` is
    ``claims.csv``.
    """
    rows = [] if claims is None else list(claims[claims["verdict"] == DOES_NOT_HOLD].itertuples())
    entries = [entry for chapter in made for entry in chapter.entries]
    return template(PAGE).render(
        facts=facts,
        chapters=made,
        anchors=[*(f"chapter-{chapter.name}" for chapter in made), "state"],
        main_results=main_results(results, (entry.key for entry in entries), claims),
        troubles=troubles(results),
        recordings=recordings(results),
        sentences=[row for row in rows if not row.claim.startswith("table_")],
        cells=[row for row in rows if row.claim.startswith("table_")],
        counted={} if claims is None else claims["verdict"].value_counts().to_dict(),
        missing=[entry for entry in entries if entry.missing],
        split=split_number,
        format_value=format_value,
    )
