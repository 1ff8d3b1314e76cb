"""The body model of one lift: fitted to the measured markers of its file, with the pendulums of the rules' deposit."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lumbar.lifting.body_model.build import at_nodes, build, measured_markers
from lumbar.lifting.body_model.fit import BodyFit, fit
from lumbar.lifting.body_model.pendulums import Conditions, ModelPendulums, model_pendulums
from lumbar.lifting.movement.events import held_frames
from lumbar.lifting.movement.lift import AnalysedLift
from lumbar.records.markers import read_markers

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.lifting import BodyModelSettings, LiftingSettings
    from lumbar.settings.subject import SubjectSettings, TrialSettings

SEED = 0
COLUMNS = (
    *("com", "plane", "time_s", "angle_rad", "angle_sd_rad"),
    *("angular_velocity_rad_s", "angular_velocity_sd_rad_s", "angular_acceleration_rad_s2"),
    *("length_m", "length_sd_m", "length_rate_m_s"),
)
"""Of the model's pendulum states."""
MARKERS = ("marker", "part", "sd_mm", "correlation", "share_left_out", "remark")
"""Of what the model made of every marker."""


@dataclass(frozen=True)
class ModelledLift:
    """A lift by the body model."""

    fit: BodyFit
    pendulums: ModelPendulums

    def states_frame(self) -> pd.DataFrame:
        """Pendulum states with standard deviations, one row per centre of mass, plane and instant."""
        import pandas as pd

        frames = [pd.DataFrame(columns=list(COLUMNS))]
        for (com, plane), states in self.pendulums.states.items():
            sd = self.pendulums.sd(com, plane)
            values = (
                *(com, plane, states.time, states.angle, sd.angle),
                *(states.angular_velocity, sd.angular_velocity, states.angular_acceleration),
                *(states.length, sd.length, states.length_rate),
            )
            frames.append(pd.DataFrame(dict(zip(COLUMNS, values, strict=True))))
        return pd.concat(frames[1:] or frames, ignore_index=True)

    def markers_frame(self) -> pd.DataFrame:
        """What the model made of every marker: its noise, how long it stays, and the share of its frames left out."""
        import pandas as pd

        rows = []
        for measurement in self.fit.model.measurements:
            if measurement.observed is None:
                continue
            noise, kept = self.fit.noise[measurement.name], self.fit.kept[measurement.name]
            seen = measurement.seen.sum()
            part = measurement.first[0] or "limb"
            rows.append((measurement.name, part, 1e3 * noise.sd, noise.phi, 1 - kept.sum() / seen, ""))
        rows += [(name, "", np.nan, np.nan, 1.0, reason) for name, reason in self.fit.model.unused.items()]
        return pd.DataFrame(rows, columns=list(MARKERS))


def model_of_lift(
    markers: str | os.PathLike,
    lift: AnalysedLift,
    subject: SubjectSettings,
    trial: TrialSettings,
    settings: LiftingSettings,
    how: BodyModelSettings,
) -> ModelledLift:
    """Fit the body model to the file of a lift that the rules have analysed.

    Events, axes and pivot are those of the rules; markers are taken from the file as measured, neither screened nor
    filled nor filtered.
    The lift has a start of deposit and a release.

    Raises
    ------
    InputError
        The file shows too few markers of pelvis or thorax, or no pivot.
    """
    bare = replace(settings.markers, aliases={}, required=None, check_axes=False)
    recording = measured_markers(read_markers(markers, bare), settings.markers.aliases)
    if trial.window_s is not None:
        inside = (recording.time >= trial.window_s[0]) & (recording.time <= trial.window_s[1])
        positions = {name: points[inside] for name, points in recording.positions.items()}
        recording = replace(recording, time=recording.time[inside], positions=positions)
    time, nodes = at_nodes(recording, how.rate_Hz)
    found = fit(build(time, nodes, subject.height_m, subject.sex, held_frames(time, lift.events)))
    conditions = Conditions(
        lift.table, subject.mass_kg, trial.box_mass_kg, lift.heading, lift.events, settings
    )
    return ModelledLift(found, model_pendulums(found, conditions, found.draws(how.draws, SEED)))
