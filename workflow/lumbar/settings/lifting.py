"""Chapter lifting: from marker files to the pendulums of the deposit."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from lumbar.base.yaml_file import shipped_yaml
from lumbar.settings.key import UNIQUE, key, section, settings
from lumbar.settings.layout import Alias, ColumnLayout, ColumnSettings, MarkerLayout, MeanOfMarkers
from lumbar.settings.subject import TrialSettings

ALIASES: dict[str, Alias] = {
    **{
        name: tuple(
            MeanOfMarkers(tuple(label["mean"])) if isinstance(label, dict) else label for label in labels
        )
        for name, labels in shipped_yaml(Path(__file__).parent / "labels" / "aliases.yaml").items()
    },
    **{f"BOX_{number}": f"BOX_{number}" for number in range(1, 9)},
}
"""Labels of usual marker sets under the standard names."""
REFINING = tuple(name for name in ALIASES if name.endswith(("_MEDIAL", "HEAD_CENTRE")))
"""Markers that nothing misses where they lack."""
RIGID_BODIES = {
    "box": tuple(f"BOX_{number}" for number in range(1, 9)),
    "pelvis": ("SACRUM", "L_ASIS", "R_ASIS", "L_PSIS", "R_PSIS"),
}
MOMENT_COLUMNS = {
    role: ColumnSettings(**said)
    for role, said in shipped_yaml(Path(__file__).parent / "labels" / "moment_columns.yaml").items()
}


@settings
class GapSettings:
    """How gaps in marker trajectories are treated."""

    maximum_s: float = key(default=0.2, within="[0, 1]")
    longer: Literal["error", "keep"] = key(default="keep")
    rigid: dict[str, tuple[str, ...]] = key(default=RIGID_BODIES)
    rigid_tolerance_m: float = key(default=0.02, within="(0, 0.1]")


@settings
class FilterSettings:
    """Butterworth low-pass filter of the trajectories, forward and backward."""

    cutoff_Hz: float = key(default=6.0, within="(0, 50]")
    order: int = key(default=2, within="[1, 8]")


@settings
class EventLabels:
    """Labels of events in the file (C3D) that stand for those of a lift, without regard to case and spaces."""

    lift_off: tuple[str, ...] = key(default=("lift off", "box off", "pick up"))
    toe_off: tuple[str, ...] = key(default=("foot off", "toe off", "LTO", "RTO"))
    deposit_start: tuple[str, ...] = key(default=("deposit start", "start of deposit"))
    release: tuple[str, ...] = key(default=("release", "box release", "end of deposit"))


@settings
class EventSettings:
    """How the events of a lift are found."""

    deposit_start: Literal["descent", "wrist_minimum"] = key(default="descent")
    taken_from: Literal["detection", "file"] = key(default="detection")
    labels: EventLabels = section(default_factory=EventLabels)
    box_speed_m_s: float = key(default=0.05, within="(0, 1]")
    box_rest_m_s: float = key(default=0.02, within="(0, 1]")
    box_sustained_s: float = key(default=0.1, within="[0, 1]")
    separation_m: float = key(default=0.1, within="(0, 1]")
    grip_s: float = key(default=0.5, within="(0, 5]")
    toe_speed_m_s: float = key(default=0.3, within="(0, 5]")
    toe_sustained_s: float = key(default=0.065, within="[0, 1]")
    rise_m: float = key(default=0.02, within="(0, 1]")
    hands_rise_m: float = key(default=0.25, within="(0, 2]")
    stay_s: float = key(default=0.3, within="(0, 10]")
    descent_m: float = key(default=0.05, within="(0, 2]")
    prominence_m_s: float = key(default=0.05, within="[0, 2]")


@settings
class BoxSettings:
    """How the box in the hands loads the pendulums."""

    share: Literal["by_mass", "whole"] = key(default="by_mass")
    in_position: bool = key(default=False)


@settings
class LiftingSettings:
    """From marker files to the pendulums of the deposit."""

    subjects: Annotated[tuple[str, ...], UNIQUE] = key(default=())
    markers: MarkerLayout = section(default_factory=MarkerLayout, aliases=ALIASES, required=())
    moment_layout: ColumnLayout = section(default_factory=ColumnLayout, columns=MOMENT_COLUMNS)
    gaps: GapSettings = section(default_factory=GapSettings)
    filter: FilterSettings = section(default_factory=FilterSettings)
    events: EventSettings = section(default_factory=EventSettings)
    segments: Literal["winter", "de_leva", "dumas"] = key(default="winter")
    segment_ends: Literal["inner", "skin"] = key(default="inner")
    hip_centres: Literal["harrington", "hara", "reed"] = key(default="harrington")
    box: BoxSettings = section(default_factory=BoxSettings)
    pivot: Literal["mid_ankle", "hip", "L5"] = key(default="mid_ankle")
    frame: Literal["laboratory", "pelvis"] = key(default="laboratory")
    points: int = key(default=1000, within="[10, 100000]")

    def of_trial(self, trial: TrialSettings) -> "LiftingSettings":
        """These settings with the axis that the person faces in a trial."""
        forward = trial.forward or self.markers.forward
        return replace(self, markers=replace(self.markers, forward=forward))
