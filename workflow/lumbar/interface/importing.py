"""``lumbar.import_recordings``: recordings of any machine as records of a study; every guess is reported with its reason."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.base.errors import InputError, Problems
from lumbar.base.files import read_json, require_file
from lumbar.interface.reading import COLUMN_ENDINGS, is_column_file
from lumbar.records.importing.raw_table import COLUMNS_FOLLOW, RawTable
from lumbar.records.importing.recording import ImportedRecording, record_name, to_records
from lumbar.records.importing.roles import Choices
from lumbar.records.importing.source_file import read_content
from lumbar.records.importing.study_file import PROVENANCE, is_study_needed, write_folder
from lumbar.records.record import RecordSet, require_same_units
from lumbar.records.unpacking import stem_of
from lumbar.tissue.diagnosis.linear.direction import inverted_sign_reason

if TYPE_CHECKING:
    import pandas as pd

_PREVIEW_ROWS = 4


@dataclass(frozen=True, eq=False)
class ForeignFile:
    """A file of recordings after reading, before roles are assigned to its columns."""

    name: str
    """Name of the record."""
    table: RawTable
    sha256: str

    @classmethod
    def from_content(cls, name: str, content: bytes, choices: Choices) -> ForeignFile:
        """Read a file from memory.

        Parameters
        ----------
        name : str
            Name of the file; its stem becomes the record's name.
        content : bytes
            Content of the file.
        choices : Choices
            The user's options.

        Raises
        ------
        InputError
            If the file has no table.
        """
        return cls(record_name(stem_of(Path(name))), *read_content(content, Path(name), choices))

    @classmethod
    def from_path(cls, path: Path, choices: Choices) -> ForeignFile:
        """Read a file.

        Parameters
        ----------
        path : Path
            The file.
        choices : Choices
            The user's options.

        Raises
        ------
        InputError
            If the file does not exist or has no table.
        """
        require_file(path)
        return cls.from_content(str(path), path.read_bytes(), choices)


def import_recordings(
    files: str | os.PathLike | Iterable[str | os.PathLike | ForeignFile],
    *,
    time: str | int | None = None,
    position: str | int | None = None,
    force: str | int | None = None,
    time_unit: str | None = None,
    position_unit: str | None = None,
    force_unit: str | None = None,
    rate: float | None = None,
    flip_force: bool = False,
    trim: tuple[float, float] | None = None,
    cut: Iterable[tuple[str, tuple[float, float]]] = (),
    cut_by: str | int | None = None,
    table: str | int | None = None,
    encoding: str | None = None,
    accept_clipped: bool = False,
    forward: bool = False,
    name: str | None = None,
) -> ImportedRecordings:
    """Read recordings of force and position in any machine's form.

    Columns, units, sampling rate, delimiter, decimal mark, encoding and the lines of the table are detected; ambiguous ones are
    rejected with their candidates. Arguments apply to all files.

    Parameters
    ----------
    files : path, or iterable of path or ForeignFile
        One file per recording: text in any dialect, MATLAB, HDF5 or Excel, also gzipped; or a folder of such files.
    time, position, force : str or int, optional
        Column, by name or number counted from 1; several axes are separated by commas. ``time="none"``: no column of time.
    time_unit, position_unit, force_unit : str, optional
        Unit of the file's numbers, ``"lbf"``, or the value of the number 1: ``"35.15 N"``.
    rate : float, optional
        Sampling rate in hertz, if no column is time.
    flip_force : bool
        Change the sign of the force.
    trim : tuple of float, optional
        Start and stop in seconds of the file's clock.
    cut : iterable of (str, tuple of float), optional
        Names of the records that one file is cut into, each with start and stop as in `trim`.
    cut_by : str or int, optional
        Column, by name or number; each interval in which its value is constant becomes a record.
    table : str or int, optional
        Part of the file: number of a table in a text file, sheet of a workbook, variable or group of a MATLAB or HDF5
        file.
    encoding : str, optional
        Encoding of text, by Python's name: ``"gbk"``.
    accept_clipped : bool
        Accept records with a force or position that stays at its extreme.
    forward : bool
        Whether the load drove the tests: it was commanded, and may stay at its extreme.
    name : str, optional
        Name of the record, if one file is given, e.g. for each of several recordings in a file; default the file's name.

    Returns
    -------
    ImportedRecordings
        Result with ``records`` and ``save(folder)``; it prints the guesses and their reasons.

    Raises
    ------
    InputError
        If files have problems, with all of them: ambiguous columns with their candidates; repeated or decreasing time stamps,
        missing samples, records that cannot be analysed.

    Examples
    --------
    >>> import lumbar
    >>> import numpy as np
    >>> rows = [(0.01 * n, n % 7, n % 5) for n in range(1000)]
    >>> np.savetxt("trial_1.txt", rows, delimiter=";", header="Time (s);Position (mm);Load", comments="")
    >>> imported = lumbar.import_recordings("trial_1.txt", force_unit="lbf")
    >>> imported.records["trial_1"]
    <Record trial_1: 1000 samples at 100 Hz, 10 s; position (mm), force (N)>
    """
    columns = {"time": time, "position": position, "force": force, "cut_by": cut_by, "table": table}
    choices = Choices(
        **{name: None if item is None else str(item) for name, item in columns.items()},
        time_unit=time_unit,
        position_unit=position_unit,
        force_unit=force_unit,
        rate=rate,
        flip_force=flip_force,
        trim=trim,
        cut=tuple(cut),
        encoding=encoding,
        clipped=accept_clipped,
        load_drives=forward,
    )
    given = [files] if isinstance(files, str | os.PathLike) else files
    sources = [source for item in given for source in _list_sources(item)]
    problems = Problems("import")
    for option, is_given in (("--cut parts", bool(choices.cut)), ("--name names", bool(name))):
        if is_given and len(sources) > 1:
            problems.add("", f"{option} one file, and {len(sources)} are given", "import them one by one")
    problems.raise_if_any()
    recordings: list[ImportedRecording] = []
    first_with: dict[str, Path] = {}  # first file with each problem
    for item in sources:
        path = Path(item.table.source) if isinstance(item, ForeignFile) else item
        try:
            file = item if isinstance(item, ForeignFile) else ForeignFile.from_path(item, choices)
            called = file.name if name is None else record_name(stem_of(Path(f"{name}.csv")))
            for recording in to_records(file.table, choices, called, file.sha256):
                recordings.append(_note_inverted_sign(recording, flip_force))
        except InputError as error:
            message = str(error).replace(str(path), "").split(COLUMNS_FOLLOW)[0]
            first = first_with.setdefault(message, path)
            text = str(error) if first is path else f"{path}: as {first}"
            problems.add("", text.replace("\n", "\n    "))
    names = [recording.record.name for recording in recordings]
    for shared_name in sorted({name for name in names if names.count(name) > 1}):
        shared = [one.record.source for one in recordings if one.record.name == shared_name]
        problems.add(
            "", f"{', '.join(shared)} would all be the record {shared_name!r}", "rename all but one of them"
        )
    problems.raise_if_any()
    return ImportedRecordings(tuple(recordings))


_ENDINGS = (*COLUMN_ENDINGS, ".tsv", ".dat", ".asc", ".lvm", ".mat", ".h5", ".hdf5", ".xlsx")
"""Endings of the files that are read from a folder, also with .gz."""


def _list_sources(given: str | os.PathLike | ForeignFile) -> list[Path | ForeignFile]:
    if isinstance(given, ForeignFile):
        return [given]
    path = Path(given)
    if not path.is_dir():
        return [path]
    files: list[Path | ForeignFile] = [
        item for item in sorted(path.iterdir()) if is_column_file(item, _ENDINGS)
    ]
    if not files:
        raise InputError(f"{given}: no recordings ({', '.join(_ENDINGS)}, also with .gz)")
    return files


def _note_inverted_sign(recording: ImportedRecording, is_flipped: bool) -> ImportedRecording:
    """Add a note to a recording if its force significantly opposes the motion."""
    reason = "" if recording.record.axes else inverted_sign_reason(recording.record)
    if not reason:
        return recording
    force = recording.record.channels["output"].quantity
    remedy = "leave --flip-force out" if is_flipped else "--flip-force changes it"
    note = f"the sign of the {force} seems to be inverted: {reason}; {remedy}"
    return replace(recording, notes=(*recording.notes, note))


@dataclass(frozen=True, eq=False, repr=False)
class ImportedRecordings(Sequence[ImportedRecording]):
    """Imported recordings, each with its guesses."""

    recordings: tuple[ImportedRecording, ...]

    @property
    def records(self) -> RecordSet:
        """The records, for `lumbar.diagnose` and other functions.

        Raises
        ------
        InputError
            If the records differ in quantities or units.
        """
        records = [recording.record for recording in self.recordings]
        require_same_units(records)
        return RecordSet(records)

    @property
    def table(self) -> pd.DataFrame:
        """Table with one row per recording: numbers that show a wrong guess."""
        import pandas as pd

        return pd.DataFrame([recording.numbers for recording in self.recordings])

    def save(
        self,
        folder: str | os.PathLike,
        *,
        source_label: str | None = None,
        licence: str | None = None,
        forward: bool = False,
    ) -> Path:
        """Write a tidy CSV file per record, and a study that the workflow and ``--config`` accept; return its path.

        Parameters
        ----------
        folder : path
            A new folder, or the folder of an earlier import, to which files are added.
        source_label, licence : str, optional
            Name and licence of the data, for tables and figures.
        forward : bool
            Whether the load drove the tests and the motion was measured: the load is then the input of the study.

        Returns
        -------
        pathlib.Path
            The study's file.
        """
        folder = Path(folder)
        earlier = list(filter(is_column_file, sorted(folder.iterdir()))) if folder.is_dir() else []
        return write_folder(self.recordings, folder, earlier, source_label, licence, forward)

    def next_command(self, study: Path) -> str:
        """Return the command that diagnoses the records of a saved folder.

        Parameters
        ----------
        study : Path
            Path of the study in this folder.
        """
        command, content = ["lumbar", "diagnose", str(study.parent)], read_json(study.parent / PROVENANCE)
        if is_study_needed(content):
            command += ["--config", str(study)]
        elif content["forward"]:
            command.append("--forward")
        return shlex.join([*command, "--output", "out"])

    def __len__(self) -> int:
        return len(self.recordings)

    def __getitem__(self, which):
        return self.recordings[which]

    def __repr__(self) -> str:
        lines: list[str] = []
        for recording in self.recordings:
            record, names = recording.record, recording.names
            lines += [f"{record.source} -> {record.name}.csv", f"  {recording.form}"]
            lines += [f"  {role}: {reason}" for role, reason in recording.grounds.items()]
            frame = recording.frame().head(_PREVIEW_ROWS)
            preview = frame.to_string(index=False, float_format=lambda value: f"{value:.6g}")
            lines += [f"    {line}" for line in preview.splitlines()]
            ranges = (
                f"{names[role]} {record[role].min():.5g} to {record[role].max():.5g}"
                for role in record.channels
            )
            lines.append(
                f"  {len(record)} samples from {recording.samples_read} rows at {1 / record.sampling_time:.6g} Hz, "
                f"{record.time[0]:.6g} to {record.time[-1]:.6g} s; {', '.join(ranges)}; "
                f"largest speed {recording.speed:.4g} {recording.unit}/s"
            )
            lines += [f"  note: {note}" for note in recording.notes]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return self.table.to_html(index=False)
