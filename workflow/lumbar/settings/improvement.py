"""Chapter improvement: comparing, diagnosing and refining models."""

from __future__ import annotations

from typing import Annotated, Literal

from lumbar.settings.key import NAME, UNIQUE, key, required, settings
from lumbar.settings.layout import RecordSettings

TISSUE_BASES = (
    "auto",
    "LE",
    "Maxwell",
    "KV",
    "KB",
    "LE-contact",
    "KV-contact",
    "KB-contact",
)
"""Bases of a tissue that a study may name."""


@settings
class RecordSetSettings:
    """One set of records that is diagnosed."""

    name: str = required("Name of the set and its folder.", pattern=NAME)
    base: Literal[*TISSUE_BASES, "pendulum"] | None = key(
        None,
        "Base model of this set, instead of improvement.base. The records of a pendulum are read by "
        "lifting.moment_layout, all others by tissue.layout.",
    )
    records: tuple[RecordSettings, ...] | None = key(
        None, "Records of the set; left out, they are those of the tissue chapter.", min_length=1
    )


@settings
class ImprovementSettings:
    """Comparing, diagnosing and refining models of tissue tests."""

    base: Literal[*TISSUE_BASES] = key(
        "auto",
        "Base model that effects are added to; auto takes the one that the data ask for. Those with -contact are for a "
        "tool that is not fastened to the tissue.",
    )
    train: str | Annotated[tuple[str, ...], UNIQUE] | None = key(
        None, "Record to fit on, or a list of records to fit on together; null takes the longest."
    )
    effects: Annotated[tuple[str, ...], UNIQUE] = key(
        (),
        "Effects added to the base, in this order; the model with them stands in Table 3.1, Figure "
        "3.5 and models.json.",
    )
    record_sets: tuple[RecordSetSettings, ...] = key(
        (RecordSetSettings("tissue"),),
        "Sets of records that are diagnosed; results are in improvement/<name>.",
        min_length=1,
    )
    effect_files: tuple[str, ...] = key(
        (),
        "Files of effects of your own, relative to the project: equations in YAML, or Python, which is run as code.",
    )
    most_effects: int = key(3, "Most effects a diagnosis adds.", ge=1, le=5)
