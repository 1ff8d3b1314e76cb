"""Base class of results of API functions, and helpers for arguments that all API functions have."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lumbar.base.errors import InputError
from lumbar.base.files import require_file, write_csv, write_json

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from lumbar.records.record import Record
    from lumbar.settings.study_settings import StudySettings


UNKNOWN_SOURCE = "source unknown"


def data_label(given: str, sources: Iterable[str]) -> str:
    """Return the given label, else the name of the folder of several files or of a single file; skip empty sources.

    Parameters
    ----------
    given : str
        Label that the user gave; empty without one.
    sources : iterable of str
        Paths of the files that were read.

    Examples
    --------
    >>> data_label("", ["recordings/tissue/chirp.csv", "recordings/tissue/noise.csv"])
    'tissue'
    >>> data_label("", ["answers.csv"])
    'answers.csv'
    >>> data_label("", [""])
    'source unknown'
    """
    files = [Path(source).resolve() for source in dict.fromkeys(sources) if source]
    names = [file.name for file in files] if len(files) == 1 else [file.parent.name for file in files]
    return given or ", ".join(dict.fromkeys(names)) or UNKNOWN_SOURCE


def records_label(given: str, records: Iterable[Record]) -> str:
    """Return the `data_label` of records.

    Parameters
    ----------
    given : str
        Label that the user gave; empty without one.
    records : iterable of Record
        Argument ``records`` of an API function.

    Raises
    ------
    InputError
        If an item is not a record.
    """
    from lumbar.records.record import Record

    if isinstance(records, Record):
        raise InputError(f"records is the record {records.name!r} alone: give a list, e.g. [record]")
    items: list = [records] if isinstance(records, str | Path) else list(records)
    if not all(isinstance(item, Record) for item in items):
        raise InputError(f"records is {records!r:.80}: give records, e.g. lumbar.read('recordings')")
    return data_label(given, (record.source for record in items))


def settings_or_default(given: StudySettings | None) -> StudySettings:
    """Return the settings of a study that were given, or the defaults.

    Parameters
    ----------
    given : StudySettings or None
        Settings that the user gave.

    Raises
    ------
    InputError
        If only one section of the settings is given.
    """
    from lumbar.settings.study_settings import StudySettings

    if not isinstance(given, StudySettings | None):
        raise InputError(
            f"settings is an object of class {type(given).__name__}: give those of a whole study, as lumbar.load_settings "
            "returns them, or StudySettings(improvement=ImprovementSettings(most_effects=1))"
        )
    return given or StudySettings()


def read_table(path: str | os.PathLike, what: str) -> pd.DataFrame:
    """Return a CSV file as a frame.

    Parameters
    ----------
    path : path
        The file.
    what : str
        Content of the table, for messages.

    Raises
    ------
    InputError
        If `require_file` raises it, or the file is not a table of this content.
    """
    import pandas as pd

    require_file(path)
    try:
        frame = pd.read_csv(path)
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a table of {what} ({error})") from error
    if not isinstance(frame.index, pd.RangeIndex):  # made by pandas of cells without a column
        raise InputError(
            f"{path}: rows have more cells than the header; numbers need a decimal point, no comma"
        )
    return frame


class Result(ABC):
    """Result of an API function: printing it shows sentences, a notebook shows its table, `save` writes its files."""

    source_label: str
    """Name of the source of the data."""

    @property
    @abstractmethod
    def table(self) -> Any:
        """Main numbers: a published table, a frame or rows."""

    def figure(self) -> Figure:
        """Return the picture of the result.

        Raises
        ------
        InputError
            If the result has no picture or several.
        """
        raise InputError(f"{self!r} has no single picture; save(folder) writes all that it has")

    @abstractmethod
    def files(self) -> Iterable[tuple[str, Any]]:
        """Yield name and content of every file.

        Yields
        ------
        tuples of str and object
            Frames (``.csv``), plain data (``.json``), published tables and figures (no ending).
        """

    def save(self, folder: str | os.PathLike) -> None:
        """Write all `files` into a folder; tables and figures in each of their formats.

        Parameters
        ----------
        folder : path
            Folder; it is made if it is missing.
        """
        for name, content in self.files():
            _write(Path(folder) / name, content, self.source_label)

    def write(self, paths: Mapping[str, str | os.PathLike]) -> None:
        """Write some of the `files`, each to its own path; tables and figures to a path without an ending.

        Parameters
        ----------
        paths : dict of str to path
            Path of each file to write, by its name in `files`.
        """
        for name, content in self.files():
            if name in paths:
                _write(Path(paths[name]), content, self.source_label)

    def _repr_html_(self) -> str:
        import pandas as pd

        table = self.table
        return pd.DataFrame(getattr(table, "frame", table)).to_html(index=False)


def _write(path: Path, content: Any, source_label: str) -> None:
    if path.suffix == ".csv":
        write_csv(path, content)
    elif path.suffix == ".json":
        write_json(path, content)
    elif hasattr(content, "write"):
        content.write(path)
    else:
        from lumbar.publishing.figures.style import save

        save(content, path, source_label)
