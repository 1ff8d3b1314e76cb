"""Trunk segments: their share of body mass, and where their centre of mass lies between landmarks."""

from __future__ import annotations

from dataclasses import dataclass

from lumbar.errors import InputError

COMS = ("thorax", "abdomen", "pelvis")
"""The three centres of mass of the trunk, from top to bottom (thesis, Figure 4.2)."""
MID_HIP = "MID_HIP"
"""Midpoint of the greater trochanters, `L_HIP` and `R_HIP`."""


@dataclass(frozen=True)
class Segment:
    """One trunk segment between two landmarks.

    Attributes
    ----------
    name : str
        One of `COMS`.
    proximal, distal : str
        Landmarks at its upper and lower end: marker names, or `MID_HIP`.
    mass_share : float
        Mass as a share of body mass.
    com_share : float
        Distance of the centre of mass from the proximal end, as a share of the distance between the ends.
    """

    name: str
    proximal: str
    distal: str
    mass_share: float
    com_share: float


@dataclass(frozen=True)
class SegmentTable:
    """A published set of segment parameters.

    Attributes
    ----------
    name : str
    segments : tuple of Segment
        In the order of `COMS`.
    source : str
        Publication, with what had to be adapted.
    """

    name: str
    segments: tuple[Segment, ...]
    source: str

    @property
    def landmarks(self) -> tuple[str, ...]:
        """Marker names that the table needs, `MID_HIP` resolved into the two trochanters."""
        ends = [end for segment in self.segments for end in (segment.proximal, segment.distal)]
        resolved = [name for end in ends for name in (("L_HIP", "R_HIP") if end == MID_HIP else (end,))]
        return tuple(dict.fromkeys(resolved))


WINTER = SegmentTable(
    "winter",
    (
        Segment("thorax", "C7", "T12", 0.216, 0.82),
        Segment("abdomen", "T12", "L5", 0.139, 0.44),
        Segment("pelvis", "L5", MID_HIP, 0.142, 0.105),
    ),
    "Winter, Biomechanics and Motor Control of Human Movement, 4th ed. (2009), Table 4.1, after Dempster "
    "(1955): "
    "thorax C7/T1-T12/L1, abdomen T12/L1-L4/L5, pelvis L4/L5-greater trochanter",
)

_DE_LEVA_SOURCE = (
    "de Leva, J. Biomech. 29 (1996) 1223-1230, Table 4 ({sex}): upper trunk cervicale-xiphion, middle trunk "
    "xiphion-omphalion, lower trunk omphalion-mid-hip. Adapted: the navel (omphalion) carries no marker "
    "and is "
    "replaced by the L4/L5 marker, which lies at about its level; mid-hip is the midpoint of the greater "
    "trochanters "
    "instead of the hip joint centres. Its segments end at other heights than Winter's: compare centres, "
    "not masses"
)


def _de_leva(sex: str, masses: tuple[float, ...], coms: tuple[float, ...]) -> SegmentTable:
    ends = (("C7", "XIPHOID"), ("XIPHOID", "L5"), ("L5", MID_HIP))
    segments = tuple(
        Segment(name, *end, mass, com) for name, end, mass, com in zip(COMS, ends, masses, coms, strict=True)
    )
    return SegmentTable(f"de_leva_{sex}", segments, _DE_LEVA_SOURCE.format(sex=sex))


DE_LEVA = {
    "male": _de_leva("male", (0.1596, 0.1633, 0.1117), (0.5066, 0.4502, 0.6115)),
    "female": _de_leva("female", (0.1545, 0.1465, 0.1247), (0.5050, 0.4512, 0.4920)),
}


def segment_table(name: str, sex: str) -> SegmentTable:
    """Return a segment table by its name in the configuration.

    Parameters
    ----------
    name : {"winter", "de_leva"}
        De Leva's parameters differ between the sexes, Winter's do not.
    sex : {"female", "male", "unknown"}
        As declared in the subject's file.

    Raises
    ------
    InputError
        For an unknown table, or if the table needs a sex that is not known.
    """
    if name == "winter":
        return WINTER
    if name != "de_leva":
        raise InputError(f"lifting.segments is {name!r}; allowed: winter, de_leva")
    if sex not in DE_LEVA:
        raise InputError(
            "lifting.segments is de_leva, whose parameters differ between the sexes, but subject.sex is "
            f"{sex!r}; "
            "set female or male, or choose winter"
        )
    return DE_LEVA[sex]
