"""``lumbar.propose``: a short formula for what no effect of the catalogue explains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from lumbar.base.errors import InputError
from lumbar.interface.diagnosis import FORWARD, diagnose
from lumbar.interface.proposed_law import ProposedLaw
from lumbar.records.record import Record
from lumbar.settings.improvement import ImprovementSettings
from lumbar.settings.seed import SEED


def propose(
    records: Sequence[Record],
    *,
    base: str | None = None,
    train: str | Sequence[str] | None = None,
    periods: Mapping[str, float] | None = None,
    session: bool | None = None,
    settings: ImprovementSettings | None = None,
    forward: bool | None = None,
    seed: int = SEED,
    data: str = "",
) -> ProposedLaw:
    """Diagnose, and look for a short formula for what the catalogue leaves; parameters as of `lumbar.diagnose`.

    Raises
    ------
    InputError
        For records with the force as input.

    Examples
    --------
    >>> import lumbar
    >>> law = lumbar.propose(lumbar.read("recordings/tissue"))  # doctest: +SKIP
    >>> law.save("proposed_law.yaml")                           # doctest: +SKIP
    """
    if (settings or ImprovementSettings()).forward if forward is None else forward:
        raise InputError(FORWARD)
    found = diagnose(
        records,
        base=base,
        train=train,
        periods=periods,
        session=session,
        settings=settings,
        seed=seed,
        data=data,
    )
    return found.propose()
