"""Columns of time, position and force: by the user's options, by names in several languages, by units and by order."""

import re
import unicodedata
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError
from lumbar.base.yaml_file import shipped_yaml
from lumbar.records.importing.clock import stated_time
from lumbar.records.importing.raw_table import SPEEDS, RawColumn, RawTable, Unit, find_unit, parse_unit
from lumbar.records.number_table import ENCODINGS

ROLES = ("time", "position", "force")
NONE = "none"
"""Value of the option for a table without a column of time."""
QUANTITIES = {"time": ("time",), "position": ("length", "angle"), "force": ("force", "torque")}
_ALLOWED_QUANTITIES = {**QUANTITIES, "position": (*QUANTITIES["position"], *SPEEDS.values())}
"""Allowed quantities of a role's column; a velocity is integrated."""
ROLE_WORDS: dict[str, str] = shipped_yaml(Path(__file__).with_suffix(".yaml"))
_VELOCITIES, _UNMEASURED = ROLE_WORDS["velocity"].split(), frozenset(ROLE_WORDS["unmeasured"].split())
_ONE_LETTER_NAMES = {"time": "t", "position": "x y z", "force": "f fx fy fz"}
"""Names of one letter, which are used for other quantities too."""
_OTHER_NAMES = frozenset([*_VELOCITIES, *_UNMEASURED, *ROLE_WORDS["others"].split()])
"""Names of other quantities and commands; columns with such names are only used if the user names them."""
_MIN_FILLED = 0.5
"""Smallest share of rows with a number in a column that is preferred: a heading may name a maximum."""
_MIN_SECONDS_HZ = 20.0
"""Smallest rate at which a clock without a unit is in seconds: in milliseconds the rate would be 20 kHz or more."""
_PLAUSIBLE_HZ = (1.0, 1e5)
"""Range of rates for which the stated unit of time is accepted: some headers state ms for seconds."""

Requests = dict[str, tuple[str | None, str | None]]
"""The user's column and unit for each role; None if not given."""


def split_columns(option: str | None) -> list[str]:
    """Return the columns in an option that names one column per axis, separated by commas; empty for a single column.

    Parameters
    ----------
    option : str or None
        Text that the user gave for a role.
    """
    parts = re.split(r",(?![^(]*\))", option or "")  # no comma of a channel such as data(2,:)
    return [part.strip() for part in parts] if len(parts) > 1 else []


@dataclass(frozen=True)
class Choices:
    """The user's options for an import, see `lumbar.import_recordings`; None means automatic detection."""

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
    load_drives: bool = False

    def __post_init__(self):
        if bool(self.cut) + (self.cut_by is not None) + (self.trim is not None) > 1:
            raise InputError("give one of --cut, --cut-by and --trim")
        if self.rate is not None and not 0 < self.rate < np.inf:
            raise InputError(f"--rate {self.rate:g}: a positive number of hertz is needed")
        if self.trim is not None and not self.trim[0] < self.trim[1]:
            raise InputError(f"--trim {self.trim[0]:g}:{self.trim[1]:g}: the start must lie before the stop")
        try:
            "a".encode(self.encoding or "utf-8")
        except (LookupError, ValueError) as error:
            raise InputError(
                f"--encoding {self.encoding!r}: no encoding of text in Python, such as {ENCODINGS}"
            ) from error

    @property
    def named_columns(self) -> list[str]:
        """Columns that the user gave for roles."""
        columns = [column for column, _ in self.requests.values() if column not in (None, NONE)]
        return [part for column in columns for part in (column, *split_columns(column))]

    @property
    def requests(self) -> Requests:
        """Column and unit of each role."""
        return {role: (getattr(self, role), getattr(self, f"{role}_unit")) for role in ROLES}


@dataclass(frozen=True)
class Role:
    """The column of a role."""

    column: RawColumn
    unit: Unit
    reason: str
    """Reasons for the column and its unit."""


def _normalize(text: str) -> str:
    """Return a text in lower case without accents; of channels of a matrix, ``data(2,:)`` is ``data(:,2)``."""
    text = re.sub(r"\((\d+),:\)$", r"(:,\1)", text)
    text = text.casefold().replace("ü", "ue").replace("ä", "ae").replace("ö", "oe")
    return "".join(sign for sign in unicodedata.normalize("NFKD", text) if not unicodedata.combining(sign))


def split_words(name: str) -> list[str]:
    """Return the words of a name, normalized and without digits.

    Parameters
    ----------
    name : str
        Name of a column.
    """
    spaced = re.sub(r"(?<=[a-zà-ÿ])(?=[A-Z])", " ", name)
    return [word for word in re.split(r"[\W\d_]+", _normalize(spaced)) if word]


def name_match_score(name: str, role: str) -> int:
    """Return the score of a name for a role: 3 whole word, 2 part of a word, 1 letter, 0 no match, -1 another quantity.

    Parameters
    ----------
    name : str
        Name of a column.
    role : str
        Key of `ROLE_WORDS`, e.g. ``"force"``.

    Examples
    --------
    >>> [name_match_score(name, "force") for name in ("Prüfkraft", "actforce1", "F", "vel")]
    [3, 2, 1, -1]
    """
    parts, words = split_words(name), set(ROLE_WORDS[role].split())
    if _OTHER_NAMES & set(parts):
        return -1
    if words & {*parts, _normalize(name)}:
        return 3
    if any(word in part for part in parts for word in words if len(word) >= 4):
        return 2
    return 1 if parts and parts[0] in _ONE_LETTER_NAMES[role].split() and len(parts) <= 2 else 0


def find_roles(
    table: RawTable,
    requests: Requests,
    wanted: Sequence[str] = ROLES,
    excluded: Collection[int] = (),
    rate: float | None = None,
) -> dict[str, Role]:
    """Find the columns of time (optional), position and force with their units.

    A column has a role by its name, else by its unit. Columns without name and unit get the remaining roles in the order
    time, position, force, if there are as many columns as roles; time needs no column if the rate is known.

    Parameters
    ----------
    table : RawTable
        The columns.
    requests : dict of str to tuple
        The user's column (name or number) and unit for each role, None if not given; `NONE` means a table
        without a column of time.
    wanted : sequence of str
        Roles to find.
    excluded : collection of int
        Numbers of the columns that must not get a role.
    rate : float, optional
        The user's sampling rate, Hz.

    Raises
    ------
    InputError
        If a column or unit is missing, with the candidates and the options that choose among them.
    """
    chosen: dict[str, tuple[RawColumn, str] | None] = {}
    problems: dict[str, str] = {}
    used = set(excluded)
    for role in wanted:
        if role == "time" and requests[role][0] == NONE:
            continue
        try:
            chosen[role] = _choose_column(table, requests, used, role)
        except InputError as error:
            problems[role] = str(error)
    missing = [role for role, choice in chosen.items() if choice is None]
    chosen |= _choose_by_order(table, _free_columns(table, requests, used), missing, rate)
    roles: dict[str, Role] = {}
    for role, choice in chosen.items():
        try:
            if choice is not None:
                roles[role] = assign_unit(choice[0], role, requests[role][1], choice[1])
            elif role != "time":
                labels = ", ".join(column.label for column in _free_columns(table, requests, used, role))
                raise InputError(
                    f"no column says that it is {role}; choose by --{role} NAME or NUMBER among {labels}, and give "
                    f"--{role}-unit if the file does not say it"
                )
            else:
                stated_time(0, rate, table.rates, table.source)  # raises if the rate is unknown
        except InputError as error:
            problems[role] = str(error).removeprefix(f"{table.source}: ")
    if problems:
        raise ambiguity_error(table, [problems[role] for role in wanted if role in problems])
    return roles


def _choose_column(
    table: RawTable, requests: Requests, used: set[int], role: str
) -> tuple[RawColumn, str] | None:
    """Return a role's column, by the user's option or the column's name, and the reason; None without candidates."""
    request, _ = requests[role]
    choice: tuple[RawColumn, str] | None
    if request:
        choice = select_column(table.columns, request, role)
    else:
        choice = _find_by_name(_free_columns(table, requests, used, role), role)
    if choice is None:
        return None
    column, _ = choice
    if column.number in used:
        raise InputError(f"--{role}: {column.label} already has a role")
    used.add(column.number)
    require_unique_name(column, request, table, role)
    return choice


def _choose_by_order(
    table: RawTable, columns: list[RawColumn], missing: list[str], rate: float | None
) -> dict[str, tuple[RawColumn, str]]:
    """Return columns without name and unit for the missing roles in order, if there are as many columns as roles."""
    nameless = [column for column in columns if not column.name and not column.unit]
    if len(nameless) != len(missing):
        with suppress(InputError):
            stated_time(0, rate, table.rates, table.source)
            missing = [role for role in missing if role != "time"]  # the rate is known
    if missing == ["time"] or len(nameless) != len(missing):
        return {}
    reason = f"by its order: columns without names are {', '.join(missing)}"
    return {role: (column, reason) for role, column in zip(missing, nameless, strict=True)}


def _free_columns(
    table: RawTable, requests: Requests, used: Collection[int], role: str = ""
) -> list[RawColumn]:
    """Return the columns that have no role yet and that the user did not name for another role."""
    others = {request for name, (request, _) in requests.items() if name != role and request}
    return [
        column
        for column in table.columns
        if column.number not in used and not others & {column.name, str(column.number)}
    ]


def refuse_spectrum(table: RawTable) -> None:
    """Raise if the table is over frequency: a frequency with storage or loss moduli.

    Parameters
    ----------
    table : RawTable
        Table of the file.

    Raises
    ------
    InputError
        If it is; the message names both columns.
    """

    def find(kind: str) -> RawColumn | None:
        words = set(ROLE_WORDS[kind].split())
        signs = str.maketrans({"′": "'", "″": "''", "’": "'", "`": "'"})
        for column in table.columns:
            name = _normalize(column.name.translate(signs))
            if words & {*split_words(name), *re.findall(r"[\w'*]+", name)}:
                return column
        return None

    frequency, modulus = find("frequency"), find("spectrum")
    if frequency is not None and modulus is not None:
        raise InputError(
            f"{table.source}: {frequency.label} and {modulus.label} are a spectrum, not a recording over time; import a "
            "recording of the test, or name its columns by --time, --position and --force"
        )


def ambiguity_error(table: RawTable, problems: Iterable[str]) -> InputError:
    """Return the error of unclear columns and units, with all columns of the table.

    Parameters
    ----------
    table : RawTable
        Table of the file.
    problems : iterable of str
        Problem of each role.
    """
    listed = "\n".join(f"  - {problem}" for problem in problems)
    return InputError(f"{table.source}: some columns or units are unclear\n{listed}{table.describe()}")


def select_column(columns: Sequence[RawColumn], request: str, option: str) -> tuple[RawColumn, str]:
    """Return the column that the user named, and the text of this reason.

    Parameters
    ----------
    columns : sequence of RawColumn
        Columns to choose from.
    request : str
        Name of the column, its normalized name or its number.
    option : str
        Option that the user gave, for messages.

    Raises
    ------
    InputError
        If the column does not exist.
    """

    def letters(text: str) -> str:
        return re.sub(r"[\W_]+", "", _normalize(text))

    for matches in (
        [column for column in columns if column.name == request],
        [column for column in columns if column.name and _normalize(column.name) == _normalize(request)],
        [
            column
            for column in columns
            if column.unit and letters(column.name + column.unit) == letters(request)
        ],
        [column for column in columns if str(column.number) == request],
    ):
        if matches:
            return matches[0], f"as given by --{option}"
    labels = ", ".join(column.label for column in columns)
    raise InputError(f"--{option} {request!r}: no such column; there are {labels}")


def require_unique_name(column: RawColumn, request: str | None, table: RawTable, role: str) -> None:
    """Raise if the header contains a column's name several times.

    Parameters
    ----------
    column : RawColumn
        Chosen column.
    request : str or None
        Text that the user gave for the role; the number of the column is always allowed.
    table : RawTable
        Table of the file.
    role : str
        Role of the column, for the message.

    Raises
    ------
    InputError
        If it does, with the numbers of these columns.
    """
    numbers = [str(other.number) for other in table.columns if other.name == column.name]
    if column.name and len(numbers) > 1 and request != str(column.number):
        listed = " and ".join(numbers)
        raise InputError(
            f"{role} is {column.name!r}, the name of columns {listed}; choose by --{role} NUMBER"
        )


def rank_columns(columns: Iterable[RawColumn], role: str) -> dict[tuple[int, bool], list[RawColumn]]:
    """Return the candidates for a role by the score of their names (`name_match_score`) and whether the unit fits.

    Parameters
    ----------
    columns : iterable of RawColumn
        Columns to choose from.
    role : str
        ``"time"``, ``"position"`` or ``"force"``.
    """
    ranks: dict[tuple[int, bool], list[RawColumn]] = {}
    for column in columns:
        unit, score = find_unit(column.unit), name_match_score(column.name_in_group, role)
        fits = unit is not None and unit.quantity in QUANTITIES[role]
        contradicts = unit is not None and not fits and unit.quantity != "reading"
        if score >= 0 and not contradicts and (score or fits):
            ranks.setdefault((score, fits), []).append(column)
    return ranks


def _find_by_name(columns: list[RawColumn], role: str) -> tuple[RawColumn, str] | None:
    """Find a column by its name, else by its unit, else as the only velocity; None without candidates."""
    filled = [column for column in columns if np.isfinite(column.values).mean() >= _MIN_FILLED]
    if ranks := rank_columns(filled, role) or rank_columns(columns, role):
        (score, _), best = max(ranks.items())
        if len(best) > 1:
            labels = " or ".join(column.label for column in best)
            raise InputError(f"{role} may be {labels}; choose by --{role} NAME or NUMBER")
        return best[0], "by its name" if score else "by its unit"
    speeds = []
    for column in columns if role == "position" else ():
        unit = find_unit(column.unit)
        if unit is None or unit.quantity == "reading":
            is_speed = not column.unit and is_velocity_name(column.name_in_group)
        else:
            is_commanded = set(split_words(column.name_in_group)) & _UNMEASURED
            is_speed = unit.quantity in SPEEDS.values() and not is_commanded
        speeds += [column] if is_speed else []
    if len(speeds) > 1:
        labels = " or ".join(column.label for column in speeds)
        raise InputError(f"position may be {labels}, integrated; choose by --position NAME or NUMBER")
    return (speeds[0], "the only velocity, as no column is position") if speeds else None


def is_velocity_name(name: str) -> bool:
    """Return whether a name means a measured velocity, and not a command or an error.

    Parameters
    ----------
    name : str
        Name of a column.
    """
    parts = set(split_words(name))
    return bool(parts & {_normalize(word) for word in _VELOCITIES}) and not parts & _UNMEASURED


def assign_unit(column: RawColumn, role: str, option: str | None, reason: str) -> Role:
    """Return a role with its column, in the unit that the user gave or that the file states.

    Parameters
    ----------
    column : RawColumn
        The column.
    role : str
        Role of the column, one of `ROLES`.
    option : str or None
        The user's unit.
    reason : str
        Why the column has the role.

    Raises
    ------
    InputError
        If the unit is unknown, or a unit of another quantity.
    """
    unit = find_unit(column.unit)
    if option:
        given = parse_unit(option, f"--{role}-unit")
        if given.quantity not in (*_ALLOWED_QUANTITIES[role], *(["reading"] if role != "time" else [])):
            raise InputError(f"--{role}-unit {option!r} is a unit of {given.quantity}, not of {role}")
        differs = unit is not None and (unit.quantity, unit.factor) != (given.quantity, given.factor)
        stated = f", while the file states {column.unit}" if differs else ""
        return Role(column, given, f"{reason}; unit {given.name}, as given by --{role}-unit{stated}")
    steps = np.diff(column.values[np.isfinite(column.values)])
    step = float(np.median(steps)) if steps.size else 0.0
    if unit is not None and unit.quantity in _ALLOWED_QUANTITIES[role]:
        rate = 1 / (step * unit.factor) if role == "time" and step > 0 else None
        if rate is not None and not _PLAUSIBLE_HZ[0] <= rate <= _PLAUSIBLE_HZ[1]:
            raise InputError(
                f"time is {column.label}, whose steps of {step:g} {unit.name} are {rate:g} Hz, which no testing machine "
                "records at; give --time-unit"
            )
        return Role(column, unit, f"{reason}; unit {unit.name}, as the file says")
    if role == "time" and not column.unit and 0 < step <= 1 / _MIN_SECONDS_HZ:
        unit = parse_unit("s", "--time-unit")
        return Role(column, unit, f"{reason}; unit s, as its steps of {step:g} are too small for ms")
    example, calibration = {
        "time": ("ms", "0.5 ms"),
        "position": ("mm", "0.01 mm"),
        "force": ("N", "35.15 N"),
    }[role]
    if role == "position" and is_velocity_name(column.name_in_group):
        example, calibration = "mm/s", "0.01 mm/s"
    if unit is not None and unit.quantity == "reading":
        raise InputError(
            f"{column.label} is a sensor's reading in {unit.name}; give the size of one unit, as in --{role}-unit "
            f"'{calibration}', or --{role}-unit {unit.name}"
        )
    problem = f"in {column.unit}, which is not a unit of {role}" if column.unit else "without a unit"
    raise InputError(f"{role} is {column.label}, {reason}, {problem}; give --{role}-unit, e.g. {example}")
