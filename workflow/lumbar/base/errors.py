"""Errors that say where, what was found, what is allowed and what to do."""

from __future__ import annotations

import errno
import re
import shutil
import traceback
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path


class LumbarError(Exception):
    """An error whose message is written for the user: it is shown without a traceback."""


class InputError(LumbarError):
    """Configuration or data that cannot be used as they are."""


class NumericalError(LumbarError):
    """A computation that did not reach a result that may be published.

    Parameters
    ----------
    message : str
        What went wrong, in words for the user.
    label : str, optional
        Which of several things computed together failed; empty where this is not known.
    """

    def __init__(self, message: str, label: str = ""):
        super().__init__(message)
        self.label = label


def user_message(error: BaseException) -> str | None:
    """Return what went wrong in words for the user; None for a programming error, whose traceback is needed.

    Parameters
    ----------
    error : BaseException
        A `LumbarError`; an `OSError`, told with its path and, where no space is left, with the space that is free; or
        arithmetic that left the range of numbers, told with the place in the library.

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
        return _system_error(error)
    is_out_of_range = isinstance(error, ArithmeticError) or type(error).__name__ == "LinAlgError"
    if isinstance(error, ValueError):  # SciPy's solvers refuse what is not finite
        is_out_of_range |= any(words in str(error) for words in ("infs or NaNs", "not finite"))
    if is_out_of_range:
        last = traceback.extract_tb(error.__traceback__)
        place = next((item for item in reversed(last) if "lumbar" in Path(item.filename).parts), None)
        where = f" in {Path(place.filename).name}, line {place.lineno}" if place else ""
        return (
            f"numbers left the range that can be computed with{where} ({error}): look for values that are far too "
            "large or too small in the records and settings"
        )
    return None


def did_you_mean(word: object, known: Iterable[str]) -> str:
    """Return a question after the known name that is most like a word; empty where none is.

    Examples
    --------
    >>> did_you_mean("frction", ["coulomb_friction", "hysteresis"])
    "; did you mean 'coulomb_friction'?"
    >>> did_you_mean("inertia", ["delay"])
    ''
    """
    names = list(known)
    # A part of a long name is less like the whole than like the word that is meant.
    alike = {part.casefold(): name for name in names for part in name.split("_")}
    alike |= {name.casefold(): name for name in names}
    close = get_close_matches(str(word).casefold(), alike, 1, 0.65)
    return f"; did you mean {alike[close[0]]!r}?" if close else ""


_COMMANDS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
"""Signs that command a terminal, turn the direction of what is read, or are no text."""


def printable(text: str) -> str:
    """Return a text with ``?`` for what only a file from elsewhere would hold, to do more than to be read.

    Examples
    --------
    >>> printable("no column '\x1b[2Jforce'")
    "no column '?[2Jforce'"
    """
    return _COMMANDS.sub("?", text)


_NO_SPACE = (errno.ENOSPC, errno.EDQUOT)


def _system_error(error: OSError) -> str:
    path = Path(str(error.filename)) if error.filename is not None else None
    text = f"{printable(str(path))}: {error.strerror}" if path else f"{error.strerror} (on {Path.cwd()})"
    if error.errno == errno.ENOTDIR:
        return f"{text}; a folder is needed there: name another place"
    if error.errno not in _NO_SPACE:
        return text
    folder = next(item for item in (path or Path.cwd()).absolute().parents if item.is_dir())
    free = shutil.disk_usage(folder).free / 1e6
    return f"{text}; {free:.1f} MB are free in {folder}: make room, then run it again"


MAX_PROBLEMS = 20
"""Problems of one file that a message lists."""


class Problems:
    """Collect every problem of one input, so that a user can fix them together.

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
        File or setting that the problems are in.
    most : int, optional
        Number of problems at which they are raised: a file of another kind has one in every line.
    """

    def __init__(self, subject: str, most: int | None = None):
        self.subject = subject
        self.most = most
        self.entries: list[str] = []

    def add(self, place: str, found: str, allowed: str = "") -> None:
        """Add one problem.

        Parameters
        ----------
        place : str
            File line, column or configuration key.
        found : str
            Value that is wrong.
        allowed : str, optional
            Values that are allowed, or what to do about it.
        """
        text = f"{place}: {found}" if place else found
        self.entries.append(f"{text}; {allowed}" if allowed else text)
        if len(self.entries) == self.most:
            self.entries.append(f"reading stopped after {self.most} problems")
            self.raise_if_any()

    def extend(self, other: Problems) -> None:
        """Add the problems of another collection, with its subject."""
        for entry in other.entries:
            self.add(other.subject, entry)

    def raise_if_any(self) -> None:
        """Raise one `InputError` that lists all problems, if there are any."""
        if self.entries:
            count = len(self.entries)
            lines = "\n".join(f"  - {entry}" for entry in self.entries)
            raise InputError(f"{self.subject}: {count} problem{'s' if count > 1 else ''}\n{lines}")
