"""How strong people are, on average: torques of the ankle and of the back, with their sources."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class AnkleTorques:
    """Largest torques of one ankle, N·m."""

    plantar_flexion: float
    dorsiflexion: float
    """`plantar_flexion`, `dorsiflexion`: they hold the centre of pressure ahead of and behind the ankle."""
    inversion: float
    eversion: float
    """`inversion`, `eversion`: they hold it beside the ankle, outward and inward."""


ANKLE_SOURCE = "da Fonseca et al., World J. Orthop. 16 (2025) 108858: mean isokinetic peak torques of 69 men and 31 women"
_ANKLES = {
    "male": AnkleTorques(158.1, 53.6, 37.0, 33.4),
    "female": AnkleTorques(100.4, 37.4, 30.1, 22.3),
}
TRUNK_SOURCE = (
    "Chaffin et al. 1999, Table 4.5 (men at 20, 40 and 60° of flexion), as given in J. Electromyogr. Kinesiol. 22 (2012) "
    "814-820, Table 2; women 65 % of it (60 to 70 % in Kumar et al., Spine 20 (1995) 160-168)"
)
_FLEXION_DEG, _EXTENSION_N_M = (20.0, 40.0, 60.0), (288.0, 232.0, 171.0)
_TRUNK_OF_WOMEN = 0.65


def ankle_torques(sex: str) -> AnkleTorques:
    """Mean torques of one ankle; the mean of women's and men's where the sex is not known (`ANKLE_SOURCE`)."""
    if sex in _ANKLES:
        return _ANKLES[sex]
    both = zip(*(vars(values).values() for values in _ANKLES.values()), strict=True)
    return AnkleTorques(*(float(np.mean(pair)) for pair in both))


def trunk_extension_strength(inclination_deg: np.ndarray, sex: str) -> np.ndarray:
    """Mean largest extension moment of the trunk in N·m by its inclination in degrees (`TRUNK_SOURCE`).

    Linear between the published angles; held at the first and last beyond them. The mean of women's and men's where the sex
    is not known.
    """
    share = {"male": 1.0, "female": _TRUNK_OF_WOMEN}.get(sex, (1 + _TRUNK_OF_WOMEN) / 2)
    return share * np.interp(inclination_deg, _FLEXION_DEG, _EXTENSION_N_M)
