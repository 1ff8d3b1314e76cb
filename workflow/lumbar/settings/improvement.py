"""Chapter improvement: comparing, diagnosing and refining models."""

from __future__ import annotations

from typing import Annotated, Literal

from lumbar.settings.key import NAME, UNIQUE, key, required, settings
from lumbar.settings.layout import RecordSettings


@settings
class RecordSetSettings:
    """One set of records that is diagnosed."""

    name: str = required("Name of the set and its folder.", pattern=NAME)
    base: Literal["LE", "Maxwell", "KV", "KB", "pendulum"] | None = key(
        "Base model of this set, instead of improvement.base. The records of a pendulum are read by "
        "lifting.moment_layout, all others by tissue.layout.",
        default=None,
    )
    records: tuple[RecordSettings, ...] | None = key(
        "Records of the set; left out, they are those of the tissue chapter.", default=None, min_length=1
    )


@settings
class ImprovementSettings:
    """Comparing, diagnosing and refining models of tissue tests."""

    base: Literal["LE", "Maxwell", "KV", "KB"] = key("Base model that effects are added to.", default="KB")
    train: str | Annotated[tuple[str, ...], UNIQUE] | None = key(
        "Record to fit on, or a list of records to fit on together; null takes the longest.", default=None
    )
    effects: Annotated[tuple[str, ...], UNIQUE] = key(
        "Effects added to the base, in this order; the model with them stands in Table 3.1, Figure "
        "3.5 and models.json.",
        default=(),
    )
    record_sets: tuple[RecordSetSettings, ...] = key(
        "Sets of records that are diagnosed; results are in improvement/<name>.",
        default=(RecordSetSettings("tissue"),),
        min_length=1,
    )
    centre: bool = key(
        "Take each record's means off input and output: for sensors whose zero is arbitrary.", default=False
    )
    effect_files: tuple[str, ...] = key(
        "Files of effects of your own, relative to the project: equations in YAML, or Python, which is run as code.",
        default=(),
    )
    most_effects: int = key("Most effects a diagnosis adds.", default=3, ge=1, le=5)
