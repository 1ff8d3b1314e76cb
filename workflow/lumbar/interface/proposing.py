"""``lumbar.propose``: a short formula for what no effect of the catalogue explains."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.errors import InputError
from lumbar.records.record import Record
from lumbar.settings.improvement import ImprovementSettings
from lumbar.settings.seed import SEED

if TYPE_CHECKING:
    from lumbar.diagnosis.law.proposal import Proposal
    from lumbar.interface.diagnosis import Diagnosis

_FORWARD = "records with the force as input (improvement.forward): no law is looked for in them"


def propose(
    records: Sequence[Record],
    *,
    base: str | None = None,
    train: str | Sequence[str] | None = None,
    periods: Mapping[str, float] | None = None,
    settings: ImprovementSettings | None = None,
    forward: bool | None = None,
    seed: int = SEED,
    data: str = "",
) -> ProposedLaw:
    """Diagnose, and look for a short formula for what the catalogue leaves; parameters as of `lumbar.diagnose`.

    Returns
    -------
    ProposedLaw

    Examples
    --------
    >>> import lumbar
    >>> law = lumbar.propose(lumbar.read("recordings/tissue"))  # doctest: +SKIP
    >>> law.save("proposed_law.yaml")                           # doctest: +SKIP
    """
    from lumbar.interface.diagnosis import diagnose

    if (settings or ImprovementSettings()).forward if forward is None else forward:
        raise InputError(_FORWARD)
    chosen = {"base": base, "train": train, "periods": periods, "settings": settings, "forward": forward}
    return proposed(diagnose(records, **chosen, seed=seed, data=data))


def proposed(diagnosis: Diagnosis) -> ProposedLaw:
    """Look for a law for what a diagnosis leaves.

    Raises
    ------
    InputError
        For a pendulum: the library of terms is that of tissue. For records with the force as input.
    """
    from lumbar.diagnosis.law.proposal import propose as search

    if diagnosis.settings.system != "tissue":
        raise InputError(
            f"base {diagnosis.settings.base}: laws are proposed for tissue; a person's moment is no passive force"
        )
    if diagnosis.settings.forward:
        raise InputError(
            "records with the force as input (improvement.forward): no law is looked for in them"
        )
    verdict = diagnosis.verdict
    return ProposedLaw(
        diagnosis, diagnosis.proposal or search(verdict.experiment, verdict.base, verdict.model)
    )


@dataclass(frozen=True, eq=False, repr=False)
class ProposedLaw:
    """A law for what is missing, or that no short formula was found.

    Attributes
    ----------
    diagnosis : Diagnosis
        What it was looked for in.
    proposal : Proposal
    """

    diagnosis: Diagnosis
    proposal: Proposal

    @property
    def found(self) -> bool:
        """Whether a law is proposed."""
        return self.proposal.law is not None

    @property
    def equation(self) -> str:
        """The law as an expression; empty where none is proposed."""
        from lumbar.diagnosis.law.effect_file import form_found

        return form_found(self.proposal).equation if self.found else ""

    def to_yaml(self, name: str = "proposed_law") -> str:
        """Return the effect's file.

        Raises
        ------
        InputError
            If no law is proposed, or the name cannot be an effect's.
        """
        from lumbar.diagnosis.law.effect_file import effect_text
        from lumbar.effects.own_effect import check_name

        if not self.found:
            raise InputError(f"no effect to write: {self.sentences[0]}")
        check_name(name, self.diagnosis.candidates)
        return effect_text(self.proposal, name, self.diagnosis.data)

    def save(self, path: str | os.PathLike, name: str = "proposed_law") -> None:
        """Write the effect's file, for ``improvement: effect_files``; errors as of `to_yaml`."""
        from lumbar.files import write_text

        write_text(path, self.to_yaml(name))

    def draw(self, stem: str | os.PathLike) -> None:
        """Write the picture of what is missing, ``stem.svg`` and ``stem.pdf``.

        Raises
        ------
        InputError
            If nothing is missing.
        """
        from lumbar.reports.figures.law_figure import law_figure
        from lumbar.reports.figures.style import save

        if not self.proposal.is_needed:
            raise InputError(f"nothing to draw: {self.sentences[0]}")
        save(law_figure(self.proposal), Path(stem), self.diagnosis.data)

    @property
    def sentences(self) -> list[str]:
        """The proposal, in plain English."""
        from lumbar.diagnosis.law.effect_file import sentences

        return sentences(self.proposal)

    def __str__(self) -> str:
        return "\n  ".join(self.sentences)

    def __repr__(self) -> str:
        return f"<ProposedLaw: {self.equation or 'no formula'}>"
