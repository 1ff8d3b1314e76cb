"""``lumbar.read``: validated recordings of any kind."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

from lumbar.base.errors import InputError
from lumbar.records.record import RecordSet, require_same_units
from lumbar.records.unpacking import ending_of, stem_of
from lumbar.settings.layout import ColumnLayout, MarkerLayout, RecordSettings

if TYPE_CHECKING:
    from lumbar.records.markers import MarkerRecording
    from lumbar.records.ratings import Ratings
    from lumbar.settings.runtime import RatingsLayout

Kind = Literal["tissue", "pendulum", "surgeon", "markers", "survey"]
COLUMN_ENDINGS = (".csv", ".txt", ".mat")
MARKER_ENDINGS = (".c3d", ".trc", ".bvh")
_TEXT_FILE_NAME = re.compile(
    r"(readme|read[_-]me|licen[cs]e|copying|copyright|notice|citation|changelog|lizenz|liesmich|lisez[_-]?moi|licencia|leeme)"
    r"([^a-z].*)?\.txt"
)
"""Names of text files about data, in lower case: readme.txt, license-data.txt."""


Source = str | os.PathLike | Iterable[str | os.PathLike]


@overload
def read(
    source: Source, kind: Literal["markers"], *, layout: MarkerLayout | None = None
) -> MarkerRecording: ...
@overload
def read(source: Source, kind: Literal["survey"], *, layout: RatingsLayout | None = None) -> Ratings: ...
@overload
def read(
    source: Source,
    kind: Literal["tissue", "pendulum", "surgeon"] | None = None,
    *,
    layout: ColumnLayout | MarkerLayout | None = None,
    rate: float | None = None,
    names: Iterable[str] | None = None,
    periods: Mapping[str, float] | None = None,
    trims: Mapping[str, tuple[float, float]] | None = None,
) -> RecordSet | Any: ...  # without a kind the file's ending decides
def read(
    source: Source,
    kind: Kind | None = None,
    *,
    layout: Any = None,
    rate: float | None = None,
    names: Iterable[str] | None = None,
    periods: Mapping[str, float] | None = None,
    trims: Mapping[str, tuple[float, float]] | None = None,
) -> RecordSet | MarkerRecording | Ratings:
    """Read recordings of any format.

    Parameters
    ----------
    source : path or iterable of path
        A folder with one file per record, a file, or several files: CSV, TXT, MAT, C3D, TRC, BVH (also gzip).
    kind : str, optional
        What was recorded: ``tissue`` (position, force), ``pendulum`` (angle, moment), ``surgeon`` (position),
        ``markers`` (also of CSV) or ``survey``. Default: ``markers`` for C3D, TRC and BVH files, else ``tissue``.
    layout : layout of `lumbar.settings.layout`, optional
        Columns with their units, or labels and axes of markers; default the layout of the kind.
    rate : float, optional
        Resample column files to this rate in hertz, with an anti-aliasing filter.
    names : iterable of str, optional
        Names of the records; default the files' stems.
    periods : mapping of str to float, optional
        Known periods of the excitations in seconds, by the record's name.
    trims : mapping of str to tuple of float, optional
        Start and stop of the part to read, by the record's name; in seconds of the file's clock.

    Returns
    -------
    RecordSet, MarkerRecording or Ratings
        A set of records for column files, even if there is only one file.

    Raises
    ------
    InputError
        If files have problems: all problems of a file in one error, with line or column, value and allowed values.

    Examples
    --------
    >>> import lumbar
    >>> import numpy as np
    >>> rows = [(0.01 * n, n % 7, n % 5) for n in range(1000)]
    >>> np.savetxt("zigzag.csv", rows, delimiter=",", header="time_s,position_mm,force_N", comments="")
    >>> records = lumbar.read("zigzag.csv")
    >>> records["zigzag"]
    <Record zigzag: 1000 samples at 100 Hz, 10 s; position (mm), force (N)>
    """
    files = [Path(source)] if isinstance(source, str | os.PathLike) else [Path(item) for item in source]
    if kind is None:
        is_markers = len(files) == 1 and ending_of(files[0]) in MARKER_ENDINGS
        kind = "markers" if is_markers else "tissue"
    layout = layout or _default_layout(kind)
    if kind in ("markers", "survey"):
        from lumbar.records.markers import read_markers
        from lumbar.records.ratings import read_ratings

        if len(files) != 1:
            raise InputError(f"{len(files)} files of {kind} given; read them one by one")
        return read_markers(files[0], layout) if kind == "markers" else read_ratings(files[0], layout)
    from lumbar.records.columns import read_record

    files = [
        file
        for item in files
        for file in ([item] if item.suffix and not item.is_dir() else column_files(item))
    ]
    names = [stem_of(file) for file in files] if names is None else list(names)
    records = [
        read_record(file, layout, name, None, rate, (trims or {}).get(name))
        for file, name in zip(files, names, strict=True)
    ]
    require_same_units(records)
    return RecordSet(records).with_periods(periods or {})


def read_listed(
    files: Sequence[str | os.PathLike],
    listed: Sequence[RecordSettings],
    layout: ColumnLayout,
    rate: float | None = None,
) -> RecordSet:
    """Read the records of a study, each with its name, period and part.

    Parameters
    ----------
    files : sequence of path
        Files, one per record.
    listed : sequence of RecordSettings
        Names, periods and parts, in the same order.
    layout, rate
        See `read`.
    """
    names = [entry.name for entry in listed]
    periods = {entry.name: entry.period_s for entry in listed if entry.period_s is not None}
    trims = {entry.name: entry.trim_s for entry in listed if entry.trim_s is not None}
    return read(files, "tissue", layout=layout, rate=rate, names=names, periods=periods, trims=trims)


def _default_layout(kind: str):
    from lumbar.settings.study_settings import StudySettings

    study = StudySettings()
    layouts = {
        "tissue": study.tissue.layout,
        "pendulum": study.lifting.moment_layout,
        "surgeon": study.surgeon.layout,
        "markers": study.lifting.markers,
        "survey": study.survey.layout,
    }
    if kind not in layouts:
        raise InputError(f"kind of recording {kind!r} is unknown; there are {', '.join(layouts)}")
    return layouts[kind]


def column_files(folder: Path) -> list[Path]:
    """Return the column files of a folder, by name.

    Parameters
    ----------
    folder : Path
        Folder of recordings.

    Raises
    ------
    InputError
        If the folder does not exist or has no such file.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder")
    files = [path for path in sorted(folder.iterdir()) if is_column_file(path)]
    if not files:
        has_markers = any(map(is_marker_file, folder.iterdir()))
        remedy = "; 'lumbar inspect' and 'lumbar lift' read its files of markers" if has_markers else ""
        raise InputError(f"{folder}: no recordings ({', '.join(COLUMN_ENDINGS)}, also with .gz){remedy}")
    return files


def is_column_file(path: Path, endings: tuple[str, ...] = COLUMN_ENDINGS) -> bool:
    """Return whether a file is a column file by its name, and not a text about the data such as ``LICENSE.txt``.

    Parameters
    ----------
    path : Path
        The file.
    endings : tuple of str
        Endings of column files in lower case.
    """
    name = path.name.lower().removesuffix(".gz")
    return path.is_file() and name.endswith(endings) and not _TEXT_FILE_NAME.fullmatch(name)


def is_marker_file(path: Path) -> bool:
    """Return whether a file is a marker file by its ending; CSV tables of markers cannot be recognised by name.

    Parameters
    ----------
    path : Path
        The file.
    """
    return ending_of(path) in MARKER_ENDINGS
