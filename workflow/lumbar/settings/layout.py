"""How files are read: columns of tables, markers of motion capture."""

from __future__ import annotations

from typing import Annotated, Literal, Union

from lumbar.settings.key import UNIQUE, Each, RecordName, key, required, settings

Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]


@settings
class ColumnSettings:
    """One column: value = number in the file × scale + offset, in the unit given."""

    column: str | Annotated[int, Each(ge=1)] = required("Name from the header, or number counted from 1.")
    unit: str = required("Unit after scaling, e.g. mm.")
    quantity: str = key("What is measured, as it stands on axes, e.g. position.", default="")
    scale: float = key("Factor from the file's numbers to the unit; not 0.", default=1.0)
    offset: float = key("Added after scaling.", default=0.0)
    optional: bool = key(
        "true: the column may be absent, and constant; what needs it is then left out, and said to be.",
        default=False,
    )

    def __post_init__(self):
        if self.scale == 0:
            raise ValueError("scale is 0: every value would be the same")


@settings
class ColumnLayout:
    """How the columns of a file are read."""

    columns: dict[str, ColumnSettings] = key("One entry per role, e.g. time, input, output.", default={})
    format: Literal["text", "mat"] = key("text (CSV, TXT, .gz too) or mat (MATLAB 4 to 7.2).", default="text")
    delimiter: str = key("One character, or the word whitespace.", default=",")
    header: bool = key("Whether a line of column names comes before the data.", default=True)
    comment: str | None = key("Lines that start with this are skipped.", default=None)
    decimal: Literal[".", ","] = key("Decimal mark.", default=".")
    clipped: Literal["refuse", "accept"] = key(
        "Whether records are accepted whose force or position holds runs of samples exactly at its extreme, as of a "
        "converter at the end of its range.",
        default="refuse",
    )


@settings
class MeanOfMarkers:
    """The mean of several markers."""

    mean: tuple[Alias, ...] = required("Markers whose mean is taken, e.g. [LWRA, LWRB].", min_length=2)


@settings
class PointBetween:
    """A point on the line through two markers."""

    between: tuple[Alias, Alias] = required("The two markers, e.g. [C7, SACRUM].")
    share: float = required(
        "Share of the way from the first to the second: 0 is the first, 1 the second.", within="[-1, 2]"
    )


@settings
class OffsetPoint:
    """A point at a fixed offset in the axes of the laboratory."""

    start: Alias = required("Marker the offset starts from.", alias="from")
    offset_m: tuple[Metre, Metre, Metre] = required("Offset lateral (right), forward and up.")


Metre = Annotated[float, Each(ge=-1, le=1)]
Rule = Union[MeanOfMarkers, PointBetween, OffsetPoint]  # noqa: UP007 - read by Pydantic as one union
Alias = Union[str, Rule, tuple[Union[str, Rule], ...]]  # noqa: UP007
"""A label or another alias's name, a rule, or alternatives of these, of which the first that the file can fill is taken."""
MarkerName = Annotated[str, Each(pattern="^[A-Z][A-Z0-9_]*$")]


@settings
class MarkerLayout:
    """How marker files (C3D, TRC, CSV, MAT, BVH; also .gz) are read."""

    unit: Literal["file", "m", "cm", "mm"] = key(
        "Unit of length: file takes the one the file states; any other one must not contradict it.",
        default="file",
    )
    scale: float = key(
        "Factor on the coordinates where the unit that a file states is wrong, e.g. 0.1.",
        default=1.0,
        within="(0, 10000]",
    )
    up: Axis = key("Axis of the file that points up.", default="+z")
    forward: Axis = key(
        "Axis of the file that points the way the person faces; perpendicular to up.", default="+y"
    )
    subject_prefix: str = key(
        "Prefixes such as Subject:C7: strip takes all off, keep none, a subject's name that one alone.",
        default="strip",
        min_length=1,
    )
    check_axes: bool = key(
        "Whether up, forward and left/right are compared with the body; false where the person turns round or lies "
        "down.",
        default=True,
    )
    rate_Hz: float | None = key(
        "Frames per second of a CSV or MAT file that has no times, or where the rate that a file states is wrong; null "
        "takes them from the file.",
        default=None,
        gt=0,
    )
    aliases: dict[MarkerName, Alias | None] = key(
        "Standard name to what fills it: a label, alternatives, {mean}, {between, share} or {from, offset_m}; null takes "
        "an alias of the defaults away. Standard "
        "names are C7, T8, T12, L5 (spine at L4/L5), MANUBRIUM, XIPHOID, SACRUM, L_/R_ ASIS, PSIS, SHOULDER, ELBOW, WRIST, HIP "
        "(greater trochanter), KNEE, ANKLE, HEEL, TOE, and BOX_1, BOX_2, … on the box.",
        default={},
    )
    required: Annotated[tuple[str, ...], UNIQUE] | None = key(
        "Standard names without which a recording is refused; null: every alias. The others may be absent from a file.",
        default=None,
    )


@settings
class RecordSettings:
    """One recording of a column file."""

    name: RecordName = required("Name of the record in tables and file names.")
    file: str = required("File below data_root.", min_length=1)
    period_s: float | None = key("Period of the excitation, where it is periodic.", default=None, gt=0)
    trim_s: tuple[float, float] | None = key(
        "Start and end of the part that is read, on the file's own clock; null reads all of it.", default=None
    )

    def __post_init__(self):
        if self.trim_s is not None and not self.trim_s[0] < self.trim_s[1]:
            raise ValueError("trim_s: the start must lie before the end")


def columns(**roles: tuple[str, str, str]) -> dict[str, ColumnSettings]:
    """Columns of a layout by role, each (name in the header, unit, quantity)."""
    return {role: ColumnSettings(*words) for role, words in roles.items()}
