"""Chapter improvement: comparing, diagnosing and refining models."""

from typing import Annotated, Literal, get_args

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
"""File of a user-defined base."""


def is_data(file: str) -> bool:
    """Return whether a file is YAML, which is data and runs no code.

    Parameters
    ----------
    file : str
        Name of the file.
    """
    return file.endswith((".yaml", ".yml"))


def system_of(base: str) -> Literal["tissue", "pendulum"]:
    """Return the system that a base models; a user-defined base models a tissue.

    Parameters
    ----------
    base : str
        Name of a base, or a YAML file.

    Raises
    ------
    InputError
        If the base is unknown.
    """
    if base not in BASE_NAMES and not is_data(base):
        suggestion = did_you_mean(base, BASE_NAMES)
        raise InputError(
            f"unknown base model {base!r}{suggestion}; known are {', '.join(BASE_NAMES)} and files, BASE.yaml"
        )
    return "pendulum" if base == "pendulum" else "tissue"


class RecordSetSettings(Section):
    """One set of records that is diagnosed."""

    name: FolderName
    """Name of the set and its folder."""
    base: TissueBase | Literal["pendulum"] | BaseFile | None = None
    """Base model of this set, instead of improvement.base. lifting.moment_layout reads the records of a
    pendulum, tissue.layout all others."""
    session: bool | None = None
    """true: the records of this set are parts of one session; replaces improvement.session."""
    train: str | Unique[str] | None = None
    """Record of this set to fit on, or a list of records, instead of improvement.train."""
    effects: Unique[str] | None = None
    """Effects of this set's model in refined.json, in this order. null: improvement.effects for the records and
    base of the tissue chapter, if it names any; else the effects that the diagnosis selects."""
    records: tuple[RecordSettings, ...] | None = Field(None, min_length=1)
    """Records of the set; default those of the tissue chapter."""
    layout: ColumnLayout | None = None
    """Columns of this set's records, instead of tissue.layout or lifting.moment_layout."""
    rate_Hz: float | None = Field(None, gt=0)
    """Rate to which records with this layout are resampled; null keeps their rate."""


class ImprovementSettings(Section):
    """Comparing, diagnosing and refining models of tissue tests."""

    base: TissueBase | BaseFile = "auto"
    """Base model to which effects are added; auto chooses it by the data. Names with -mass move a mass; names
    with -contact are for a tool that is not fastened to the tissue. A user-defined base is a file, BASE.yaml,
    relative to the project."""
    train: str | Unique[str] | None = None
    """Record to fit on, or a list of records to fit on together; null takes the longest."""
    forward: bool = False
    """true: tissue tests have the force as input and the motion as output (load-controlled tests). Models are
    then simulated from force to motion; errors have the unit of the motion."""
    session: bool = False
    """true: the records are consecutive parts of one session; each begins in the state (path, time, relaxation,
    hysteresis, damage) in which the previous one left the tissue. false: each begins at rest."""
    effects: Unique[str] = ()
    """Effects added to the base, in this order. The model with them is in Table 3.1, Figure 3.5 and
    models.json, and in refined.json of the record sets of the tissue chapter."""
    record_sets: tuple[RecordSetSettings, ...] = Field(
        default_factory=lambda: (RecordSetSettings(name="tissue"),), min_length=1
    )
    """Sets of records that are diagnosed; results are in improvement/<name>."""
    effect_files: tuple[str, ...] = ()
    """Files of user-defined effects, relative to the project: equations in YAML, or Python, which is run as code."""
    most_effects: int = Field(3, ge=1, le=5)
    """Largest number of effects that a diagnosis adds."""
    propose_law: bool = True
    """true: search a short formula for the error that effects of the catalogue leave in a tissue test;
    takes seconds to two minutes."""

    @property
    def base_files(self) -> dict[str, str]:
        """Files of user-defined bases by the key that names each."""
        sets = {f"record_sets.{number}.base": entry.base for number, entry in enumerate(self.record_sets)}
        named = {"base": self.base, **sets}
        return {place: file for place, file in named.items() if file and is_data(file)}
