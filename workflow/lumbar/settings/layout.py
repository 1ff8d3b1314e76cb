"""How files are read: columns of tables, markers of motion capture."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal, Self, Union

from pydantic import Field, field_validator

from lumbar.settings.axes import AXES, SIDES
from lumbar.settings.section import Interval, RecordName, Section, Unique

Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
AXIS_ROLES = frozenset(f"{side}_{axis}" for side in SIDES for axis in AXES)


class ColumnSettings(Section):
    """One column: value = number in the file × scale + offset, in the unit given."""

    column: str | Annotated[int, Field(ge=1)]
    """Name in the header, or number counted from 1."""
    unit: str
    """Unit after scaling, e.g. mm."""
    quantity: str = ""
    """Measured quantity as shown on axes, e.g. position."""
    scale: float = 1.0
    """Factor from the file's numbers to the unit; not 0."""
    offset: float = 0.0
    """Added after scaling."""
    optional: bool = False
    """true: the column may be absent or constant; results that need it are then left out and reported."""

    @field_validator("scale")
    @classmethod
    def _check_scale(cls, scale: float) -> float:
        if scale == 0:
            raise ValueError("0: every value would be the same")
        return scale

    @property
    def other_sign(self) -> Self:
        """The column with the opposite sign."""
        return self.model_copy(update={"scale": -self.scale, "offset": -self.offset or 0.0})


class ColumnLayout(Section):
    """Columns of a file."""

    columns: dict[str, ColumnSettings] = Field({})
    """One entry per role: time, input, output; for several axes input_x, output_x and so on."""
    format: Literal["text", "mat"] = "text"
    """text (CSV, TXT, .gz too) or mat (MATLAB 4 to 7.2)."""
    delimiter: str = ","
    """One character, or the word whitespace."""
    header: bool = True
    """true: a line of column names precedes the data."""
    comment: str | None = None
    """Start of the lines that are skipped."""
    decimal: Literal[".", ","] = "."
    """Decimal mark."""
    clipped: Literal["refuse", "accept", "accept_load"] = "refuse"
    """accept: records are read although their force or position has runs of samples exactly at its extreme, as
    from a converter at the end of its range. accept_load: only the motion is checked, because the load was
    commanded; this is the default with improvement.forward."""

    @field_validator("columns")
    @classmethod
    def _check_axes(cls, columns: dict[str, ColumnSettings]) -> dict[str, ColumnSettings]:
        if problems := list(_problems_of_axes(columns)):
            raise ValueError("; ".join(problems))
        return columns

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes of a record with several; empty for one axis."""
        return tuple(axis for axis in AXES if f"input_{axis}" in self.columns)


def _problems_of_axes(columns: dict[str, ColumnSettings]) -> Iterator[str]:
    """Yield each fault of the roles of a layout with several axes."""
    along = {side: [axis for axis in AXES if f"{side}_{axis}" in columns] for side in SIDES}
    axes = sorted({axis for found in along.values() for axis in found})
    if not axes:
        return
    if len(axes) == 1:
        yield f"only {axes[0]}; a record has two or three axes, or one with the roles input and output"
    for side in SIDES:
        if side in columns:
            yield f"{side} together with roles of axes; use one axis or several"
        for axis in (axis for axis in axes if axis not in along[side]):
            yield f"no {side}_{axis}; input and output need the same axes"
        kinds = {
            role: (columns[role].quantity, columns[role].unit)
            for role in (f"{side}_{a}" for a in along[side])
        }
        if len(set(kinds.values())) > 1:
            listed = ", ".join(f"{role} is {quantity} in {unit}" for role, (quantity, unit) in kinds.items())
            yield f"{listed}; one quantity and unit for all axes"


class MeanOfMarkers(Section):
    """The mean of several markers."""

    mean: tuple[Alias, ...] = Field(min_length=2)
    """Markers to average, e.g. [LWRA, LWRB]."""


class PointBetween(Section):
    """A point on the line through two markers."""

    between: tuple[Alias, Alias]
    """The two markers, e.g. [C7, SACRUM]."""
    share: float = Field(ge=-1, le=2)
    """Share of the way from the first to the second: 0 is the first, 1 the second."""


class OffsetPoint(Section):
    """A point at a fixed offset in the axes of the laboratory."""

    start: Alias = Field(alias="from")
    """Marker from which the offset is counted."""
    offset_m: tuple[Metre, Metre, Metre]
    """Offset lateral (right), forward and up."""


Metre = Annotated[float, Field(ge=-1, le=1)]
Rule = Union[MeanOfMarkers, PointBetween, OffsetPoint]  # noqa: UP007 - read by Pydantic as one union
Alias = Union[str, Rule, tuple[Union[str, Rule], ...]]  # noqa: UP007
"""A label, the name of another alias or a rule; or alternatives, of which the first that the file can fill is used."""
MarkerName = Annotated[str, Field(pattern="^[A-Z][A-Z0-9_]*$")]


class MarkerLayout(Section):
    """Reading of marker files (C3D, TRC, CSV, BVH; also .gz)."""

    unit: Literal["file", "m", "cm", "mm"] = "file"
    """Unit of length; file: the unit that the file states. Another one must not contradict it."""
    scale: float = Field(1.0, gt=0, le=10000)
    """Factor on the coordinates, e.g. 0.1, if the unit that a file states is wrong."""
    up: Axis = "+z"
    """Axis of the file that points up."""
    forward: Axis = "+y"
    """Axis of the file in the direction that the subject faces; perpendicular to up."""
    subject_prefix: str = Field("strip", min_length=1)
    """Prefixes such as Subject:C7. strip: remove all; keep: remove none; a subject's name: remove only that one."""
    check_axes: bool = True
    """true: up, forward and left/right are compared with the body; use false if the subject lies down."""
    points: Literal["file", "skin", "joint_centres"] = "file"
    """skin: markers on the skin, from which joint centres are estimated; joint_centres: joint centres (of a
    suit or a camera), used as they are; file: joint centres for BVH, else skin."""
    rate_Hz: float | None = Field(None, gt=0)
    """Frames per second of a CSV file without times, or instead of a wrong rate that a file states; null takes
    them from the file."""
    aliases: dict[MarkerName, Alias | None] = Field({})
    """Rule for each standard name: a label, alternatives, {mean}, {between, share} or {from, offset_m}; null
    removes an alias of the defaults. Standard names are C7, T8, T12, L5 (spine at L4/L5), MANUBRIUM, XIPHOID,
    SACRUM, L_/R_ ASIS, PSIS, SHOULDER, ELBOW, WRIST, HIP (greater trochanter), KNEE, ANKLE, HEEL, TOE, and
    BOX_1, BOX_2, … on the box."""
    required: Unique[str] | None = None
    """Standard names that a recording must have; null: every alias. A file may lack the others."""


class RecordSettings(Section):
    """One recording of a column file."""

    name: RecordName
    """Name of the record in tables and file names."""
    file: str = Field(min_length=1)
    """File below data_root."""
    period_s: float | None = Field(None, gt=0)
    """Period of a periodic excitation."""
    trim_s: Interval | None = None
    """Start and end of the part that is read, on the file's clock; null reads all of it."""


def columns(**roles: tuple[str, str, str]) -> dict[str, ColumnSettings]:
    """Return the columns of a layout by role.

    Parameters
    ----------
    **roles : tuple of str
        Name in the header, unit and quantity, by role.
    """
    return {
        role: ColumnSettings(column=column, unit=unit, quantity=quantity)
        for role, (column, unit, quantity) in roles.items()
    }
