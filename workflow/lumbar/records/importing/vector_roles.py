"""Columns of several axes: positions and forces with x, y and z in their names, as a triple or a pair."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from lumbar.base.errors import InputError
from lumbar.records.importing.raw_table import RawColumn, RawTable, find_unit
from lumbar.records.importing.roles import (
    ROLE_WORDS,
    Requests,
    Role,
    ambiguity_error,
    assign_unit,
    find_roles,
    name_match_score,
    rank_columns,
    require_unique_name,
    select_column,
    split_columns,
    split_words,
)
from lumbar.settings.axes import AXES

QUANTITIES = {"position": "length", "force": "force"}
_LETTERS = {"position": ("", "p"), "force": ("f",)}
"""Rest of a short name, such as px or x, after its axis is removed; by role."""
_NAMES = "|".join(
    re.escape(word) for role in QUANTITIES for word in (*ROLE_WORDS[role].split(), *_LETTERS[role])
)
_AXIS_NAME = re.compile(rf"(?P<before>{_NAMES})(?P<axis>[{''.join(AXES)}])(?P<after>{_NAMES})")
_ROTATIONS = frozenset(ROLE_WORDS["turning"].split())
_MATRIX = re.compile(r"^(?P<name>.*)\((?=:|\d+,)[:,]*(?P<number>\d+)[:,]*\)$")
"""Channel of a matrix, ``data(:,2)`` or ``data(2,:)``."""


@dataclass(frozen=True)
class AxisColumns:
    """Columns whose names differ only in the axis."""

    name: str
    """Name without the axis, in lower case; the group's name if nothing is left."""
    columns: dict[str, RawColumn]
    """Columns by axis."""

    def rank(self, role: str) -> tuple[int, bool] | None:
        """Return the score of the name for a role and whether the unit fits (see `rank_columns`); None if no role is possible.

        Parameters
        ----------
        role : str
            ``"position"`` or ``"force"``.
        """
        units = [find_unit(column.unit) for column in self.columns.values()]
        quantities = {unit.quantity for unit in units if unit is not None}
        fits, score = quantities == {QUANTITIES[role]}, name_match_score(self.name, role)
        if (
            score < 0
            or quantities - {QUANTITIES[role], "reading"}
            or _ROTATIONS & set(split_words(self.name))
        ):
            return None
        score = 1 if self.name in _LETTERS[role] else score
        return (score, fits) if score or fits else None


def split_axis(name: str) -> tuple[str, str]:
    """Split the name of a column into the rest, in lower case, and the axis; both are empty without an axis.

    Parameters
    ----------
    name : str
        Name of the column.

    Examples
    --------
    >>> [split_axis(name) for name in ("Force X", "pos_y", "Fz", "xpos", "X", "Extension")]
    [('force', 'x'), ('pos', 'y'), ('f', 'z'), ('pos', 'x'), ('', 'x'), ('', '')]
    """
    if matrix := _MATRIX.match(name):
        number = int(matrix["number"])
        return matrix["name"].casefold(), AXES[number - 1] if 1 <= number <= len(AXES) else ""
    words = re.findall(r"[^\W_]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).casefold())
    matches = [(at, match) for at, word in enumerate(words) if (match := _AXIS_NAME.fullmatch(word))]
    if len(matches) != 1:
        return "", ""
    at, match = matches[0]
    words[at] = match["before"] + match["after"]
    return " ".join(filter(None, words)), match["axis"]


def find_axes(columns: Sequence[RawColumn]) -> list[AxisColumns]:
    """Return groups of two or three columns that differ only in the axis, without duplicates; a matrix needs three.

    Parameters
    ----------
    columns : sequence of RawColumn
        Columns of one table.
    """
    members: dict[tuple[str, str], list[tuple[str, RawColumn]]] = {}
    for column in columns:
        rest, axis = split_axis(column.name_in_group)
        if axis or _MATRIX.match(column.name_in_group):
            members.setdefault((column.group, rest), []).append((axis, column))
    groups = []
    for (group, rest), pairs in members.items():
        axes = sorted(axis for axis, _ in pairs)
        is_matrix = any(_MATRIX.match(column.name_in_group) for _, column in pairs)
        if len(set(axes)) == len(axes) >= 2 + is_matrix and axes[0]:
            above = (re.split(r"[./]", group.rstrip("./"))[-1]).casefold()
            groups.append(AxisColumns(rest or above, dict(sorted(pairs, key=lambda pair: pair[0]))))
    return groups


def find_roles_of_axes(table: RawTable, requests: Requests, rate: float | None = None) -> dict[str, Role]:
    """Find the columns of one axis with `find_roles`, or of several axes: ``position_x``, …, ``force_z``.

    The user separates columns by commas. Otherwise a triple is used unless a single column has an equal score for the role.

    Parameters
    ----------
    table : RawTable
        Table of the file.
    requests : Requests
        The user's options for each role.
    rate : float, optional
        Rate in hertz that the user gave instead of a column of time.

    Raises
    ------
    InputError
        If columns are unclear, with the candidates and the options to choose among them.
    """
    try:
        return find_roles(table, requests, rate=rate)
    except InputError:
        chosen = _choose_axes(table, requests)
        if chosen is None:
            raise
    position, force = (chosen[role] for role in QUANTITIES)
    if list(position) != list(force):
        listed = " and ".join(f"{role} has {', '.join(chosen[role])}" for role in QUANTITIES)
        remedy = "--position and --force name the columns of the same axes, separated by commas"
        raise ambiguity_error(table, [f"{listed}; {remedy}"])
    problems, roles = [], {}
    for role, columns in chosen.items():
        request, unit = requests[role]
        names: Sequence[str | None] = split_columns(request) or [None] * len(columns)
        try:
            for (axis, column), name in zip(columns.items(), names, strict=True):
                require_unique_name(column, name, table, role)
                item = assign_unit(column, role, unit, f"as given by --{role}" if name else "by its name")
                if item.unit.quantity not in (QUANTITIES[role], "reading"):
                    raise InputError(
                        f"{column.label} is in {item.unit.name}, a unit of {item.unit.quantity}; records of several axes have "
                        "lengths and forces"
                    )
                roles[f"{role}_{axis}"] = item
        except InputError as error:
            problems.append(str(error))
    if problems:
        raise ambiguity_error(table, problems)
    used = {item.column.number for item in roles.values()}
    return {**find_roles(table, requests, ("time",), used, rate), **roles}


def _choose_axes(table: RawTable, requests: Requests) -> dict[str, dict[str, RawColumn]] | None:
    """Return columns by role and axis; None without columns of several axes."""
    every, problems, chosen = find_axes(table.columns), [], {}
    in_axes = {column.number for axes in every for column in axes.columns.values()}
    for role in QUANTITIES:
        request, _ = requests[role]
        if names := split_columns(request):
            try:
                chosen[role] = _select_axes(table.columns, names, role)
            except InputError as error:
                problems.append(str(error))
            continue
        # The clearest columns of axes, unless a single column is as clear.
        ranks = [(rank, axes) for axes in every if (rank := axes.rank(role)) is not None]
        highest = max((rank for rank, _ in ranks), default=None)
        others = (column for column in table.columns if column.number not in in_axes)
        single = max(rank_columns(others, role), default=None)
        if request or highest is None or (single is not None and single >= highest):
            return None
        best = [axes for rank, axes in ranks if rank == highest]
        if len(best) > 1:
            labels = "; or ".join(", ".join(item.label for item in axes.columns.values()) for axes in best)
            example = ",".join(str(column.number) for column in best[0].columns.values())
            problems.append(f"{role} may be {labels}; choose by --{role} {example}, say")
        chosen[role] = best[0].columns
    if problems:
        raise ambiguity_error(table, problems)
    return chosen


def _select_axes(columns: Sequence[RawColumn], names: Sequence[str], role: str) -> dict[str, RawColumn]:
    """Return the columns that the user named, by the axes in their names, or in the order x, y, z if the names have no axes."""
    if not 2 <= len(names) <= len(AXES):
        raise InputError(f"--{role}: {len(names)} columns; two or three axes have one each")
    selected = [select_column(columns, name, role)[0] for name in names]
    if len({column.number for column in selected}) < len(selected):
        raise InputError(f"--{role}: a column is named twice; each axis has its own")
    axes = [split_axis(column.name_in_group)[1] for column in selected]
    axes = axes if all(axes) and len(set(axes)) == len(axes) else list(AXES[: len(selected)])
    return dict(sorted(zip(axes, selected, strict=True)))
