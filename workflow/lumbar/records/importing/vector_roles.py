"""Columns of several axes: positions and forces that the x, y and z in their names make a triple of, or a pair."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from lumbar.base.errors import InputError
from lumbar.records.importing.raw_table import RawColumn, RawTable, find_unit
from lumbar.records.importing.roles import (
    SAID,
    Role,
    Wishes,
    cannot_tell,
    check_twice,
    find_roles,
    in_unit,
    named_so,
    parted,
    ranked,
    tokens,
    wished,
)
from lumbar.settings.layout import AXES

QUANTITIES = {"position": "length", "force": "force"}
_LETTERS = {"position": ("", "p"), "force": ("f",)}
"""Names that an axis leaves a letter of, as px, or none, as x."""
_KNOWN = "|".join(re.escape(word) for role in QUANTITIES for word in (*SAID[role].split(), *_LETTERS[role]))
_WITH_AXIS = re.compile(rf"(?P<before>{_KNOWN})(?P<axis>[{''.join(AXES)}])(?P<behind>{_KNOWN})")
_TURNING = frozenset(SAID["turning"].split())
_MATRIX = re.compile(r"^(?P<name>.*)\(:,(?P<number>\d+)\)$")


@dataclass(frozen=True)
class Axes:
    """Columns of one name that differ in their axis."""

    name: str
    """Without the axis, in small letters; that of the group above where nothing else is left."""
    columns: dict[str, RawColumn]
    """By axis."""

    @property
    def label(self) -> str:
        """The columns, for messages."""
        return ", ".join(column.label for column in self.columns.values())

    def rank(self, role: str) -> tuple[int, bool] | None:
        """How plainly they have a role, as of `lumbar.records.importing.roles.ranked`; None where they cannot."""
        units = [find_unit(column.unit) for column in self.columns.values()]
        said = {unit.quantity for unit in units if unit is not None}
        fits, named = said == {QUANTITIES[role]}, named_so(self.name, role)
        if named < 0 or said - {QUANTITIES[role], "reading"} or _TURNING & set(tokens(self.name)):
            return None
        named = 1 if self.name in _LETTERS[role] else named
        return (named, fits) if named or fits else None


def axis_in(name: str) -> tuple[str, str]:
    """Part the name of a column into what is left without its axis, and the axis; empty where it has none.

    Examples
    --------
    >>> axis_in("Force X"), axis_in("pos_y"), axis_in("Fz"), axis_in("xpos"), axis_in("X"), axis_in("Extension")
    (('force', 'x'), ('pos', 'y'), ('f', 'z'), ('pos', 'x'), ('', 'x'), ('', ''))
    """
    if matrix := _MATRIX.match(name):
        number = int(matrix["number"])
        return matrix["name"].casefold(), AXES[number - 1] if 1 <= number <= len(AXES) else ""
    words = re.findall(r"[^\W_]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).casefold())
    with_axis = [(at, found) for at, word in enumerate(words) if (found := _WITH_AXIS.fullmatch(word))]
    if len(with_axis) != 1:
        return "", ""
    at, found = with_axis[0]
    left = found["before"] + found["behind"]
    return " ".join(filter(None, [*words[:at], left, *words[at + 1 :]])), found["axis"]


def find_axes(columns: Sequence[RawColumn]) -> list[Axes]:
    """Columns that two or three axes differ in; none where an axis stands twice, and of a matrix three columns only."""
    named: dict[tuple[str, str], list[tuple[str, RawColumn]]] = {}
    for column in columns:
        left, axis = axis_in(column.own_name)
        if axis or _MATRIX.match(column.own_name):
            named.setdefault((column.group, left), []).append((axis, column))
    found = []
    for (group, left), members in named.items():
        axes = sorted(axis for axis, _ in members)
        matrix = any(_MATRIX.match(column.own_name) for _, column in members)
        if len(set(axes)) == len(axes) >= 2 + matrix and axes[0]:
            above = (re.split(r"[./]", group.rstrip("./"))[-1]).casefold()
            found.append(Axes(left or above, dict(sorted(members, key=lambda member: member[0]))))
    return found


def find_roles_of_axes(table: RawTable, wishes: Wishes, rate: float | None = None) -> dict[str, Role]:
    """Find the columns of one axis as `find_roles` does, or else those of several: ``position_x``, …, ``force_z``.

    Columns that a person names are parted by commas. Otherwise a triple is taken where no single column has its role as
    plainly.

    Raises
    ------
    InputError
        With the candidates and the options to choose among them.
    """
    try:
        return find_roles(table, wishes, rate=rate)
    except InputError:
        chosen = _chosen(table, wishes)
        if chosen is None:
            raise
    position, force = (chosen[role] for role in QUANTITIES)
    if list(position) != list(force):
        told = " and ".join(f"{role} has {', '.join(chosen[role])}" for role in QUANTITIES)
        option = "--position and --force name the columns of the same axes, parted by commas"
        raise cannot_tell(table, [f"{told}; {option}"])
    problems, roles = [], {}
    for role, columns in chosen.items():
        wish, unit = wishes.get(role, (None, None))
        names: Sequence[str | None] = parted(wish) or [None] * len(columns)
        try:
            for (axis, column), name in zip(columns.items(), names, strict=True):
                check_twice(column, name, table, role)
                own = in_unit(column, role, unit, f"as told by --{role}" if name else "by its name")
                if own.unit.quantity not in (QUANTITIES[role], "reading"):
                    told = f"{column.label} is in {own.unit.name}, a unit of {own.unit.quantity}"
                    raise InputError(f"{told}; records of several axes have lengths and forces")
                roles[f"{role}_{axis}"] = own
        except InputError as error:
            problems.append(str(error))
    if problems:
        raise cannot_tell(table, problems)
    taken = {item.column.number for item in roles.values()}
    return {**find_roles(table, wishes, ("time",), taken, rate), **roles}


def _chosen(table: RawTable, wishes: Wishes) -> dict[str, dict[str, RawColumn]] | None:
    """Columns by role and axis; None where these are no columns of several axes."""
    every, problems, chosen = find_axes(table.columns), [], {}
    for role in QUANTITIES:
        wish = wishes.get(role, (None, None))[0]
        if names := parted(wish):
            try:
                chosen[role] = _told(table.columns, names, role)
            except InputError as error:
                problems.append(str(error))
            continue
        best = [] if wish else _best(every, table.columns, role)
        if not best:
            return None
        if len(best) > 1:
            labels = "; or ".join(axes.label for axes in best)
            example = ",".join(str(column.number) for column in best[0].columns.values())
            problems.append(f"{role} may be {labels}; choose by --{role} {example}, say")
        chosen[role] = best[0].columns
    if problems:
        raise cannot_tell(table, problems)
    return chosen


def _best(every: Sequence[Axes], columns: Sequence[RawColumn], role: str) -> list[Axes]:
    """The columns of axes that have a role most plainly; none where a single column has it as plainly."""
    ranks = [(rank, axes) for axes in every if (rank := axes.rank(role)) is not None]
    if not ranks:
        return []
    highest = max(rank for rank, _ in ranks)
    in_axes = {column.number for axes in every for column in axes.columns.values()}
    single = max(ranked((column for column in columns if column.number not in in_axes), role), default=None)
    return (
        [] if single is not None and single >= highest else [axes for rank, axes in ranks if rank == highest]
    )


def _told(columns: Sequence[RawColumn], names: Sequence[str], role: str) -> dict[str, RawColumn]:
    """Columns that a person named, by the axes in their names; where these say none, in the order x, y, z."""
    if not 2 <= len(names) <= len(AXES):
        raise InputError(f"--{role}: {len(names)} columns; two or three axes have one each")
    found = [wished(columns, name, role)[0] for name in names]
    if len({column.number for column in found}) < len(found):
        raise InputError(f"--{role}: a column is named twice; each axis has its own")
    axes = [axis_in(column.own_name)[1] for column in found]
    axes = axes if all(axes) and len(set(axes)) == len(axes) else list(AXES[: len(found)])
    return dict(sorted(zip(axes, found, strict=True)))
