"""What a claim is, and the four verdicts that can be passed on it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lumbar.base.yaml_file import shipped_yaml

HOLDS = "holds"
DOES_NOT_HOLD = "does not hold"
BUILT_IN = "built into the data"
CANNOT_BE_TESTED = "cannot be tested on this data"
VERDICTS = (HOLDS, DOES_NOT_HOLD, BUILT_IN, CANNOT_BE_TESTED)

Results = dict[str, Any]
"""Tables (data frames) and JSON contents of a run by name, e.g. ``results["table_3_1"]``."""


@dataclass(frozen=True)
class Finding:
    """What a run shows about a claim."""

    value: str | float | None
    """This run's counterpart of the thesis's value."""
    agrees: bool | None
    """Whether the criterion is met; None where the data cannot tell."""
    remark: str = ""
    """Why the data cannot tell, or what else a reader should know."""


Judge = Callable[[Results], Finding]


@dataclass(frozen=True)
class Claim:
    """One quantitative or ordering claim."""

    id: str
    """Unique name."""
    location: str
    """Where the thesis makes it."""
    statement: str
    """The claim in one sentence."""
    thesis: str | float
    """The thesis's value."""
    criterion: str
    """When this run is said to agree."""
    needs: tuple[str, ...]
    """Names of the results it is judged on."""
    judge: Judge
    """From the results to a `Finding`."""
    built_into_twin: bool = False
    """Whether the synthetic twin was made to show it."""


def claims_of(part: str, judges: Mapping[str, Judge], **words) -> list[Claim]:
    """Claims of one part of ``claims.yaml``, in its order, with their judges; `words` stand for ``{…}`` in their texts."""
    said = shipped_yaml(Path(__file__).with_name("claims.yaml"))[part]
    return [
        Claim(
            id=name,
            statement=entry.pop("statement").format(**words),
            criterion=entry.pop("criterion").format(**words),
            needs=tuple(entry.pop("needs")),
            judge=judges[name],
            **entry,
        )
        for name, entry in said.items()
    ]


def verdict(claim: Claim, finding: Finding, synthetic: bool) -> str:
    """Return one of `VERDICTS`.

    A claim that synthetic data were made to show is never said to hold; it may still be found not to hold.
    """
    if finding.agrees is None:
        return CANNOT_BE_TESTED
    if not finding.agrees:
        return DOES_NOT_HOLD
    return BUILT_IN if synthetic and claim.built_into_twin else HOLDS


def examine(claim: Claim, results: Results) -> Finding:
    """Judge a claim, or say which results of this study are missing for it."""
    missing = [name for name in claim.needs if results.get(name) is None]
    if missing:
        return Finding(None, None, f"this study has no {', '.join(missing)}")
    return claim.judge(results)
