"""Chapter survey: the participants' ratings of the models and their best picks."""

from pydantic import Field

from lumbar.settings.section import NAME, Section, Unique, Word


class RatedModelSettings(Section):
    """One rated model."""

    name: str = Field(pattern=NAME)
    """Name of the model, e.g. KB."""
    column: str = Field(min_length=1)
    """Column with its ratings."""


class RatingsLayout(Section):
    """Columns of the participants' table; the file needs a header."""

    participant: str = Field(min_length=1)
    """Column with the name or code of the participant; every value occurs once."""
    models: tuple[RatedModelSettings, ...] = Field(min_length=3, max_length=12)
    """Rated models in the order of the tables; Friedman's test needs three."""
    scale_points: int = Field(ge=2, le=11)
    """Points of the Likert scale; ratings are whole numbers between 1 and this."""
    best: str = Field(min_length=1)
    """Column with the name of the model chosen as the best."""
    delimiter: str = Field(",", min_length=1, max_length=1)
    """Character between the cells."""
    yes_no: Unique[Word] = ()
    """Columns that describe the participants by yes or no (1/0 or true/false are read too)."""
    experience: str | None = Field(None, min_length=1)
    """Column with the level of experience; null if the survey did not include it."""
    experience_levels: Unique[Word] = ()
    """Levels of experience to choose from, in order."""
    source: str | None = Field(None, min_length=1)
    """Column with the source of an answer, or null; reconstructed_not_real marks answers that no participant gave."""


class SurveySettings(Section):
    """The participants' survey (section 3.2.3.2 of the thesis)."""

    file: str = Field("survey.csv", min_length=1)
    """Participants' table (CSV), below the data root."""
    note: str = Field("reconstructed survey (not real answers)", min_length=1)
    """Label on every table and figure of answers that the source column marks as reconstructed_not_real; real
    answers do not get it."""
    statement: str = Field(
        "The forces experienced during the simulation were similar to those of what I felt on the rubber analogue",
        min_length=1,
    )
    """Statement that the participants rated for every model."""
    scale_labels: tuple[Word, ...] = Field(
        ("strongly disagree", "disagree", "neutral", "agree", "strongly agree"), min_length=2, max_length=11
    )
    """Names of the points of the scale, in order of agreement: layout.scale_points of them."""
    layout: RatingsLayout = Field(
        default_factory=lambda: RatingsLayout(
            participant="participant",
            models=tuple(RatedModelSettings(name=name, column=name) for name in ("IL", "MW", "KB", "HO")),
            scale_points=5,
            best="best",
            yes_no=("clinician", "dry_needling", "acupuncture", "palpation"),
            experience="experience",
            experience_levels=("<5", "5-20", ">20"),
            source="source",
        )
    )
    baseline: str = "IL"
    """Static model of layout.models; the best choices are also compared without it."""
    confidence: float = Field(0.95, ge=0.5, le=0.999)
    """Confidence of all intervals."""
    resamples: int = Field(10000, ge=1000, le=1000000)
    """Number of bootstrap samples of participants for the intervals of A."""
    negligible_A: float = Field(0.06, gt=0, lt=0.5)
    """Largest |A - 0.5| that counts as no difference in the test of equivalence."""
