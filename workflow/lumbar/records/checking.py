"""Check of every recording of a study before anything is computed."""

import hashlib
from collections.abc import Callable
from pathlib import Path

from lumbar.base.errors import InputError, Problems
from lumbar.base.progress import track
from lumbar.records.markers import MarkerRecording, read_markers
from lumbar.records.record import require_same_units
from lumbar.settings.layout import ColumnLayout, MarkerLayout
from lumbar.settings.runtime import RatingsLayout

MarkerReader = Callable[[str, MarkerLayout], MarkerRecording]


def check_recordings(plan: list[dict], read: MarkerReader = read_markers) -> dict[str, list[dict]]:
    """Read every recording and return its description by chapter: name, sha256, size and the reader's results.

    Parameters
    ----------
    plan : list of dict
        One entry per file: ``chapter``, ``set`` (files that need the same quantities and units, or null),
        ``reader`` (``columns``, ``markers`` or ``ratings``), ``path``, ``layout``, and for columns optionally ``name``,
        ``period_s``, ``rate_Hz`` and ``trim_s``.
    read : callable
        Reader of marker files.

    Raises
    ------
    InputError
        If files have problems, with the problems of all files.
    """
    problems = Problems("recordings")
    chapters: dict[str, list[dict]] = {}
    sets: dict[str, list] = {}
    readers = {
        "columns": _read_columns,
        "markers": lambda item: _read_markers(item, read),
        "ratings": _read_ratings,
    }
    for item in track(plan, "recordings checked"):
        described = chapters.setdefault(item["chapter"], [])
        try:
            record, description = readers[item["reader"]](item)
        except InputError as error:
            problems.add("", str(error).replace("\n", "\n    "))
            continue
        path = Path(item["path"])
        with path.open("rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
        described.append({"file": path.name, "sha256": digest, "reader": item["reader"], **description})
        if item.get("set"):
            sets.setdefault(item["set"], []).append(record)
    for records in sets.values():
        try:
            require_same_units(records)
        except InputError as error:
            problems.add("", str(error).replace("\n", "\n    "))
    problems.raise_if_any()
    return chapters


def _read_columns(item: dict) -> tuple[object, dict]:
    from lumbar.records.columns import read_record

    record = read_record(
        item["path"],
        ColumnLayout.model_validate(item["layout"]),
        name=item.get("name"),
        period=item.get("period_s"),
        rate=item.get("rate_Hz"),
        trim=item.get("trim_s"),
    )
    channels = {
        role: {"quantity": channel.quantity, "unit": channel.unit}
        for role, channel in record.channels.items()
    }
    return record, {
        "name": record.name,
        "samples": len(record),
        "rate_Hz": round(1 / record.sampling_time, 9),
        "duration_s": round(record.duration, 9),
        "channels": channels,
        "quantities": record.quantities,
    }


def _read_markers(item: dict, read: MarkerReader) -> tuple[object, dict]:
    recording = read(item["path"], MarkerLayout.model_validate(item["layout"]))
    return recording, {
        "name": recording.name,
        "samples": len(recording.time),
        "rate_Hz": round(recording.rate, 9),
        "duration_s": round(len(recording.time) / recording.rate, 9),
        "unit": "m",
        "markers": sorted(recording.positions),
        "derived": dict(sorted(recording.derived.items())),
        "absent": dict(sorted(recording.absent.items())),
        "notes": list(recording.notes),
    }


def _read_ratings(item: dict) -> tuple[object, dict]:
    from lumbar.records.ratings import read_ratings

    ratings = read_ratings(item["path"], RatingsLayout.model_validate(item["layout"]))
    return ratings, {
        "participants": len(ratings),
        "models": list(ratings.models),
        "scale_points": ratings.scale_points,
        "sources": list(ratings.sources),
    }
