"""Which column is time, which position, which force: as a person says, by names in several languages, units and order."""

import re
import unicodedata
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError
from lumbar.base.yaml_file import shipped_yaml
from lumbar.records.importing.clock import stated_time
from lumbar.records.importing.raw_table import (
    SPEEDS,
    RawColumn,
    RawTable,
    ReadOptions,
    Unit,
    find_unit,
    parse_unit,
)

ROLES = ("time", "position", "force")
NONE = "none"
"""What a person gives for the time of a table that has none."""
QUANTITIES = {"time": ("time",), "position": ("length", "angle"), "force": ("force", "torque")}
_TAKEN = {**QUANTITIES, "position": (*QUANTITIES["position"], *SPEEDS.values())}
"""What a role is made of: a velocity is integrated."""
SAID: dict[str, str] = shipped_yaml(Path(__file__).with_suffix(".yaml"))
_VELOCITIES, _UNMEASURED = SAID["velocity"].split(), frozenset(SAID["unmeasured"].split())
_WEAK = {"time": "t", "position": "x y z", "force": "f fx fy fz"}
"""Names of one letter, which others use for other things."""
_OTHERS = frozenset([*_VELOCITIES, *_UNMEASURED, *SAID["others"].split()])
"""Words of what is measured or commanded beside the three; a column named so is taken on request only."""


Wishes = dict[str, tuple[str | None, str | None]]


def parted(wish: str | None) -> list[str]:
    """Columns of several axes that a person gives by one option, parted by commas; none of a single column."""
    return [part.strip() for part in wish.split(",")] if wish and "," in wish else []


@dataclass(frozen=True)
class Choices:
    """What a person says instead of what would be guessed, as of `lumbar.import_recordings`; None leaves it to the guess."""

    time: str | None = None
    position: str | None = None
    force: str | None = None
    time_unit: str | None = None
    position_unit: str | None = None
    force_unit: str | None = None
    rate: float | None = None
    flip_force: bool = False
    trim: tuple[float, float] | None = None
    cut: tuple[tuple[str, tuple[float, float]], ...] = ()
    cut_by: str | None = None
    table: str | None = None
    encoding: str | None = None
    clipped: bool = False

    def __post_init__(self):
        if bool(self.cut) + (self.cut_by is not None) + (self.trim is not None) > 1:
            raise InputError("give one of --cut, --cut-by and --trim")
        if self.rate is not None and not 0 < self.rate < np.inf:
            raise InputError(f"--rate {self.rate:g}: a positive number of hertz is needed")
        if self.trim is not None and not self.trim[0] < self.trim[1]:
            raise InputError(f"--trim {self.trim[0]:g}:{self.trim[1]:g}: the start must lie before the stop")

    @property
    def asked(self) -> ReadOptions:
        """What is said of how a file is read."""
        columns = [column for column, _ in self.wishes().values() if column not in (None, NONE)]
        return ReadOptions(
            self.table, self.encoding, tuple(part for item in columns for part in (item, *parted(item)))
        )

    def wishes(self) -> Wishes:
        """Column and unit that were said of each role."""
        return {role: (getattr(self, role), getattr(self, f"{role}_unit")) for role in ROLES}


@dataclass(frozen=True)
class Role:
    """A column found for a role."""

    column: RawColumn
    unit: Unit
    why: str
    """Why this column, and why in this unit."""

    @property
    def is_velocity(self) -> bool:
        """Whether the column holds the velocity of what is wanted."""
        return self.unit.quantity in SPEEDS.values()


def plain(text: str) -> str:
    """Small letters without accents."""
    text = text.casefold().replace("ü", "ue").replace("ä", "ae").replace("ö", "oe")
    return "".join(sign for sign in unicodedata.normalize("NFKD", text) if not unicodedata.combining(sign))


def _bare(text: str) -> str:
    """Letters and digits, as of a name with its unit in the header."""
    return re.sub(r"[\W_]+", "", plain(text))


def tokens(name: str) -> list[str]:
    """Words of a name, without digits."""
    parted = re.sub(r"(?<=[a-zà-ÿ])(?=[A-Z])", " ", name)
    return [token for token in re.split(r"[\W\d_]+", plain(parted)) if token]


def named_so(name: str, role: str) -> int:
    """How plainly a name says the role: 3 a word for it, 2 a word within a word, 1 a letter, 0 not at all, -1 another.

    Examples
    --------
    >>> named_so("Prüfkraft", "force"), named_so("actforce1", "force"), named_so("F", "force"), named_so("vel", "force")
    (3, 2, 1, -1)
    """
    parts, words = tokens(name), set(SAID[role].split())
    if _OTHERS & set(parts):
        return -1
    if words & {*parts, plain(name)}:
        return 3
    if any(word in part for part in parts for word in words if len(word) >= 4):
        return 2
    return 1 if parts and parts[0] in _WEAK[role].split() and len(parts) <= 2 else 0


def find_roles(
    table: RawTable,
    wishes: Wishes,
    wanted: Sequence[str] = ROLES,
    beside: Collection[int] = (),
    rate: float | None = None,
) -> dict[str, Role]:
    """Find the columns of time (unless there is none), position and force with their units.

    A column has a role by its name, else by its unit. Columns without name and unit take the roles that are then left in
    the order time, position, force, if there is one for each; without one for the time if the rate is known.

    Parameters
    ----------
    wishes : dict of str to tuple
        By role, the column (name or number) and the unit that the user gave, None if nothing; `NONE` as the column of
        time says that there is none.
    wanted : sequence of str
        Roles that are found.
    beside : collection of int
        Numbers of the columns that have no role.
    rate : float, optional
        Sampling rate that the user gave, Hz.

    Raises
    ------
    InputError
        With all that is missing, the candidates, and the option that gives each.
    """
    found: dict[str, tuple[RawColumn, str]] = {}
    problems: dict[str, str] = {}
    missing: list[str] = []
    taken: set[int] = set(beside)
    for role in wanted:
        wish, _ = wishes.get(role, (None, None))
        if role == "time" and wish == NONE:
            continue
        try:
            given = (
                wished(table.columns, wish, role)
                if wish
                else _by_name(_free(table, wishes, taken, role), role)
            )
            if given is None:
                missing.append(role)
                continue
            column = given[0]
            if column.number in taken:
                raise InputError(f"--{role}: {column.label} is taken already")
            taken.add(column.number)
            check_twice(column, wish, table, role)
            found[role] = given
        except InputError as error:
            problems[role] = str(error)
    without_time = ""  # why the rate of a table without a column of time is not known
    try:
        stated_time(0, rate, table.rates, table.source)
    except InputError as error:
        without_time = str(error).removeprefix(f"{table.source}: ")
    found |= _by_order(table, wishes, taken, missing, not without_time)
    for role in missing:
        if role in found:
            continue
        if role == "time":
            problems |= {role: without_time} if without_time else {}
        else:
            labels = ", ".join(column.label for column in _free(table, wishes, taken, role))
            problems[role] = (
                f"no column says that it is {role}; choose by --{role} NAME or NUMBER among {labels}, and give --{role}-unit "
                "if the file does not say it"
            )
    roles: dict[str, Role] = {}
    for role in (role for role in wanted if role in found):
        try:
            roles[role] = in_unit(found[role][0], role, wishes.get(role, (None, None))[1], found[role][1])
        except InputError as error:
            problems[role] = str(error)
    if problems:
        raise cannot_tell(table, [problems[role] for role in wanted if role in problems])
    return roles


def _free(table: RawTable, wishes: Wishes, taken: Collection[int], role: str) -> list[RawColumn]:
    """Columns that have no role yet and that the user gave no other one."""
    others = {other for name, (other, _) in wishes.items() if name != role and other}
    return [
        column
        for column in table.columns
        if column.number not in taken and not others & {column.name, str(column.number)}
    ]


def _by_order(
    table: RawTable, wishes: Wishes, taken: Collection[int], missing: Sequence[str], rate_is_known: bool
) -> dict[str, tuple[RawColumn, str]]:
    """Columns without name and unit by the roles that no name and no unit gave, in their order."""
    nameless = [column for column in _free(table, wishes, taken, "") if not column.name and not column.unit]
    open_roles = list(missing)
    if len(nameless) != len(open_roles) and rate_is_known:
        open_roles = [role for role in missing if role != "time"]
    if open_roles == ["time"] or len(nameless) != len(open_roles):
        return {}
    why = f"by its order: columns without names are {', '.join(open_roles)}"
    return {role: (column, why) for role, column in zip(open_roles, nameless, strict=True)}


def cannot_tell(table: RawTable, problems: Iterable[str]) -> InputError:
    """Error of what a table leaves open, with its columns."""
    told = "\n".join(f"  - {problem}" for problem in problems)
    return InputError(f"{table.source}: not everything can be told from the file\n{told}{table.described()}")


def wished(columns: Sequence[RawColumn], wish: str, option: str) -> tuple[RawColumn, str]:
    """Return the column that a person named, by its name, its name in other letters or its number, and these words.

    Raises
    ------
    InputError
        If there is none.
    """
    for found in (
        [column for column in columns if column.name == wish],
        [column for column in columns if column.name and plain(column.name) == plain(wish)],
        [column for column in columns if column.unit and _bare(column.name + column.unit) == _bare(wish)],
        [column for column in columns if str(column.number) == wish],
    ):
        if found:
            return found[0], f"as told by --{option}"
    labels = ", ".join(column.label for column in columns)
    raise InputError(f"--{option} {wish!r}: no such column; there are {labels}")


def check_twice(column: RawColumn, wish: str | None, table: RawTable, role: str) -> None:
    """Refuse a name that stands twice in the header, unless the column was told by its number."""
    twice = [other.number for other in table.columns if other.name == column.name]
    if column.name and len(twice) > 1 and wish != str(column.number):
        numbers = " and ".join(map(str, twice))
        raise InputError(
            f"{role} is {column.name!r}, which stands in columns {numbers}; choose by --{role} NUMBER"
        )


def ranked(free: Iterable[RawColumn], role: str) -> dict[tuple[int, bool], list[RawColumn]]:
    """Columns that may have a role, by how plainly a name says it (`named_so`) and whether the unit fits."""
    ranks: dict[tuple[int, bool], list[RawColumn]] = {}
    for column in free:
        unit, named = find_unit(column.unit), named_so(column.own_name, role)
        fits = unit is not None and unit.quantity in QUANTITIES[role]
        contradicts = unit is not None and not fits and unit.quantity != "reading"
        if named >= 0 and not contradicts and (named or fits):
            ranks.setdefault((named, fits), []).append(column)
    return ranks


def _by_name(free: list[RawColumn], role: str) -> tuple[RawColumn, str] | None:
    """Find a column by its name, else by its unit, else as the only velocity; None if no column says the role."""
    if ranks := ranked(free, role):
        (named, _), best = max(ranks.items())
        if len(best) > 1:
            labels = " or ".join(column.label for column in best)
            raise InputError(f"{role} may be {labels}; choose by --{role} NAME or NUMBER")
        return best[0], "by its name" if named else "by its unit"
    speeds = []
    for column in free if role == "position" else ():
        unit = find_unit(column.unit)
        if unit is None or unit.quantity == "reading":
            is_speed = not column.unit and named_velocity(column.own_name)
        else:
            is_speed = unit.quantity in SPEEDS.values() and not set(tokens(column.own_name)) & _UNMEASURED
        speeds += [column] if is_speed else []
    if len(speeds) > 1:
        labels = " or ".join(column.label for column in speeds)
        raise InputError(f"position may be {labels}, integrated; choose by --position NAME or NUMBER")
    return (speeds[0], "the only velocity where no column is position") if speeds else None


def named_velocity(name: str) -> bool:
    """Whether a name says that a velocity was measured, and no command or error of one."""
    parts = set(tokens(name))
    return bool(parts & {plain(word) for word in _VELOCITIES}) and not parts & _UNMEASURED


_SLOWEST_HZ = 20.0
"""A clock without a unit that is this fast or faster in seconds is in seconds: in milliseconds it would be 20 kHz."""

_PLAUSIBLE_HZ = (1.0, 1e5)
"""Rates that a file's own unit of time may lead to without being asked about: headers have said ms for seconds."""


def in_unit(column: RawColumn, role: str, told: str | None, why: str) -> Role:
    """Return a column as a role in the unit that was told, or that the file says.

    Raises
    ------
    InputError
        If there is none, or it is of something else.
    """
    if told:
        given = parse_unit(told, f"--{role}-unit")
        if given.quantity not in (*_TAKEN[role], *(["reading"] if role != "time" else [])):
            raise InputError(f"--{role}-unit {told!r} is a unit of {given.quantity}, not of {role}")
        stated = find_unit(column.unit)
        other = stated is not None and (stated.quantity, stated.factor) != (given.quantity, given.factor)
        against = f", where the file says {column.unit}" if other else ""
        return Role(column, given, f"{why}; unit {given.name}, as told by --{role}-unit{against}")
    unit = find_unit(column.unit)
    step = float(np.nanmedian(np.diff(column.values)))
    if unit is not None and unit.quantity in _TAKEN[role]:
        if (
            role == "time"
            and step > 0
            and not _PLAUSIBLE_HZ[0] <= 1 / (step * unit.factor) <= _PLAUSIBLE_HZ[1]
        ):
            raise InputError(
                f"time is {column.label}, whose steps of {step:g} {unit.name} are {1 / (step * unit.factor):g} Hz, which no "
                "testing machine records at; give --time-unit"
            )
        return Role(column, unit, f"{why}; unit {unit.name}, as the file says")
    if role == "time" and not column.unit and 0 < step <= 1 / _SLOWEST_HZ:
        unit = parse_unit("s", "--time-unit")
        return Role(column, unit, f"{why}; unit s, as its steps of {step:g} are too small for ms")
    example, calibration = {
        "time": ("ms", "0.5 ms"),
        "position": ("mm", "0.01 mm"),
        "force": ("N", "35.15 N"),
    }[role]
    if role == "position" and named_velocity(column.own_name):
        example, calibration = "mm/s", "0.01 mm/s"
    if unit is not None and unit.quantity == "reading":
        found = f"{column.label} is what the sensor gave, in {unit.name}"
        words = f"say what one of its numbers is, as in --{role}-unit '{calibration}', or --{role}-unit {unit.name}"
    else:
        unit_words = f"in {column.unit}, which is no unit of {role}" if column.unit else "without a unit"
        found = f"{role} is {column.label}, {why}, {unit_words}"
        words = f"give --{role}-unit, e.g. {example}"
    raise InputError(f"{found}; {words}")
