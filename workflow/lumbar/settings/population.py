"""Statistics of people: what their comparison is to find, and how it is checked."""

from typing import Annotated

from lumbar.settings.key import UNIQUE, Each, Positive, key, settings

Count = Annotated[int, Each(ge=1, le=1000)]


@settings
class PopulationSettings:
    """Groups and boxes compared over all persons, measure by measure (stability.compare.groups names the groups)."""

    detect_percent: float = key(
        "Difference that a study to be planned shall see, in percent of the second mean; for measures that detect does not "
        "name.",
        default=10.0,
        within="(0, 1000]",
    )
    detect: dict[str, Positive] = key(
        "The same by measure, in the measure's unit, e.g. {margin_of_stability: 0.01}.", default={}
    )
    power: float = key("Probability to see it.", default=0.8, within="(0.05, 1)")
    assurance: float = key(
        "Probability that a study of the assured size has that power, over how the standard deviations of the people here may be "
        "off.",
        default=0.8,
        within="[0.5, 1)",
    )
    significance: float = key(
        "Level of the two-sided test that a study is planned for.", default=0.05, within="(0, 0.5)"
    )
    planned_trials: Annotated[tuple[Count, ...], UNIQUE] = key(
        "Numbers of trials of each person for which the table says how many persons are needed.",
        default=(1, 3, 5),
        min_length=1,
    )
    resamples: int = key("Samples of the cluster bootstrap.", default=2000, within="[200, 100000]")
