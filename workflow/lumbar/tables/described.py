"""Tables described in the ``tables.yaml`` of a package: title, notes, and each column in one place."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lumbar.base.yaml_file import shipped_yaml
from lumbar.tables.table import Table

if TYPE_CHECKING:
    import pandas as pd


_LIBRARY = Path(__file__).parents[1]


@cache
def _tables(package: str) -> dict[str, Any]:
    """Read the ``tables.yaml`` of a package, a folder of the library."""
    return shipped_yaml(_LIBRARY / package / "tables.yaml")


def columns_of(package: str, name: str) -> list[str]:
    """Return the columns of a description in its order; `package` and `name` as for `described`."""
    return list(_tables(package)[name]["columns"])


def described(
    package: str,
    name: str,
    values: pd.DataFrame | Sequence[Mapping],
    source_label: str,
    words: Mapping[str, Any] | None = None,
    without: Collection[str] = (),
    **more: Any,
) -> Table:
    """A table with the words of its description.

    Parameters
    ----------
    package : str
        Folder of the ``tables.yaml`` below ``lumbar``, e.g. ``"lifting/stability"``.
    name : str
        Of the table there. A column says what it ``is``, or also its ``header``, its ``decimals`` (then it holds floats)
        and whether cells may be ``empty``; ``*`` in its name stands for any words. ``folded`` lists the columns that HTML
        shows on demand and LaTeX leaves out; every other column is shown. A table without ``folded`` or headers shows
        as many columns as fit the page.
    values : pandas.DataFrame or sequence of mapping
        The frame, or rows, which get the columns of the description in its order.
    words : mapping, optional
        What stands for ``{…}`` in the description's texts.
    without : collection of str
        Columns of the description that rows do not get.
    **more
        Further fields of `Table`; notes and decimals stand behind those of the description.
    """
    import pandas as pd

    said, words = _tables(package)[name], words or {}
    if not isinstance(values, pd.DataFrame):
        names = [column for column in said["columns"] if column not in without]
        floats = [column for column in names if "decimals" in said["columns"][column]]
        values = pd.DataFrame(values, columns=names).astype(dict.fromkeys(floats, float))
    columns = {column: _column(said["columns"], column) for column in values.columns}

    def of_columns(key: str) -> dict[str, Any]:
        return {column: item[key] for column, item in columns.items() if key in item}

    fields = {
        "notes": (*(note.format(**words) for note in said.get("notes", ())), *more.pop("notes", ())),
        "decimals": of_columns("decimals") | more.pop("decimals", {}),
        "may_be_empty": frozenset(of_columns("empty")),
        "headers": {column: text.format(**words) for column, text in of_columns("header").items()},
        "first": _shown(said, columns),
    }
    definitions = {column: text.format(**words) for column, text in of_columns("is").items()}
    return Table(said["title"].format(**words), values, definitions, source_label, **fields | more)


def _shown(said: Mapping[str, Any], names: Iterable[str]) -> tuple[str, ...]:
    """Columns that are not folded; none if the description folds no columns."""
    if "folded" not in said:
        return ()
    return tuple(name for name in names if not any(fnmatchcase(name, folded) for folded in said["folded"]))


def _column(columns: Mapping[str, Any], name: str) -> dict[str, Any]:
    """What is said of a column; of one that a ``*`` stands for with its own words in that place."""
    for key, said in columns.items():
        before, star, behind = key.partition("*")
        if name == key or (star and name.startswith(before) and name.endswith(behind)):
            item = {"is": said} if isinstance(said, str) else said
            own = name[len(before) : len(name) - len(behind)]
            return {
                field: text.replace("*", own) if star and isinstance(text, str) else text
                for field, text in item.items()
            }
    return {}
