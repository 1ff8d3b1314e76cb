"""Labels of a recorded athlete who stands on force plates (real/lifting/athlete_static_full_spine), as aliases."""

from __future__ import annotations

ATHLETE = {
    "MANUBRIUM": "STRN",
    "XIPHOID": "XIPH",
    "L5": "SACROL",
    "SACRUM": {"mean": ["LPSI", "RPSI"]},
    **{f"{side}_HIP": {"from": f"{side}ASI", "offset_m": [0, 0, -0.1]} for side in "LR"},
    **{
        f"{side}_{name}": {"mean": [side + label for label in labels]}
        for side in "LR"
        for name, labels in {
            "SHOULDER": ["ACR"],
            "WRIST": ["WRR", "WRU"],
            "ELBOW": ["CUBL", "CUBM"],
            "KNEE": ["KNEL", "KNEM"],
            "ANKLE": ["MALL", "MALM"],
        }.items()
    },
}
