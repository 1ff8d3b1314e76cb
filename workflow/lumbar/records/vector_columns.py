"""Columns of several axes in a file whose layout names those of one: position_x_mm, … for position_mm."""

import re
from collections.abc import Collection, Sequence

from lumbar.base.errors import Problems
from lumbar.settings.layout import AXES, SIDES, ColumnSettings

_QUANTITIES = {"position", "force"}


def along_axes(
    columns: dict[str, ColumnSettings], header: Sequence[str], problems: Problems
) -> dict[str, ColumnSettings]:
    """Columns by role, those of position and force with an axis each where the header has them; what is wrong goes to `problems`.

    Only names that say quantity and unit, as in the default layout, have an axis between the two.
    """
    single = {side: columns[side] for side in SIDES if side in columns}
    named = all(item.column == f"{item.quantity}_{item.unit}" for item in single.values())
    if not named or {item.quantity for item in single.values()} != _QUANTITIES:
        return columns
    found = {side: _of_axes(column, header) for side, column in single.items()}
    if not any(found.values()):
        return columns
    _check(single, found, header, problems)
    expanded: dict[str, ColumnSettings] = {}
    for role, column in columns.items():
        own = {
            f"{role}_{axis}": column.model_copy(update={"column": name})
            for axis, name in found.get(role, {}).items()
        }
        expanded |= own if role in single else {role: column}
    return expanded


def _of_axes(column: ColumnSettings, header: Sequence[str]) -> dict[str, str]:
    """Names in the header by axis, whatever their unit; the layout's own unit goes first."""
    named = re.compile(rf"{column.quantity}_([{''.join(AXES)}])_(\S+)")
    matches = sorted(filter(None, map(named.fullmatch, header)), key=lambda match: match[2] == column.unit)
    names = {match[1]: match[0] for match in matches}
    return dict(sorted(names.items()))


def _check(
    single: dict[str, ColumnSettings],
    found: dict[str, dict[str, str]],
    header: Collection[str],
    problems: Problems,
) -> None:
    """Note columns of one axis beside those of several, axes of one side alone, one axis alone and other units."""
    axes = sorted({axis for names in found.values() for axis in names})
    if len(axes) == 1:
        names = ", ".join(str(column.column) for column in single.values())
        problems.add("", f"columns of {axes[0]} alone", f"a record has two or three axes, or one: {names}")
    for side, column in single.items():
        if column.column in header:
            beside = next(name for names in found.values() for name in names.values())
            allowed = "one axis or several: give the columns that are not meant another name"
            problems.add(str(column.column), f"stands beside {beside}", allowed)
        for axis in axes:
            wanted = f"{column.quantity}_{axis}_{column.unit}"
            name = found[side].get(axis)
            if name is None:
                allowed = f"position and force need the same axes: {', '.join(axes)}"
                problems.add(wanted, "no such column", allowed)
            elif name != wanted:
                allowed = f"{wanted} is needed, or a layout with its unit"
                problems.add(name, f"another unit than {column.unit}", allowed)
