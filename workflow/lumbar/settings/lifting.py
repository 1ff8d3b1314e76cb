"""Chapter lifting: from marker files to the pendulums of the deposit."""

from typing import Annotated, Literal

from lumbar.settings.key import UNIQUE, key, section, settings
from lumbar.settings.layout import Alias, ColumnLayout, ColumnSettings, MarkerLayout, MeanOfMarkers, columns

ALIASES: dict[str, Alias] = {
    "C7": ("C7", "CV7"),
    "T12": ("T12", "TV12"),
    "L5": ("L5", "LV5"),
    "MANUBRIUM": ("MANUBRIUM", "SJN", "SNJ", "CLAV"),
    "XIPHOID": ("XIPHOID", "SXS", "XIPH", "STRN"),
    "SACRUM": ("SACRUM", "SACR"),
    "T8": ("T8", "TV8"),
    "L_ASIS": ("L_ASIS", "LASI", "L_IAS", "LASIS"),
    "R_ASIS": ("R_ASIS", "RASI", "R_IAS", "RASIS"),
    "L_PSIS": ("L_PSIS", "LPSI", "L_IPS", "LPSIS"),
    "R_PSIS": ("R_PSIS", "RPSI", "R_IPS", "RPSIS"),
    "L_SHOULDER": ("L_SHOULDER", "L_SAJ", "LSHO"),
    "R_SHOULDER": ("R_SHOULDER", "R_SAJ", "RSHO"),
    "L_HIP": ("L_HIP", "L_FTC"),
    "R_HIP": ("R_HIP", "R_FTC"),
    "L_WRIST": ("L_WRIST", MeanOfMarkers(("LWRA", "LWRB"))),
    "R_WRIST": ("R_WRIST", MeanOfMarkers(("RWRA", "RWRB"))),
    "L_ELBOW": ("L_ELBOW", "LELB", "L_HLE"),
    "R_ELBOW": ("R_ELBOW", "RELB", "R_HLE"),
    "L_KNEE": ("L_KNEE", "LKNE", "L_FLE"),
    "R_KNEE": ("R_KNEE", "RKNE", "R_FLE"),
    "L_ANKLE": ("L_ANKLE", "L_FAL", "LANK"),
    "R_ANKLE": ("R_ANKLE", "R_FAL", "RANK"),
    "L_HEEL": ("L_HEEL", "L_FCC", "LHEE"),
    "R_HEEL": ("R_HEEL", "R_FCC", "RHEE"),
    "L_TOE": ("L_TOE", "LTOE"),
    "R_TOE": ("R_TOE", "RTOE"),
    **{f"BOX_{number}": f"BOX_{number}" for number in range(1, 9)},
}
"""Labels of usual marker sets under the standard names. STRN stands last: Plug-in Gait's is the xiphoid, other sets put it
higher on the sternum."""
RIGID_BODIES = {
    "box": tuple(f"BOX_{number}" for number in range(1, 9)),
    "pelvis": ("SACRUM", "L_ASIS", "R_ASIS", "L_PSIS", "R_PSIS"),
}
MOMENT_COLUMNS = columns(
    time=("time_s", "s", "time"),
    input=("angle_rad", "rad", "angle"),  # from the vertical
    output=("moment_Nm", "N m", "moment"),  # at the pivot, positive with the angle
) | {
    # Further columns, where they were recorded, let the diagnosis try more effects (docs/tissue/pendulum_moment.md).
    "box_held": ColumnSettings("box_held", "1", "share of the box held", optional=True),
    "length": ColumnSettings("length_m", "m", "length", optional=True),
    "pivot_acceleration_x": ColumnSettings(
        "pivot_acceleration_x_m_s2", "m/s²", "acceleration of the pivot", optional=True
    ),
    "pivot_acceleration_z": ColumnSettings(
        "pivot_acceleration_z_m_s2", "m/s²", "acceleration of the pivot", optional=True
    ),
}


@settings
class GapSettings:
    """How gaps in marker trajectories are treated."""

    maximum_s: float = key(
        "Longest gap that a cubic spline bridges; 0 bridges none.", default=0.2, within="[0, 1]"
    )
    longer: Literal["error", "keep"] = key(
        "What becomes of longer gaps and of those at the start or end: keep leaves them open, and what cannot be computed "
        "for them is left out with its reason; error refuses a recording with such a gap between the first and the last "
        "event in a marker that the pendulums need.",
        default="keep",
    )
    rigid: dict[str, tuple[str, ...]] = key(
        "Rigid bodies by name, each with its markers (standard names, or labels of the file): gaps that a spline does not "
        "bridge are filled from three or more others of the same body, with its shape in the static trial or in the frames "
        "that show all of them.",
        default=RIGID_BODIES,
    )
    rigid_tolerance_m: float = key(
        "A body whose markers differ from its shape by more than this (root mean square) is not rigid: it fills nothing.",
        default=0.02,
        within="(0, 0.1]",
    )


@settings
class FilterSettings:
    """Butterworth low-pass filter of the trajectories, forward and backward."""

    cutoff_Hz: float = key(
        "-3 dB frequency of both passes together; each pass is corrected for it.",
        default=6.0,
        within="(0, 50]",
    )
    order: int = key("Order of each pass.", default=2, within="[1, 8]")


@settings
class EventLabels:
    """Labels of events in the file (C3D, MAT) that stand for those of a lift, without regard to case and spaces."""

    lift_off: tuple[str, ...] = key("Box leaves its support.", default=("lift off", "box off", "pick up"))
    toe_off: tuple[str, ...] = key(
        "End of the lift: the first of these between lift-off and release.",
        default=("foot off", "toe off", "LTO", "RTO"),
    )
    deposit_start: tuple[str, ...] = key(
        "Start of the deposit.", default=("deposit start", "start of deposit")
    )
    release: tuple[str, ...] = key("Box is released.", default=("release", "box release", "end of deposit"))


@settings
class EventSettings:
    """How the events of a lift are found."""

    deposit_start: Literal["descent", "wrist_minimum"] = key(
        "Start of the deposit: descent, the last instant before the box goes down for good, or wrist_minimum, the last "
        "local minimum of the wrists' speed before that, as in the thesis. Table 4.1 shows the thesis's wording with its own "
        "start whatever stands here.",
        default="descent",
    )
    taken_from: Literal["detection", "file"] = key(
        "detection: by the rules below; file: those that somebody marked in the recording's own file, each that it has. The "
        "difference is told either way.",
        default="detection",
    )
    labels: EventLabels = section(default_factory=EventLabels)
    box_speed_m_s: float = key("Speed above which the box moves.", default=0.05, within="(0, 1]")
    box_rest_m_s: float = key(
        "Speed below which the box rests: its movement starts and ends there.", default=0.02, within="(0, 1]"
    )
    box_sustained_s: float = key(
        "How long the box must move for its lift-off, and the wrists be away from it for the separation.",
        default=0.1,
        within="[0, 1]",
    )
    separation_m: float = key(
        "Wrists have left the box when their distance from its centre grows by more than this.",
        default=0.1,
        within="(0, 1]",
    )
    grip_s: float = key(
        "Time after lift-off whose median distance between wrists and box counts as the grip.",
        default=0.5,
        within="(0, 5]",
    )
    toe_speed_m_s: float = key("Speed of a toe that leaves the ground.", default=0.3, within="(0, 5]")
    toe_sustained_s: float = key("How long the toe must keep that speed.", default=0.065, within="[0, 1]")
    rise_m: float = key(
        "Rise of the box that makes it lifted: before, it may slide on its support.",
        default=0.02,
        within="(0, 1]",
    )
    hands_rise_m: float = key(
        "Rise of the hands that is a lift, where there are no markers on the box and the hands stand for it.",
        default=0.25,
        within="(0, 2]",
    )
    stay_s: float = key(
        "How long the box must not go down for a stay: the deposit starts at the end of the last one, or of the last rise.",
        default=0.3,
        within="(0, 10]",
    )
    descent_m: float = key(
        "Descent of the box (of the wrists where there is none) before the release that makes it a deposit.",
        default=0.05,
        within="(0, 2]",
    )
    prominence_m_s: float = key(
        "How far a local minimum of the wrists' speed (deposit_start) must lie below its surroundings.",
        default=0.05,
        within="[0, 2]",
    )


@settings
class BoxSettings:
    """How the box in the hands loads the pendulums."""

    share: Literal["by_mass", "whole"] = key(
        "by_mass: the box is divided among the centres of mass in proportion to the segments' masses; "
        "whole: every pendulum carries the whole box.",
        default="by_mass",
    )
    in_position: bool = key(
        "true: angle and length are those of the common centre of mass of segment and box; false: of "
        "the segment alone.",
        default=False,
    )


@settings
class BodyModelSettings:
    """One body fitted to all markers of each lift, beside the rules; null leaves it out."""

    draws: int = key(
        "Draws from the posterior, of which standard deviations and intervals are made.",
        default=100,
        within="[10, 10000]",
    )
    rate_Hz: float = key(
        "Instants of the model per second at most; frames between are averaged.",
        default=50.0,
        within="[20, 500]",
    )


@settings
class LiftingSettings:
    """From marker files to the pendulums of the deposit."""

    subjects: Annotated[tuple[str, ...], UNIQUE] = key(
        "People of the study, in order: files of config/subjects.", default=()
    )
    markers: MarkerLayout = section(default_factory=MarkerLayout, aliases=ALIASES, required=())
    moment_layout: ColumnLayout = section(default_factory=ColumnLayout, columns=MOMENT_COLUMNS)
    gaps: GapSettings = section(default_factory=GapSettings)
    filter: FilterSettings = section(default_factory=FilterSettings)
    events: EventSettings = section(default_factory=EventSettings)
    segments: Literal["winter", "de_leva", "dumas"] = key(
        "Table of trunk segments: winter (Winter after Dempster, the thesis's), de_leva (1996) or dumas (Dumas and "
        "Wojtusch 2018); the last two need the subject's sex. The others stand beside the result.",
        default="winter",
    )
    segment_ends: Literal["inner", "skin"] = key(
        "Ends of the trunk's segments: inner (joint centres, estimated from the markers; where markers for that lack, "
        "the skin's, and the result says so) or skin (the markers C7, T12, L5 and the trochanters, as in the thesis). Table 4.1 "
        "shows the thesis's wording with its own ends whatever stands here.",
        default="inner",
    )
    hip_centres: Literal["harrington", "hara", "reed"] = key(
        "Regression of the hip joint centres: harrington (2007), hara (2016; leg from ASIS to ankle) or reed (1999).",
        default="harrington",
    )
    box: BoxSettings = section(default_factory=BoxSettings)
    pivot: Literal["mid_ankle", "hip", "L5"] = key(
        "Pivot of the pendulum: midpoint of the ankles, midpoint of the hips, or L5/S1; with segment_ends: skin the "
        "trochanters and the marker L5. It moves with its markers.",
        default="mid_ankle",
    )
    frame: Literal["laboratory", "pelvis"] = key(
        "Axes of the planes: the laboratory's, or turned about the vertical so that x is the line of "
        "the hips at the start of the deposit.",
        default="laboratory",
    )
    points: int = key(
        "Instants to which the deposit is resampled by a cubic spline (the real time is kept).",
        default=1000,
        within="[10, 100000]",
    )
    body_model: BodyModelSettings | None = key(
        "One body fitted to all markers of each lift, beside the rules: pendulum states with standard deviations, basin areas "
        "with 95 % intervals; null leaves it out.",
        default=None,
    )
