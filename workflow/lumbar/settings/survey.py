"""Chapter survey: the participants' ratings of the models and their best picks."""

from typing import Annotated

from lumbar.settings.key import NAME, UNIQUE, Word, key, required, section, settings


@settings
class RatedModelSettings:
    """One rated model."""

    name: str = required(pattern=NAME)
    column: str = required(min_length=1)


@settings
class RatingsLayout:
    """What the columns of the sheet mean; the file needs a header."""

    participant: str = required(min_length=1)
    models: tuple[RatedModelSettings, ...] = required(min_length=3, max_length=12)
    scale_points: int = required(within="[2, 11]")
    best: str = required(min_length=1)
    delimiter: str = key(default=",", min_length=1, max_length=1)
    yes_no: Annotated[tuple[Word, ...], UNIQUE] = key(default=())
    experience: str | None = key(default=None, min_length=1)
    experience_levels: Annotated[tuple[Word, ...], UNIQUE] = key(default=())
    source: str | None = key(default=None, min_length=1)


@settings
class SurveySettings:
    """The participants' survey (section 3.2.3.2 of the thesis)."""

    file: str = key(default="survey.csv", min_length=1)
    note: str = key(default="reconstructed survey (not real answers)", min_length=1)
    statement: str = key(
        default="The forces experienced during the simulation were similar to those of what I felt on the rubber analogue",
        min_length=1,
    )
    scale_labels: tuple[Word, ...] = key(
        default=("strongly disagree", "disagree", "neutral", "agree", "strongly agree"),
        min_length=2,
        max_length=11,
    )
    layout: RatingsLayout = section(
        default_factory=RatingsLayout,
        participant="participant",
        models=tuple(RatedModelSettings(name, name) for name in ("IL", "MW", "KB", "HO")),
        scale_points=5,
        best="best",
        yes_no=("clinician", "dry_needling", "acupuncture", "palpation"),
        experience="experience",
        experience_levels=("<5", "5-20", ">20"),
        source="source",
    )
    baseline: str = key(default="IL")
    confidence: float = key(default=0.95, within="[0.5, 0.999]")
    resamples: int = key(default=10000, within="[1000, 1000000]")
    negligible_A: float = key(default=0.06, within="(0, 0.5)")
