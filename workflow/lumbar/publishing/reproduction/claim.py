"""A claim of the thesis, its outcome in a run, and the five verdicts."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from lumbar.base.errors import LumbarError

HOLDS = "holds"
DOES_NOT_HOLD = "does not hold"
BY_DEFINITION = "true by definition"
"""Verdict of a claim that no data can contradict; it is not evidence."""
BUILT_IN = "built into the data"
CANNOT_BE_TESTED = "cannot be tested on this data"

Results = dict[str, Any]
"""Tables (data frames) and JSON contents of a run by name, e.g. ``results["table_3_1"]``."""


class UntestableError(LumbarError):
    """A claim that a run's results cannot decide; the message is the reason."""


@dataclass(frozen=True)
class Outcome:
    """Result of a run for a claim."""

    value: str | float | None
    """Value of this run for comparison with the thesis's value."""
    agrees: bool | None
    """True if the criterion is met; None if a value exists but cannot be judged."""
    remark: str = ""
    """Further information, or the reason for an `agrees` of None."""
    by_definition: bool = False
    """True if `agrees` follows from definitions or algebra, whatever the data."""


@dataclass(frozen=True)
class Claim:
    """One quantitative or ordering claim."""

    id: str
    """Unique name."""
    location: str
    """Section or table of the thesis."""
    statement: str
    """Text of the claim in one sentence."""
    thesis: str | float
    """Value in the thesis."""
    criterion: str
    """Condition under which a run agrees."""
    needs: tuple[str, ...]
    """Names of the results that decide on the claim."""
    judge: Callable[[Results], Outcome]
    """Function that judges a run; it raises `UntestableError` if the results have no value."""
    on_twin: str = ""
    """Verdict on the synthetic twin: `BUILT_IN` if the twin was made to meet it, `CANNOT_BE_TESTED` if it needs real lifters."""
