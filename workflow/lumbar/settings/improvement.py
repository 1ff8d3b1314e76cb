"""Chapter improvement: comparing, diagnosing and refining models."""

from collections.abc import Callable
from typing import Annotated, Literal, Self, get_args

from pydantic import Field

from lumbar.base.errors import InputError, did_you_mean
from lumbar.settings.layout import ColumnLayout, RecordSettings
from lumbar.settings.section import FolderName, Section, Unique

TissueBase = Literal[
    "auto", "LE", "Maxwell", "KV", "KB", "KV-mass", "KB-mass", "LE-contact", "KV-contact", "KB-contact"
]
"""Bases of a tissue that a study may name."""
BASE_NAMES = (*get_args(TissueBase), "pendulum")
BaseFile = Annotated[str, Field(pattern=r".\.ya?ml$")]
"""File of a base of one's own."""


def is_data(file: str) -> bool:
    """Whether a base is named by a file of one's own, and whether a file of effects is data, which runs nothing."""
    return file.endswith((".yaml", ".yml"))


def system_of(base: str) -> Literal["tissue", "pendulum"]:
    """What a base is a model of; one of one's own is of a tissue, or of whatever is measured in its place."""
    if base not in BASE_NAMES and not is_data(base):
        meant = did_you_mean(base, BASE_NAMES)
        raise InputError(
            f"unknown base model {base!r}{meant}; known are {', '.join(BASE_NAMES)} and files, BASE.yaml"
        )
    return "pendulum" if base == "pendulum" else "tissue"


class RecordSetSettings(Section):
    """One set of records that is diagnosed."""

    name: FolderName
    """Name of the set and its folder."""
    base: TissueBase | Literal["pendulum"] | BaseFile | None = None
    """Base model of this set, instead of improvement.base. The records of a pendulum are read by
    lifting.moment_layout, all others by tissue.layout."""
    session: bool | None = None
    """Whether the records of this set were cut from one session, instead of improvement.session."""
    train: str | Unique[str] | None = None
    """Record of this set to fit on, or a list of records, instead of improvement.train."""
    effects: Unique[str] | None = None
    """Effects of this set's model in refined.json, in this order; null takes improvement.effects for the
    records and base of the tissue chapter where it names any, else what the diagnosis selects."""
    records: tuple[RecordSettings, ...] | None = Field(None, min_length=1)
    """Records of the set; left out, they are those of the tissue chapter."""
    layout: ColumnLayout | None = None
    """Columns of this set's own records, instead of tissue.layout or lifting.moment_layout."""
    rate_Hz: float | None = Field(None, gt=0)
    """Rate to which records read by a layout of this set's own are resampled; null leaves them as recorded."""


class ImprovementSettings(Section):
    """Comparing, diagnosing and refining models of tissue tests."""

    base: TissueBase | BaseFile = "auto"
    """Base model that effects are added to; auto takes the one that the data ask for. Those with -mass move
    a mass; those with -contact are for a tool that is not fastened to the tissue. A base of your own is a
    file, BASE.yaml, relative to the project."""
    train: str | Unique[str] | None = None
    """Record to fit on, or a list of records to fit on together; null takes the longest."""
    forward: bool = False
    """Whether the records of tissue tests have the force as input and the motion as output (load-controlled
    tests): models are then simulated from force to motion, and errors are in the unit of the motion."""
    session: bool = False
    """true: the records were cut from one session, in their order, and each begins in the state (path,
    time, relaxation, hysteresis, damage) in which the one before it left the tissue; false: at rest and
    anew."""
    effects: Unique[str] = ()
    """Effects added to the base, in this order; the model with them stands in Table 3.1, Figure 3.5 and
    models.json, and in refined.json of the record sets that are the tissue chapter's."""
    record_sets: tuple[RecordSetSettings, ...] = Field(
        default_factory=lambda: (RecordSetSettings(name="tissue"),), min_length=1
    )
    """Sets of records that are diagnosed; results are in improvement/<name>."""
    effect_files: tuple[str, ...] = ()
    """Files of effects of your own, relative to the project: equations in YAML, or Python, which is run as
    code."""
    most_effects: int = Field(3, ge=1, le=5)
    """Most effects a diagnosis adds."""
    propose_law: bool = True
    """Where effects of the catalogue leave something of a tissue test, look for a short formula for it;
    takes seconds to two minutes."""

    def with_bases_at(self, place: Callable[[str], str]) -> Self:
        """The same with the files of bases where `place` says that they are."""

        def placed(base):
            return place(base) if base and is_data(base) else base

        sets = tuple(entry.model_copy(update={"base": placed(entry.base)}) for entry in self.record_sets)
        return self.model_copy(update={"base": placed(self.base), "record_sets": sets})

    @property
    def base_files(self) -> dict[str, str]:
        """Files of bases of one's own, by the key that names each."""
        sets = {f"record_sets.{number}.base": entry.base for number, entry in enumerate(self.record_sets)}
        named = {"base": self.base, **sets}
        return {place: file for place, file in named.items() if file and is_data(file)}
