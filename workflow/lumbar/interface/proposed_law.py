"""Result of ``lumbar.propose``: a short formula for what the catalogue of effects leaves."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.base.errors import InputError
from lumbar.base.files import write_text
from lumbar.tissue.effects.notation import NAME
from lumbar.tissue.models.form import Effect

if TYPE_CHECKING:
    from lumbar.tissue.diagnosis.law.proposal import Proposal


def require_motion_input(forward: bool) -> None:
    """Raise `InputError` for records with the force as input."""
    if forward:
        raise InputError(
            "records with the force as input (improvement.forward): no law is looked for in them"
        )


@dataclass(frozen=True, eq=False, repr=False)
class ProposedLaw:
    """A law for what is missing, or that no short formula was found."""

    proposal: Proposal
    candidates: dict[str, Effect]
    """The catalogue that did not suffice; the law cannot take its names."""
    source_label: str
    """Name of the source of the records, for the file and the picture."""

    @property
    def found(self) -> bool:
        """True if a law is proposed."""
        return self.proposal.law is not None

    @property
    def equation(self) -> str:
        """The law as an expression; empty if none is proposed."""
        return self.proposal.form.equation if self.found else ""

    @property
    def sentences(self) -> list[str]:
        """The proposal, in plain English."""
        return self.proposal.sentences

    def to_yaml(self, name: str = "proposed_law") -> str:
        """Return the text of the effect's file.

        Raises
        ------
        InputError
            If no law is proposed, or the name cannot be an effect's.
        """
        if not self.found:
            raise InputError(f"no effect to write: {self.sentences[0]}")
        if not NAME.fullmatch(name):
            raise InputError(f"effect {name!r}: use letters a to z, digits and _, a letter first")
        if name in self.candidates:
            raise InputError(f"effect {name!r} is taken by an effect of the catalogue; choose another name")
        from lumbar.tissue.diagnosis.law.proposal import effect_text

        return effect_text(self.proposal, name, self.source_label)

    def save(self, path: str | os.PathLike, name: str = "proposed_law") -> None:
        """Write the effect's file, for ``improvement: effect_files``; errors of `to_yaml`."""
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
        save(law_figure(self.proposal), Path(stem), self.source_label)

    def __str__(self) -> str:
        return "\n  ".join(self.sentences)

    def __repr__(self) -> str:
        return f"<ProposedLaw: {self.equation or 'no formula'}>"
