"""Statistics of people: what their comparison is to find, and how it is checked."""

from typing import Annotated

from lumbar.settings.key import UNIQUE, Each, Positive, key, settings

Count = Annotated[int, Each(ge=1, le=1000)]


@settings
class PopulationSettings:
    """Groups and boxes compared over all persons, measure by measure (stability.compare.groups names the groups)."""

    detect_percent: float = key(default=10.0, within="(0, 1000]")
    detect: dict[str, Positive] = key(default={})
    power: float = key(default=0.8, within="(0.05, 1)")
    assurance: float = key(default=0.8, within="[0.5, 1)")
    significance: float = key(default=0.05, within="(0, 0.5)")
    planned_trials: Annotated[tuple[Count, ...], UNIQUE] = key(default=(1, 3, 5), min_length=1)
