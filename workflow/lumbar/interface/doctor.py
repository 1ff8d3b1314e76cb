"""``lumbar.doctor``: what could have been seen in records, from what size on, and what further record would help."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from lumbar.base.errors import InputError
from lumbar.base.files import write_text
from lumbar.interface.diagnosed import Diagnosis
from lumbar.interface.diagnosis import diagnose
from lumbar.interface.verb import Result, label_of, settings_or_default
from lumbar.records.record import Record, require_clock
from lumbar.settings.study_settings import StudySettings
from lumbar.tables.table import Table
from lumbar.tissue.diagnosis.doctor.effect_sizes import EffectSize
from lumbar.tissue.diagnosis.doctor.examination import Examination, examine
from lumbar.tissue.diagnosis.doctor.report import effects_table, terminal_text, to_json
from lumbar.tissue.diagnosis.evidence.discrimination import motion_csv
from lumbar.tissue.diagnosis.evidence.evidence import machine_limits
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.selection.verdict import Verdict
from lumbar.tissue.effects.catalogue import choose


def doctor(
    records: Sequence[Record],
    *,
    effects: Sequence[str] | None = None,
    base: str | None = None,
    train: str | Sequence[str] | None = None,
    settings: StudySettings | None = None,
    data: str = "",
) -> "Examined":
    """Answer "could I have seen it?": predict how large every effect must be to be named, and confirm it by a blind diagnosis.

    The records are diagnosed first. The refined model is taken for the truth; its answers to the records' own motions, with
    twice what is predicted of an effect and noise like the records' own, are diagnosed as `diagnose` would: a diagnosis for each.

    Parameters
    ----------
    records : sequence of Record
        One per excitation, with channels ``input`` and ``output``.
    effects : sequence of str, optional
        Effects to put in; default all of the catalogue.
    base, train, settings, data
        As of `diagnose`; the seed is also that of the noise.

    Raises
    ------
    InputError
        As `diagnose`; for an unknown effect; for records of which direction or sign is wrong, and for those with the force
        as input.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.twin.examples import example_records
    >>> found = lumbar.doctor(example_records(), effects=["coulomb_friction"])
    >>> found["coulomb_friction"].words
    'named'
    """
    data, records = label_of(data, records), list(records)
    # What is asked is whether an effect of the catalogue would be named: no law is looked for in hundreds of records.
    settings = settings_or_default(settings)
    settings = replace(settings, improvement=replace(settings.improvement, propose_law=False))
    if settings.improvement.forward:
        raise InputError(
            "records with the force as input (improvement.forward): no effects are put into them"
        )
    known = DiagnosisSettings.from_study(settings, base, train).candidates
    choose(list(effects or ()), known)  # who misspelt need not wait

    def verdict_on(seen: Sequence[Record], most_effects: int) -> Verdict:
        improvement = replace(settings.improvement, most_effects=most_effects)
        # The forces of the model are in the axes of the position already.
        tissue = replace(settings.tissue, force_frame=None)
        chosen = replace(settings, improvement=improvement, tissue=tissue)
        return diagnose(seen, base=base, train=train, settings=chosen).verdict

    own = diagnose(records, base=base, train=train, settings=settings, data=data)
    require_clock(own.records)
    examination = examine(
        records,
        own.verdict,
        own.candidates,
        verdict_on,
        effects=effects,
        limits=machine_limits(settings.signals.machine, own.verdict.experiment),
        seed=settings.seed,
    )
    return Examined(own, examination, own.data)


@dataclass(frozen=True, eq=False, repr=False)
class Examined(Result):
    """What could have been seen in a set of records; an effect is found by its name."""

    diagnosis: Diagnosis
    """Of the records themselves."""
    examination: Examination
    """What was put in and what was said of it."""
    data: str

    def __getitem__(self, effect: str) -> EffectSize:
        """From what size on an effect would have been named."""
        for item in self.examination.effects:
            if item.form.effect == effect:
                return item
        known = ", ".join(item.form.effect for item in self.examination.effects)
        raise InputError(f"effect {effect!r} was not put in; put in were {known}")

    @cached_property
    def table(self) -> Table:
        """From what size on each effect would have been named."""
        return effects_table(self.examination, self.data)

    def files(self) -> Iterator[tuple[str, Any]]:
        """``doctor.json`` and the table ``doctor``."""
        yield "doctor", self.table
        yield "doctor.json", to_json(self.examination, self.data)

    def save_excitation(self, path: str | os.PathLike) -> None:
        """Write the further record that helps most as a file to play: ``time_s,position_<unit>``.

        Raises
        ------
        InputError
            Where no excitation within the machine's limits would help.
        """
        further = self.examination.further
        if further is None:
            raise InputError(
                f"{path}: not written: no excitation tried would show more than the records at hand"
            )
        unit = self.diagnosis.verdict.experiment.input_unit
        write_text(Path(path), motion_csv(further.excitation.motion, unit))

    def __str__(self) -> str:
        return terminal_text(self.examination)

    def __repr__(self) -> str:
        named = sum(item.is_named for item in self.examination.effects)
        return f"<Examined: {named} of {len(self.examination.effects)} effects would be named>"

    def _repr_html_(self) -> str:
        return self.table.frame.to_html(index=False, na_rep="–")
