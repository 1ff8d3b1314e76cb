"""Errors with a message for the user: the place, the problem, what is allowed and what to do."""

from __future__ import annotations

import errno
import re
import shutil
import traceback
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path


class LumbarError(Exception):
    """An error with a message for the user, shown without a traceback."""


class InputError(LumbarError):
    """Configuration or data that cannot be used."""


class NumericalError(LumbarError):
    """A computation without a valid result.

    Parameters
    ----------
    message : str
        Message for the user.
    label : str, optional
        Name of the computation that failed, if there were several; empty if unknown.
    """

    def __init__(self, message: str, label: str = ""):
        super().__init__(message)
        self.label = label


def user_message(error: BaseException) -> str | None:
    """Return the message of an error for the user; None for a programming error, which needs its traceback.

    Parameters
    ----------
    error : BaseException
        A `LumbarError`; an `OSError`, reported with its path and, on a full disk, the free space; or an arithmetic error,
        reported with its place in the library.

    Examples
    --------
    >>> user_message(InputError("trial.csv: no such file"))
    'trial.csv: no such file'
    >>> user_message(KeyError("input")) is None
    True
    """
    if isinstance(error, LumbarError):
        return printable(str(error))
    if isinstance(error, OSError) and error.errno is not None:
        path = Path(str(error.filename)) if error.filename is not None else None
        text = f"{printable(str(path))}: {error.strerror}" if path else f"{error.strerror} (on {Path.cwd()})"
        if error.errno == errno.ENOTDIR:
            return f"{text}; a folder is needed there: name another place"
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            return text
        folder = next(item for item in (path or Path.cwd()).absolute().parents if item.is_dir())
        free = shutil.disk_usage(folder).free / 1e6
        return f"{text}; {free:.1f} MB are free in {folder}: make room, then run it again"
    is_out_of_range = isinstance(error, ArithmeticError) or type(error).__name__ == "LinAlgError"
    if isinstance(error, ValueError):  # SciPy's solvers reject numbers that are not finite
        is_out_of_range |= any(text in str(error) for text in ("infs or NaNs", "not finite"))
    if not is_out_of_range:
        return None
    last = traceback.extract_tb(error.__traceback__)
    package = Path(__file__).parents[1]
    place = next((item for item in reversed(last) if Path(item.filename).is_relative_to(package)), None)
    where = f" in {Path(place.filename).name}, line {place.lineno}" if place else ""
    return (
        f"numbers left the range that can be computed with{where} ({error}): look for values that are far too "
        "large or too small in the records and settings"
    )


def did_you_mean(word: object, known: Iterable[str]) -> str:
    """Return a question with the most similar known name; empty if none is similar.

    Examples
    --------
    >>> did_you_mean("frction", ["coulomb_friction", "hysteresis"])
    "; did you mean 'coulomb_friction'?"
    >>> did_you_mean("weight_kg", ["mass_kg", "height_m"])
    "; did you mean 'mass_kg'?"
    >>> did_you_mean("inertia", ["delay"])
    ''
    """
    names = list(known)
    # A word may be similar to one part of a long name only.
    spellings = {part.casefold(): name for name in names for part in name.split("_")}
    spellings |= {name.casefold(): name for name in names}
    spelled = str(word).casefold()
    close = get_close_matches(spelled.replace("weight", "mass"), spellings, 1, 0.65)  # a body's weight in kg
    close = close or get_close_matches(spelled, spellings, 1, 0.65)
    return f"; did you mean {spellings[close[0]]!r}?" if close else ""


_CONTROL_CHARACTERS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
"""Characters that control a terminal, change the direction of text, or cannot be encoded."""


def printable(text: str) -> str:
    """Return a text with ``?`` instead of control characters, which an untrusted file may contain.

    Examples
    --------
    >>> printable("no column '\x1b[2Jforce'")
    "no column '?[2Jforce'"
    """
    return _CONTROL_CHARACTERS.sub("?", text)


MAX_PROBLEMS = 20
"""Largest number of problems of one file in a message."""


class Problems:
    """Collection of all problems of one input, so that a user can fix them together.

    Examples
    --------
    >>> problems = Problems("trial.csv")
    >>> problems.add("line 4", "force_N is 'abc'", "a number is needed")
    >>> problems.raise_if_any()
    Traceback (most recent call last):
        ...
    lumbar.base.errors.InputError: trial.csv: 1 problem
      - line 4: force_N is 'abc'; a number is needed

    Parameters
    ----------
    subject : str
        File or setting with the problems.
    most : int, optional
        Number of problems at which an error is raised immediately: a file of another kind has a problem in every line.
    """

    def __init__(self, subject: str, most: int | None = None):
        self.subject = subject
        self.most = most
        self.entries: list[str] = []

    def add(self, place: str, problem: str, allowed: str = "") -> None:
        """Add one problem.

        `place` is a line of a file, a column or a configuration key, `problem` the wrong value; `allowed` are the allowed
        values, or the remedy.
        """
        text = f"{place}: {problem}" if place else problem
        self.entries.append(f"{text}; {allowed}" if allowed else text)
        if len(self.entries) == self.most:
            self.entries.append(f"reading stopped after {self.most} problems")
            self.raise_if_any()

    def extend(self, other: Problems) -> None:
        """Add the problems of `other`, each with the subject of `other`."""
        for entry in other.entries:
            self.add(other.subject, entry)

    def raise_if_any(self) -> None:
        """Raise one `InputError` that lists all problems, if there are any."""
        if self.entries:
            count = len(self.entries)
            lines = "\n".join(f"  - {entry}" for entry in self.entries)
            raise InputError(f"{self.subject}: {count} problem{'s' if count > 1 else ''}\n{lines}")
