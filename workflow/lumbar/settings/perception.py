"""What a hand can tell: thresholds of this study's people, where they are known better than the literature has them."""

from typing import Annotated

from lumbar.settings.key import ASCENDING, Each, Positive, key, settings

Share = Annotated[float, Each(gt=0, le=2)]
Shares = Annotated[tuple[Share, Share, Share], ASCENDING]
Sizes = Annotated[tuple[Positive, Positive, Positive], ASCENDING]


@settings
class PerceptionSettings:
    """What a hand can tell; each key the keenest, the usual and the dullest hand, null as in the literature."""

    force_weber: Shares | None = key(default=None)
    force_floor_N: Sizes | None = key(default=None)
    vibration_weber: Shares | None = key(default=None)
    vibration_floor_N: Sizes | None = key(default=None)
    window_s: Sizes | None = key(default=None)
