"""Chapter survey: the participants' ratings of the models and their best picks."""

from typing import Annotated

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
        "Rated models in the order of the tables; Friedman's test needs three.", min_length=3, max_length=12
    )
    scale_points: int = required(
        "Points of the Likert scale; ratings are whole numbers from 1 to this.", within="[2, 11]"
    )
    best: str = required("Column with the name of the model picked as the best.", min_length=1)
    delimiter: str = key("Character between the cells.", default=",", min_length=1, max_length=1)
    yes_no: Annotated[tuple[Word, ...], UNIQUE] = key(
        "Columns that describe the participants by yes or no (1/0 or true/false are read too).", default=()
    )
    experience: str | None = key(
        "Column with the level of experience; null where it was not asked.", default=None, min_length=1
    )
    experience_levels: Annotated[tuple[Word, ...], UNIQUE] = key(
        "Levels of experience that could be chosen, in order.", default=()
    )
    source: str | None = key(
        "Column that says where an answer comes from, or null; reconstructed_not_real marks answers "
        "nobody gave.",
        default=None,
        min_length=1,
    )


@settings
class SurveySettings:
    """The participants' survey (section 3.2.3.2 of the thesis)."""

    file: str = key("Participants' sheet (CSV), below the data root.", default="survey.csv", min_length=1)
    note: str = key(
        "Words that stand on every table and figure made of answers that the source column marks as "
        "reconstructed_not_real; real answers do not get them.",
        default="reconstructed survey (not real answers)",
        min_length=1,
    )
    statement: str = key(
        "Statement that the participants rated for every model.",
        default="The forces experienced during the simulation were similar to those of what I felt on the rubber analogue",
        min_length=1,
    )
    scale_labels: tuple[Word, ...] = key(
        "Names of the points of the scale, from the least to the greatest agreement: as many as "
        "layout.scale_points.",
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
    baseline: str = key(
        "Static model of layout.models; the best picks are also compared without it.", default="IL"
    )
    confidence: float = key("Confidence of all intervals.", default=0.95, within="[0.5, 0.999]")
    resamples: int = key(
        "Bootstrap samples of participants for the intervals of A.", default=10000, within="[1000, 1000000]"
    )
    negligible_A: float = key(
        "Largest |A - 0.5| that counts as no difference in the test of equivalence.",
        default=0.06,
        within="(0, 0.5)",
    )
