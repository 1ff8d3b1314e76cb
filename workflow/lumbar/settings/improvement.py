"""Chapter improvement: comparing, diagnosing and refining models."""

from collections.abc import Callable
from dataclasses import replace
from typing import Annotated, Literal, Self, get_args

from lumbar.base.errors import InputError, did_you_mean
from lumbar.settings.key import UNIQUE, Each, FolderName, key, required, settings
from lumbar.settings.layout import ColumnLayout, RecordSettings

TissueBase = Literal[
    "auto", "LE", "Maxwell", "KV", "KB", "KV-mass", "KB-mass", "LE-contact", "KV-contact", "KB-contact"
]
"""Bases of a tissue that a study may name."""
BASE_NAMES = (*get_args(TissueBase), "pendulum")
BaseFile = Annotated[str, Each(pattern=r".\.ya?ml$")]
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


@settings
class RecordSetSettings:
    """One set of records that is diagnosed."""

    name: FolderName = required()
    base: TissueBase | Literal["pendulum"] | BaseFile | None = key(default=None)
    session: bool | None = key(default=None)
    train: str | Annotated[tuple[str, ...], UNIQUE] | None = key(default=None)
    effects: Annotated[tuple[str, ...], UNIQUE] | None = key(default=None)
    records: tuple[RecordSettings, ...] | None = key(default=None, min_length=1)
    layout: ColumnLayout | None = key(default=None)
    rate_Hz: float | None = key(default=None, gt=0)


@settings
class ImprovementSettings:
    """Comparing, diagnosing and refining models of tissue tests."""

    base: TissueBase | BaseFile = key(default="auto")
    train: str | Annotated[tuple[str, ...], UNIQUE] | None = key(default=None)
    forward: bool = key(default=False)
    session: bool = key(default=False)
    effects: Annotated[tuple[str, ...], UNIQUE] = key(default=())
    record_sets: tuple[RecordSetSettings, ...] = key(default=(RecordSetSettings("tissue"),), min_length=1)
    effect_files: tuple[str, ...] = key(default=())
    most_effects: int = key(default=3, within="[1, 5]")
    propose_law: bool = key(default=True)

    def with_bases_at(self, place: Callable[[str], str]) -> Self:
        """The same with the files of bases where `place` says that they are."""

        def placed(base):
            return place(base) if base and is_data(base) else base

        sets = tuple(replace(entry, base=placed(entry.base)) for entry in self.record_sets)
        return replace(self, base=placed(self.base), record_sets=sets)

    @property
    def base_files(self) -> dict[str, str]:
        """Files of bases of one's own, by the key that names each."""
        sets = {f"record_sets.{number}.base": entry.base for number, entry in enumerate(self.record_sets)}
        named = {"base": self.base, **sets}
        return {place: file for place, file in named.items() if file and is_data(file)}
