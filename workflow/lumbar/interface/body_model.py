"""``Lift.body_model``: the same lift by one model fitted to all markers, with standard deviations and intervals."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lumbar.base.errors import InputError
from lumbar.base.files import write_csv
from lumbar.interface.verb import Result
from lumbar.lifting.body_model.pendulums import COLUMNS as AREAS
from lumbar.lifting.body_model.pendulums import MARKERS, ModelledLift, basin_intervals, model_of_lift
from lumbar.lifting.body_model.pendulums import STATE_COLUMNS as STATES
from lumbar.lifting.movement.lift import AnalysedLift, no_deposit
from lumbar.settings.lifting import BodyModelSettings, LiftingSettings
from lumbar.settings.stability import StabilitySettings
from lumbar.settings.subject import SubjectSettings, TrialSettings


@dataclass(frozen=True, eq=False, repr=False)
class LiftModel(Result):
    """A lift by the body model."""

    shown = "areas"
    name: str
    data: str
    """`name`, `data`: of the lift, and words for the source of its data."""
    pivot: str
    modelled: ModelledLift
    stability: StabilitySettings
    """Of the basins."""

    @cached_property
    def states(self) -> pd.DataFrame:
        """Pendulum states with standard deviations: one row per centre of mass, plane and instant."""
        return self.modelled.states_frame()

    @cached_property
    def markers(self) -> pd.DataFrame:
        """Part, noise and left-out frames of every marker."""
        return self.modelled.markers_frame()

    @cached_property
    def areas(self) -> pd.DataFrame:
        """Exact mean basin area of every pendulum with its 95 % interval, by the study's sign of gravity."""
        sign = self.stability.pendulum.sign
        return basin_intervals(self.modelled.pendulums, self.stability, sign, self.pivot)

    def files(self) -> Iterator[tuple[str, Any]]:
        """``body_model_pendulum.csv``, ``body_model_markers.csv`` and ``body_model_areas.csv``."""
        tables = {"pendulum": self.states, "markers": self.markers, "areas": self.areas}
        for name, table in tables.items():
            yield f"body_model_{name}.csv", table.assign(data=self.data)

    def __str__(self) -> str:
        lines = []
        for row in self.areas.itertuples():
            best, sd = (
                self.modelled.pendulums.states[row.com, row.plane],
                self.modelled.pendulums.sd[row.com, row.plane],
            )
            area = (
                f"area {row.mean_area:.4g} rad²/s (95 %: {row.mean_area_low:.4g} to {row.mean_area_high:.4g}"
            )
            if np.isnan(row.mean_area):
                area = f"no basin ({100 * row.no_basin_share:.0f} % of what is possible has none)"
            elif row.draws_without_basin:
                area += (
                    f" where there is a basin; none with a probability of {100 * row.no_basin_share:.0f} %)"
                )
            else:
                area += ")"
            lines.append(
                f"{row.com}, {row.plane}, {row.sign}: θ {best.angle.mean():+.3f} ± {sd.angle.mean():.3f} rad on average, {area}"
            )
        for row in self.markers[self.markers.share_left_out.between(0, 1, inclusive="neither")].itertuples():
            lines.append(f"{row.marker}: {100 * row.share_left_out:.0f} % of its frames are outliers")
        for reason, rows in self.markers[self.markers.remark != ""].groupby("remark"):
            lines.append(f"not used, {reason}: {', '.join(rows.marker)}")
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"<LiftModel of {self.name}>"


def body_model(
    analysed: AnalysedLift,
    subject: SubjectSettings,
    trial: TrialSettings,
    settings: LiftingSettings,
    data: str = "",
    stability: StabilitySettings | None = None,
) -> LiftModel:
    """Fit the body model to the file of an analysed lift, as ``lifting.body_model`` says or by its defaults.

    Raises
    ------
    InputError
        The lift has no deposit, or its file too few markers of pelvis or thorax.
    """
    reason = no_deposit(analysed.events)
    if reason:
        raise InputError(
            f"{analysed.name}: the body model's pendulums are those of the deposit, but {reason}"
        )
    how = settings.body_model or BodyModelSettings()
    modelled = model_of_lift(analysed.complete.source, analysed, subject, trial, settings, how)
    return LiftModel(analysed.name, data, settings.pivot, modelled, stability or StabilitySettings())


def save_without_model(folder: str | os.PathLike) -> None:
    """Write the tables of a lift that has no body model: columns without rows."""
    for name, columns in {"pendulum": STATES, "markers": MARKERS, "areas": AREAS}.items():
        write_csv(Path(folder) / f"body_model_{name}.csv", pd.DataFrame(columns=[*columns, "data"]))
