"""What `lumbar.propose` gives: a short formula for what is missing, with its file and its picture."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.base.errors import InputError

if TYPE_CHECKING:
    from lumbar.tissue.diagnosis.law.proposal import Proposal
    from lumbar.tissue.models.form import Effect


@dataclass(frozen=True, eq=False, repr=False)
class ProposedLaw:
    """A law for what is missing, or that no short formula was found."""

    proposal: Proposal
    candidates: dict[str, Effect]
    """The catalogue that did not suffice, whose names the law cannot take."""
    data: str
    """What the records are, for the file and the picture."""

    @property
    def found(self) -> bool:
        """Whether a law is proposed."""
        return self.proposal.law is not None

    @property
    def equation(self) -> str:
        """The law as an expression; empty where none is proposed."""
        from lumbar.tissue.diagnosis.law.proposal import form_found

        return form_found(self.proposal).equation if self.found else ""

    def to_yaml(self, name: str = "proposed_law") -> str:
        """Return the effect's file.

        Raises
        ------
        InputError
            If no law is proposed, or the name cannot be an effect's.
        """
        from lumbar.tissue.diagnosis.law.proposal import effect_text
        from lumbar.tissue.effects.notation import check_name

        if not self.found:
            raise InputError(f"no effect to write: {self.sentences[0]}")
        check_name(name, self.candidates)
        return effect_text(self.proposal, name, self.data)

    def save(self, path: str | os.PathLike, name: str = "proposed_law") -> None:
        """Write the effect's file, for ``improvement: effect_files``; errors as of `to_yaml`."""
        from lumbar.base.files import write_text

        write_text(path, self.to_yaml(name))

    def draw(self, stem: str | os.PathLike) -> None:
        """Write the picture of what is missing, ``stem.svg`` and ``stem.pdf``.

        Raises
        ------
        InputError
            If nothing is missing.
        """
        from lumbar.publishing.figures.law_figure import law_figure
        from lumbar.publishing.figures.style import save

        if not self.proposal.is_needed:
            raise InputError(f"nothing to draw: {self.sentences[0]}")
        save(law_figure(self.proposal), Path(stem), self.data)

    @property
    def sentences(self) -> list[str]:
        """The proposal, in plain English."""
        from lumbar.tissue.diagnosis.law.proposal import sentences

        return sentences(self.proposal)

    def __str__(self) -> str:
        return "\n  ".join(self.sentences)

    def __repr__(self) -> str:
        return f"<ProposedLaw: {self.equation or 'no formula'}>"
