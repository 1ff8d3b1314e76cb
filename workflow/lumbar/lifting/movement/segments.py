"""Trunk segments: their share of body mass, and where their centre of mass lies between landmarks."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

from lumbar.base.errors import InputError
from lumbar.lifting.movement.trunk_points import MID_HIP

COMS = ("thorax", "abdomen", "pelvis")
"""The three centres of mass of the trunk, from top to bottom (thesis, Figure 4.2)."""


@dataclass(frozen=True)
class Segment:
    """One trunk segment between two of its ends."""

    name: str
    """One of `COMS`."""
    proximal: str
    distal: str
    """`proximal`, `distal`: its upper and lower end, by the names of `lumbar.lifting.movement.trunk_points.SKIN_MARKERS`.
    """
    mass_share: float
    """Mass as a share of body mass."""
    com_share: float
    """Distance of the centre of mass from the proximal end, as a share of the distance between the ends."""
    forward_share: float = 0.0
    """How far the centre of mass lies ahead of the line between the ends, as a share of the same distance."""


@dataclass(frozen=True)
class SegmentTable:
    """A published set of segment parameters."""

    name: str
    segments: tuple[Segment, ...]
    """In the order of `COMS`."""
    source: str
    """Publication, with what had to be adapted."""

    @property
    def ends(self) -> tuple[str, ...]:
        """Ends of the segments, from top to bottom."""
        return tuple(
            dict.fromkeys(end for segment in self.segments for end in (segment.proximal, segment.distal))
        )

    def ends_of(self, name: str) -> tuple[str, str]:
        """Upper and lower end of one segment."""
        return next((segment.proximal, segment.distal) for segment in self.segments if segment.name == name)


WINTER = SegmentTable(
    "winter",
    (
        Segment("thorax", "C7T1", "T12L1", 0.216, 0.82),
        Segment("abdomen", "T12L1", "L4L5", 0.139, 0.44),
        Segment("pelvis", "L4L5", MID_HIP, 0.142, 0.105),
    ),
    "Winter, Biomechanics and Motor Control of Human Movement, 4th ed. (2009), Table 4.1, after Dempster "
    "(1955): "
    "thorax C7/T1-T12/L1, abdomen T12/L1-L4/L5, pelvis L4/L5-greater trochanter",
)

_DE_LEVA_SOURCE = (
    "de Leva, J. Biomech. 29 (1996) 1223-1230, Table 4 ({sex}): upper trunk cervicale-xiphion, middle trunk "
    "xiphion-omphalion, lower trunk omphalion-mid-hip. Adapted: C7/T1 stands for the level of the cervicale, and "
    "L4/L5 for the navel (omphalion), which carries no marker and lies at about its level. Its segments end at other "
    "heights than Winter's: compare the trunk's centre, not segments"
)


def _de_leva(sex: str, masses: tuple[float, ...], coms: tuple[float, ...]) -> SegmentTable:
    ends = (("C7T1", "XIPHOID_LEVEL"), ("XIPHOID_LEVEL", "L4L5"), ("L4L5", MID_HIP))
    segments = tuple(
        Segment(name, *end, mass, com) for name, end, mass, com in zip(COMS, ends, masses, coms, strict=True)
    )
    return SegmentTable(f"de_leva_{sex}", segments, _DE_LEVA_SOURCE.format(sex=sex))


DE_LEVA = {
    "male": _de_leva("male", (0.1596, 0.1633, 0.1117), (0.5066, 0.4502, 0.6115)),
    "female": _de_leva("female", (0.1545, 0.1465, 0.1247), (0.5050, 0.4512, 0.4920)),
}


_DUMAS_SOURCE = (
    "Dumas and Wojtusch, Handbook of Human Motion (2018), Table 1 ({sex}), after McConville et al. and Young et al.: "
    "thorax C7/T1-T12/L1, abdomen T12/L1-L5/S1, pelvis L5/S1-hips. Adapted: the pelvis's centre, published in the axes "
    "of ASIS and PSIS, is taken along and ahead of the line L5/S1-hips, as both lie in the regressions it comes with"
)


def _dumas(sex: str, masses, coms, pelvis_line: tuple[float, float]) -> SegmentTable:
    """Table from centres (forward, up; shares of the length); the pelvis's line in its own axes, any unit."""
    ends = (("C7T1", "T12L1"), ("T12L1", "L5S1"), ("L5S1", MID_HIP))
    (forward, up), length = pelvis_line, hypot(*pelvis_line)
    x, y = coms[2]
    along = (x * forward + y * up) / length
    ahead = (y * forward - x * up) / length
    shares = [(-coms[0][1], coms[0][0]), (-coms[1][1], coms[1][0]), (along, ahead)]
    segments = tuple(
        Segment(name, *end, mass, *share)
        for name, end, mass, share in zip(COMS, ends, masses, shares, strict=True)
    )
    return SegmentTable(f"dumas_{sex}", segments, _DUMAS_SOURCE.format(sex=sex))


DUMAS = {
    "male": _dumas(
        "male", (0.304, 0.029, 0.142), ((0.0, -0.555), (0.176, -0.361), (-0.002, -0.282)), (0.240, -0.338)
    ),
    "female": _dumas(
        "female", (0.263, 0.041, 0.147), ((0.015, -0.542), (0.219, -0.410), (-0.072, -0.228)), (0.201, -0.385)
    ),
}
_BY_SEX = {"de_leva": DE_LEVA, "dumas": DUMAS}


def segment_table(name: str, sex: str) -> SegmentTable:
    """Return a segment table by its name in the configuration.

    Parameters
    ----------
    name : {"winter", "de_leva", "dumas"}
        De Leva's and Dumas's parameters differ between the sexes, Winter's do not.
    sex : {"female", "male", "unknown"}
        As declared in the subject's file.

    Raises
    ------
    InputError
        For an unknown table, or if the table needs a sex that is not known.
    """
    if name == "winter":
        return WINTER
    if name not in _BY_SEX:
        raise InputError(f"lifting.segments is {name!r}; allowed: winter, de_leva, dumas")
    tables = _BY_SEX[name]
    if sex not in tables:
        raise InputError(
            f"lifting.segments is {name}, whose parameters differ between the sexes, but subject.sex is "
            f"{sex!r}; "
            "set female or male, or choose winter"
        )
    return tables[sex]


def all_tables(sex: str) -> tuple[SegmentTable, ...]:
    """Return every table that suits a sex; both of each where it is not known."""
    of_sex = [
        table
        for tables in _BY_SEX.values()
        for name, table in tables.items()
        if sex not in tables or name == sex
    ]
    return (WINTER, *of_sex)
