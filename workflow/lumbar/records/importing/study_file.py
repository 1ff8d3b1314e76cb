"""A folder of imported records: tidy files, a study that says where each comes from, and the same for programs."""

import shlex
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from lumbar.base.errors import InputError
from lumbar.base.files import read_json, sanitize_name, write_csv, write_json, write_text
from lumbar.base.templates import template
from lumbar.base.yaml_file import quote_yaml
from lumbar.records.importing.recording import ImportedRecording
from lumbar.records.record import swap_input_and_output, use_load_as_input

SCHEMA = "lumbar.import/1"
STUDY, PROVENANCE = "study.yaml", "imported.json"
_DEFAULT = {"time": ("time", "s"), "input": ("position", "mm"), "output": ("force", "N")}
"""Quantities and units that a layout has by default, along each axis."""


def write_folder(
    recordings: Sequence[ImportedRecording],
    folder: Path,
    beside: Sequence[Path],
    source_label: str | None = None,
    licence: str | None = None,
    forward: bool = False,
) -> Path:
    """Write records, study and provenance, and return the path of the study; a folder of an earlier import is added to.

    Parameters
    ----------
    forward : bool
        Whether the load drove the tests: the study takes it for the input.
    beside : sequence of Path
        Files of the folder that would be read as records.

    Raises
    ------
    InputError
        If the folder holds recordings of another origin, records of other units or driven otherwise, or a study changed by
        hand.
    """
    known = _earlier(folder)
    own = {entry["file"] for entry in known["records"]}
    strange = [path.name for path in beside if path.name not in own]
    if strange:
        raise InputError(
            f"{folder}: holds {', '.join(strange)}, which were not imported and would be read as records of the study; "
            "choose a folder of its own"
        )
    study = folder / STUDY
    if study.exists() and study.read_text(encoding="utf-8") != study_text(known, folder):
        raise InputError(f"{study}: was changed since it was made; move it away, or choose another folder")
    driven = (
        # The load is the input; `use_load_as_input` swaps the records as they are read if their quantities say which it is.
        [
            item
            if use_load_as_input(item.record) is not item.record
            else replace(item, record=swap_input_and_output(item.record))
            for item in recordings
        ]
        if forward
        else recordings
    )
    new = [_entry(recording) for recording in driven]
    replaced = {entry["name"] for entry in new}
    records = [*(entry for entry in known["records"] if entry["name"] not in replaced), *new]
    _check_columns(records, folder)
    if known["records"] and forward != known["forward"]:
        said = "by the load (--forward)" if known["forward"] else "by the motion (without --forward)"
        raise InputError(f"{folder}: its records were imported as driven {said}; choose another folder")
    content = {
        "schema": SCHEMA,
        "data": source_label or known["data"],
        "licence": licence or known["licence"],
        "forward": forward,
        "records": records,
    }
    for recording in driven:
        write_csv(folder / f"{recording.record.name}.csv", recording.frame())
    write_json(folder / PROVENANCE, content)
    write_text(study, study_text(content, folder))
    return study


def _earlier(folder: Path) -> dict:
    path = folder / PROVENANCE
    fresh: dict = {"schema": SCHEMA, "data": None, "licence": None, "forward": False, "records": []}
    if not path.exists():
        return fresh
    content = read_json(path)
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        raise InputError(f"{path}: not of schema {SCHEMA}; choose another folder")
    return {**fresh, **content}


def _source(path: Path) -> str:
    """Where a recording comes from; the name alone of a file that was given without its place."""
    return str(path.resolve()) if path.is_file() else str(path)


def _entry(recording: ImportedRecording) -> dict:
    record = recording.record
    return {
        "name": record.name,
        "file": f"{record.name}.csv",
        "source": _source(Path(record.source)),
        "sha256": recording.sha256,
        "form": recording.form,
        "grounds": recording.grounds,
        "notes": list(recording.notes),
        "rate_Hz": float(f"{1 / record.sampling_time:.9g}"),
        "duration_s": float(f"{record.duration:.9g}"),
        "clipped": recording.clipped,
        "columns": recording.columns,
    }


def _check_columns(records: list[dict], folder: Path) -> None:
    for entry in records[1:]:
        if entry["columns"] != records[0]["columns"]:
            named = [
                ", ".join(column["column"] for column in one["columns"].values())
                for one in (records[0], entry)
            ]
            raise InputError(
                f"{folder}: {records[0]['name']} has {named[0]}, but {entry['name']} has {named[1]}; the records of a study "
                "have the same columns: name them alike in the files' headers, or use a folder for each"
            )


def needs_study(content: dict) -> bool:
    """Whether the records cannot be read by the default layout, or at one rate."""
    default = all(
        (column["quantity"], column["unit"]) == _DEFAULT[role.partition("_")[0]]
        for role, column in content["records"][0]["columns"].items()
    )
    rate = common_rate(entry["rate_Hz"] for entry in content["records"])
    return not default or rate is not None or any(entry["clipped"] for entry in content["records"])


def common_rate(rates: Iterable[float]) -> float | None:
    """Lowest of several rates in hertz; None where all are one."""
    rates = [float(f"{rate:.9g}") for rate in rates]
    return min(rates) if max(rates) > (1 + 1e-6) * min(rates) else None


def study_text(content: dict, folder: Path) -> str:
    """Text of the study; empty without records. `content` is that of the file of provenance."""
    records = content["records"]
    if not records:
        return ""
    folder = folder.resolve()
    return template("records/importing/study_file.yaml.jinja").render(
        content=content,
        folder=str(folder),
        name=sanitize_name(folder.name, "study"),
        configfile=shlex.quote(str(folder / STUDY)),
        provenance=PROVENANCE,
        label=content["data"] or f"recordings {folder.name}",
        sources=", ".join(Path(entry["source"]).name for entry in records),
        rate=common_rate(entry["rate_Hz"] for entry in records),
        longest=max(records, key=lambda entry: entry["duration_s"]),
        comments=_comments,
        quote_yaml=quote_yaml,
    )


def _comments(entry: dict) -> list[str]:
    """What is told of a record, line by line, without signs that would end a line."""
    told = [f"{entry['source']} (SHA-256 {entry['sha256'][:16]}…): {entry['form']}"]
    told += [f"  {role}: {words}" for role, words in entry["grounds"].items()]
    told += [f"  {note}" for note in entry["notes"]]
    return ["".join(sign if sign.isprintable() else "?" for sign in line) for line in told]
