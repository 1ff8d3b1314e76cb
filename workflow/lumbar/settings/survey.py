"""Chapter survey: the participants' ratings of the models and their best picks."""

from __future__ import annotations

from typing import Annotated, Literal

from lumbar.settings.key import NAME, UNIQUE, Word, key, required, section, settings


@settings
class RatedModelSettings:
    """One rated model."""

    name: str = required("Name of the model, e.g. KB.", pattern=NAME)
    column: str = required("Column with its ratings.", min_length=1)


@settings
class RatingsLayout:
    """What the columns of the sheet mean; the file needs a header."""

    participant: str = required("Column that names or codes the participant; every value once.", min_length=1)
    models: tuple[RatedModelSettings, ...] = required(
        "Rated models in the order of the tables; Friedman's test needs three.",
        min_length=3,
        max_length=12,
    )
    scale_points: int = required(
        "Points of the Likert scale; ratings are whole numbers from 1 to this.", ge=2, le=11
    )
    best: str = required("Column with the name of the model picked as the best.", min_length=1)
    delimiter: str = key(",", "Character between the cells.", min_length=1, max_length=1)
    yes_no: Annotated[tuple[Word, ...], UNIQUE] = key(
        (),
        "Columns that describe the participants by yes or no (1/0 or true/false are read too).",
    )
    experience: str | None = key(
        None, "Column with the level of experience; null where it was not asked.", min_length=1
    )
    experience_levels: Annotated[tuple[Word, ...], UNIQUE] = key(
        (), "Levels of experience that could be chosen, in order."
    )
    source: str | None = key(
        None,
        "Column that says where an answer comes from, or null; reconstructed_not_real marks answers "
        "nobody gave.",
        min_length=1,
    )


@settings
class SurveySettings:
    """The participants' survey (section 3.2.3.2 of the thesis)."""

    file: str = key("survey.csv", "Participants' sheet (CSV), below the data root.", min_length=1)
    note: str = key(
        "reconstructed survey (not real answers)",
        "Words that stand on every table and figure made of answers that the source column marks as "
        "reconstructed_not_real; real answers do not get them.",
        min_length=1,
    )
    statement: str = key(
        "The forces experienced during the simulation were similar to those of what I felt on the rubber analogue",
        "Statement that the participants rated for every model.",
        min_length=1,
    )
    scale_labels: tuple[Word, ...] = key(
        ("strongly disagree", "disagree", "neutral", "agree", "strongly agree"),
        "Names of the points of the scale, from the least to the greatest agreement: as many as "
        "layout.scale_points.",
        min_length=2,
        max_length=11,
    )
    layout: RatingsLayout = section(
        RatingsLayout,
        participant="participant",
        models=tuple(RatedModelSettings(name, name) for name in ("IL", "MW", "KB", "HO")),
        scale_points=5,
        best="best",
        yes_no=("clinician", "dry_needling", "acupuncture", "palpation"),
        experience="experience",
        experience_levels=("<5", "5-20", ">20"),
        source="source",
    )
    baseline: str = key("IL", "Static model of layout.models; the best picks are also compared without it.")
    zeros: Literal["pratt", "wilcox"] = key(
        "pratt",
        "Zero differences in Wilcoxon's test: ranked and then dropped (pratt), or dropped first (wilcox).",
    )
    confidence: float = key(0.95, "Confidence of all intervals.", ge=0.5, le=0.999)
    resamples: int = key(
        10000, "Bootstrap samples of participants for the intervals of A.", ge=1000, le=1000000
    )
    negligible_A: float = key(
        0.06, "Largest |A - 0.5| that counts as no difference in the test of equivalence.", gt=0, lt=0.5
    )
