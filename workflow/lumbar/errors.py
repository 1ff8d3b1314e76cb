"""Errors that say where, what was found, what is allowed and what to do."""

from __future__ import annotations


class LumbarError(Exception):
    """An error whose message is written for the user: it is shown without a traceback."""


class InputError(LumbarError):
    """Configuration or data that cannot be used as they are."""


class NumericalError(LumbarError):
    """A computation that did not reach a result that may be published."""


class Problems:
    """Collects every problem of one input, so that a user mends them all at once.

    Examples
    --------
    >>> problems = Problems("trial.csv")
    >>> problems.add("line 4", "force_N is 'abc'", "a number is needed")
    >>> problems.raise_if_any()
    Traceback (most recent call last):
        ...
    lumbar.errors.InputError: trial.csv: 1 problem
      - line 4: force_N is 'abc'; a number is needed
    """

    def __init__(self, subject: str):
        self.subject = subject
        self.entries: list[str] = []

    def add(self, place: str, found: str, allowed: str = "") -> None:
        """Note one problem.

        Parameters
        ----------
        place : str
            File line, column or configuration key.
        found : str
            What stands there.
        allowed : str, optional
            What may stand there, or what to do about it.
        """
        text = f"{place}: {found}" if place else found
        self.entries.append(f"{text}; {allowed}" if allowed else text)

    def extend(self, other: Problems) -> None:
        """Take over the problems of another collection, naming its subject."""
        self.entries.extend(f"{other.subject}: {entry}" for entry in other.entries)

    def raise_if_any(self) -> None:
        """Raise one `InputError` that lists all problems, if there are any."""
        if self.entries:
            count = len(self.entries)
            lines = "\n".join(f"  - {entry}" for entry in self.entries)
            raise InputError(f"{self.subject}: {count} problem{'s' if count > 1 else ''}\n{lines}")
