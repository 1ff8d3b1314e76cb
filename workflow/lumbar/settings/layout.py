"""How files are read: columns of tables, markers of motion capture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Literal, Self, Union

from lumbar.settings.key import UNIQUE, Each, RecordName, key, required, settings

Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
AXES, SIDES = ("x", "y", "z"), ("input", "output")
"""Axes of a record of several, and the two sides whose roles have an axis behind them: ``input_x``."""
AXIS_ROLES = frozenset(f"{side}_{axis}" for side in SIDES for axis in AXES)


@settings
class ColumnSettings:
    """One column: value = number in the file × scale + offset, in the unit given."""

    column: str | Annotated[int, Each(ge=1)] = required()
    unit: str = required()
    quantity: str = key(default="")
    scale: float = key(default=1.0)
    offset: float = key(default=0.0)
    optional: bool = key(default=False)

    def __post_init__(self):
        if self.scale == 0:
            raise ValueError("scale is 0: every value would be the same")

    @property
    def other_sign(self) -> Self:
        """The same column, counted the other way."""
        return replace(self, scale=-self.scale, offset=-self.offset or 0.0)


@settings
class ColumnLayout:
    """How the columns of a file are read."""

    columns: dict[str, ColumnSettings] = key(default={})
    format: Literal["text", "mat"] = key(default="text")
    delimiter: str = key(default=",")
    header: bool = key(default=True)
    comment: str | None = key(default=None)
    decimal: Literal[".", ","] = key(default=".")
    clipped: Literal["refuse", "accept"] = key(default="refuse")

    def __post_init__(self):
        if problems := list(_problems_of_axes(self.columns)):
            raise ValueError(f"columns: {'; '.join(problems)}")

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes of records of several; empty for one axis."""
        return tuple(axis for axis in AXES if f"input_{axis}" in self.columns)


def _problems_of_axes(columns: dict[str, ColumnSettings]) -> Iterator[str]:
    """What is wrong with the roles of a layout of several axes."""
    along = {side: [axis for axis in AXES if f"{side}_{axis}" in columns] for side in SIDES}
    axes = sorted({axis for found in along.values() for axis in found})
    if not axes:
        return
    if len(axes) == 1:
        yield f"{axes[0]} alone; a record has two or three axes, or one with the roles input and output"
    for side in SIDES:
        if side in columns:
            yield f"{side} beside roles of axes; one axis or several"
        for axis in (axis for axis in axes if axis not in along[side]):
            yield f"no {side}_{axis}; input and output need the same axes"
        kinds = {
            role: (columns[role].quantity, columns[role].unit)
            for role in (f"{side}_{a}" for a in along[side])
        }
        if len(set(kinds.values())) > 1:
            told = ", ".join(f"{role} is {quantity} in {unit}" for role, (quantity, unit) in kinds.items())
            yield f"{told}; one quantity and unit for all axes"


@settings
class MeanOfMarkers:
    """The mean of several markers."""

    mean: tuple[Alias, ...] = required(min_length=2)


@settings
class PointBetween:
    """A point on the line through two markers."""

    between: tuple[Alias, Alias] = required()
    share: float = required(within="[-1, 2]")


@settings
class OffsetPoint:
    """A point at a fixed offset in the axes of the laboratory."""

    start: Alias = required(alias="from")
    offset_m: tuple[Metre, Metre, Metre] = required()


Metre = Annotated[float, Each(ge=-1, le=1)]
Rule = Union[MeanOfMarkers, PointBetween, OffsetPoint]  # noqa: UP007 - read by Pydantic as one union
Alias = Union[str, Rule, tuple[Union[str, Rule], ...]]  # noqa: UP007
"""A label or another alias's name, a rule, or alternatives of these, of which the first that the file can fill is taken."""
MarkerName = Annotated[str, Each(pattern="^[A-Z][A-Z0-9_]*$")]


@settings
class MarkerLayout:
    """How marker files (C3D, TRC, CSV, BVH; also .gz) are read."""

    unit: Literal["file", "m", "cm", "mm"] = key(default="file")
    scale: float = key(default=1.0, within="(0, 10000]")
    up: Axis = key(default="+z")
    forward: Axis = key(default="+y")
    subject_prefix: str = key(default="strip", min_length=1)
    check_axes: bool = key(default=True)
    points: Literal["file", "skin", "joint_centres"] = key(default="file")
    rate_Hz: float | None = key(default=None, gt=0)
    aliases: dict[MarkerName, Alias | None] = key(default={})
    required: Annotated[tuple[str, ...], UNIQUE] | None = key(default=None)


@settings
class RecordSettings:
    """One recording of a column file."""

    name: RecordName = required()
    file: str = required(min_length=1)
    period_s: float | None = key(default=None, gt=0)
    trim_s: tuple[float, float] | None = key(default=None)

    def __post_init__(self):
        if self.trim_s is not None and not self.trim_s[0] < self.trim_s[1]:
            raise ValueError("trim_s: the start must lie before the end")


def columns(**roles: tuple[str, str, str]) -> dict[str, ColumnSettings]:
    """Columns of a layout by role, each (name in the header, unit, quantity)."""
    return {role: ColumnSettings(*words) for role, words in roles.items()}
