"""Folder of imported records: tidy files, a study with the origin of each file, and the origins as JSON."""

import shlex
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from lumbar.base.errors import InputError
from lumbar.base.files import read_json, sanitize_name, write_json, write_number_columns, write_text
from lumbar.base.templates import template
from lumbar.base.yaml_file import quote_yaml
from lumbar.records.importing.recording import ImportedRecording
from lumbar.records.record import swap_input_and_output, use_load_as_input

SCHEMA = "lumbar.import/1"
STUDY, PROVENANCE = "study.yaml", "imported.json"
_DEFAULT_COLUMNS = {"time": ("time", "s"), "input": ("position", "mm"), "output": ("force", "N")}
"""Quantity and unit of each role in the default layout, for any axis."""


def write_folder(
    recordings: Sequence[ImportedRecording],
    folder: Path,
    existing: Sequence[Path],
    source_label: str | None = None,
    licence: str | None = None,
    forward: bool = False,
) -> Path:
    """Write records, study and provenance to a new folder or an earlier import's folder; return the study's path.

    Parameters
    ----------
    recordings : sequence of ImportedRecording
        The new records; they replace earlier records of equal name.
    folder : Path
        The folder.
    existing : sequence of Path
        Files of the folder that would be read as records.
    source_label, licence : str, optional
        Name and licence of the data; default the earlier import's.
    forward : bool
        Whether the load drove the tests and is the input of the study.

    Raises
    ------
    InputError
        If the folder contains recordings of another origin, records with other units or another input, or a study that
        was changed by hand.
    """
    content: dict = {"schema": SCHEMA, "data": None, "licence": None, "forward": False, "records": []}
    path, study = folder / PROVENANCE, folder / STUDY
    if path.exists():
        known = read_json(path)
        if not isinstance(known, dict) or known.get("schema") != SCHEMA:
            raise InputError(f"{path}: not of schema {SCHEMA}; choose another folder")
        content |= known
    known_files = {entry["file"] for entry in content["records"]}
    foreign = [path.name for path in existing if path.name not in known_files]
    if foreign:
        raise InputError(
            f"{folder}: holds {', '.join(foreign)}, which were not imported and would be read as records of the study; "
            "choose another folder"
        )
    if study.exists() and study.read_text(encoding="utf-8") != _study_text(content, folder):
        raise InputError(f"{study}: was changed since it was made; move it away, or choose another folder")
    if content["records"] and forward != content["forward"]:
        mode = "by the load (--forward)" if content["forward"] else "by the motion (without --forward)"
        raise InputError(f"{folder}: its records were imported as driven {mode}; choose another folder")
    if forward:
        # `use_load_as_input` swaps the records as they are read, if their quantities identify the load.
        recordings = [
            item
            if use_load_as_input(item.record) is not item.record
            else replace(item, record=swap_input_and_output(item.record))
            for item in recordings
        ]
    names = {recording.record.name for recording in recordings}
    records = [entry for entry in content["records"] if entry["name"] not in names]
    records += [_entry(recording) for recording in recordings]
    columns = [", ".join(item["column"] for item in entry["columns"].values()) for entry in records]
    for entry, listed in zip(records, columns, strict=True):
        if entry["columns"] != records[0]["columns"]:
            raise InputError(
                f"{folder}: {records[0]['name']} has {columns[0]}, but {entry['name']} has {listed}; the records of a study "
                "have the same columns: give them the same names in the files' headers, or use a folder for each"
            )
    content |= {
        "data": source_label or content["data"],
        "licence": licence or content["licence"],
        "forward": forward,
        "records": records,
    }
    for recording in recordings:
        write_number_columns(folder / f"{recording.record.name}.csv", recording.tidy)
    write_json(folder / PROVENANCE, content)
    write_text(study, _study_text(content, folder))
    return study


def _entry(recording: ImportedRecording) -> dict:
    record, path = recording.record, Path(recording.record.source)
    return {
        "name": record.name,
        "file": f"{record.name}.csv",
        "source": str(path.resolve()) if path.is_file() else str(path),
        "sha256": recording.sha256,
        "form": recording.form,
        "grounds": recording.grounds,
        "notes": list(recording.notes),
        "rate_Hz": float(f"{1 / record.sampling_time:.9g}"),
        "duration_s": float(f"{record.duration:.9g}"),
        "clipped": recording.clipped,
        "columns": recording.columns,
    }


def is_study_needed(content: dict) -> bool:
    """Return whether records of a provenance file need their study: columns are not the default, rates differ, or one is clipped.

    Parameters
    ----------
    content : dict
        Content of the provenance file, with at least one record.
    """
    is_default = all(
        (column["quantity"], column["unit"]) == _DEFAULT_COLUMNS[role.partition("_")[0]]
        for role, column in content["records"][0]["columns"].items()
    )
    rate = common_rate(entry["rate_Hz"] for entry in content["records"])
    return not is_default or rate is not None or any(entry["clipped"] for entry in content["records"])


def common_rate(rates: Iterable[float]) -> float | None:
    """Return the lowest of several rates in hertz; None if all are equal.

    Parameters
    ----------
    rates : iterable of float
        Rates in hertz, at least one.
    """
    rates = [float(f"{rate:.9g}") for rate in rates]
    return min(rates) if max(rates) > (1 + 1e-6) * min(rates) else None


def _study_text(content: dict, folder: Path) -> str:
    """Return the text of the study of a folder for the content of its provenance file; empty without records."""
    records = content["records"]
    if not records:
        return ""

    def comments(entry: dict) -> list[str]:
        """Return the origin of a record line by line, without characters that would end a line."""
        lines = [f"{entry['source']} (SHA-256 {entry['sha256'][:16]}…): {entry['form']}"]
        lines += [f"  {role}: {reason}" for role, reason in entry["grounds"].items()]
        lines += [f"  {note}" for note in entry["notes"]]
        return ["".join(sign if sign.isprintable() else "?" for sign in line) for line in lines]

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
        comments=comments,
        quote_yaml=quote_yaml,
    )
