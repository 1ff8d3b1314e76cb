"""One set of records that the served page shows: its diagnosis, made once, and models that are asked for."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.reports.explorer.shown import model_key

if TYPE_CHECKING:
    from lumbar.interface.diagnosis import Diagnosis, Refinement
    from lumbar.reports.explorer.page import ExplorerPage
    from lumbar.reports.explorer.shown import ShownModel


@dataclass(eq=False)
class ExploredSet:
    """A set of records, diagnosed when it is first looked at.

    Attributes
    ----------
    name : str
    make : callable
        Without arguments; returns the diagnosis.
    output : pathlib.Path
        Folder that the page may write to.
    study_file : pathlib.Path or None
        Study whose ``improvement.effects`` the page may change.
    """

    name: str
    make: Callable[[], Diagnosis]
    output: Path
    study_file: Path | None = None
    _refits: dict[str, Refinement] = field(default_factory=dict)
    _fitted: dict[str, ShownModel] = field(default_factory=dict)
    _one_at_a_time: threading.Lock = field(default_factory=threading.Lock)

    @cached_property
    def diagnosis(self) -> Diagnosis:
        """The diagnosis of the set."""
        return self.make()

    @cached_property
    def page(self) -> ExplorerPage:
        """Its page."""
        with self._one_at_a_time:
            return self.diagnosis.page()

    def refitted(self, effects: Sequence[str]) -> Refinement:
        """The base with these effects, fitted once: every tab that asks again gets the same one.

        Raises
        ------
        InputError, NumericalError
            As `lumbar.refine`.
        """
        with self._one_at_a_time:
            key = model_key(effects)
            if key not in self._refits:
                self._refits[key] = self.diagnosis.refit(effects)
            return self._refits[key]

    def fitted(self, effects: Sequence[str]) -> ShownModel:
        """The base with these effects as the page draws it: of the diagnosis, where it has them, else fitted; as `refitted`."""
        key = model_key(effects)
        if not self._fitted:
            self._fitted.update({model.key: model for model in self.page.models})
        if key not in self._fitted:
            self._fitted[key] = self.page.shown(self.refitted(effects).path[-1])
        return self._fitted[key]
