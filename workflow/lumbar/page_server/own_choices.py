"""What a person chose on the page for own recordings, checked before anything is done with it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from lumbar.base.errors import InputError
from lumbar.base.files import is_device
from lumbar.records.importing.roles import Choices
from lumbar.settings.key import NAME

if TYPE_CHECKING:
    from lumbar.records.record import Record

_TEXTS = ("time", "position", "force", "time_unit", "position_unit", "force_unit", "table", "encoding")
_SWITCHES = ("flip_force", "accept_clipped")
LONGEST_TEXT = 200


def checked_choices(given: Any) -> dict[str, Any]:
    """Return what a page chose as arguments of `lumbar.import_recordings`.

    Raises
    ------
    InputError
        Naming the option as the command line does.
    """
    if not isinstance(given, Mapping):
        raise InputError("choices that are no mapping")
    chosen: dict[str, Any] = {}
    for name in _TEXTS:
        value = given.get(name)
        option = f"--{name.replace('_', '-')}"
        if value is None or value == "":
            continue
        if not isinstance(value, str) or len(value) > LONGEST_TEXT:
            raise InputError(f"{option}: words of up to {LONGEST_TEXT} characters are needed")
        chosen[name] = value
    for name in _SWITCHES:
        if given.get(name) is True:
            chosen[name] = True
    if given.get("rate") not in (None, ""):
        chosen["rate"] = _number(given["rate"], "--rate")
    if given.get("trim") not in (None, [], ["", ""], [None, None]):
        chosen["trim"] = _trim(given["trim"])
    Choices(rate=chosen.get("rate"), trim=chosen.get("trim"))
    return chosen


def _trim(given: Any) -> tuple[float, float]:
    if not isinstance(given, list | tuple) or len(given) != 2:
        raise InputError("--trim: a start and a stop in seconds are needed")
    start, stop = (
        default if value in (None, "") else _number(value, "--trim")
        for value, default in zip(given, (-math.inf, math.inf), strict=True)
    )
    return start, stop


def _number(value: Any, option: str) -> float:
    try:
        found = float(value) if isinstance(value, str | int | float) else math.nan
    except (ValueError, OverflowError):
        found = math.nan
    if math.isnan(found):
        raise InputError(f"{option}: {value!s:.40} is no number")
    return found


def checked_name(given: Any) -> str:
    """Return the name of a set, which names a folder."""
    if not isinstance(given, str) or len(given) > 60 or not re.fullmatch(NAME, given) or is_device(given):
        raise InputError(
            f"name {given!s:.60}: up to 60 letters, digits, _ and - are needed, and no device of Windows"
        )
    return given


def checked_training(given: Any, records: Sequence[Record]) -> list[str]:
    """Return the names of the records to fit on; the longest where none is named.

    Raises
    ------
    InputError
        If one is unknown, or none is left to test on.
    """
    names = [record.name for record in records]
    if not given:
        return [max(records, key=lambda record: record.duration).name]
    if not isinstance(given, list) or not all(name in names for name in given):
        raise InputError(f"training {given!s:.80}: the records are {', '.join(names)}")
    return [name for name in names if name in given]
