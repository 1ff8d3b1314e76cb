"""``Lift.body_model``: the same lift by one model fitted to all markers, with standard deviations and intervals."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.body_model.lift_model import DRAWS, ModelledLift, model_of_lift
from lumbar.errors import InputError
from lumbar.lifting.lift import no_deposit

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.interface.person import Lift
    from lumbar.settings.stability import StabilitySettings


@dataclass(frozen=True, eq=False, repr=False)
class LiftModel:
    """A lift by the body model.

    Attributes
    ----------
    lift : Lift
        By the rules.
    modelled : lumbar.body_model.lift_model.ModelledLift
    stability : StabilitySettings
        Of the basins.
    """

    lift: Lift
    modelled: ModelledLift
    stability: StabilitySettings

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
        from lumbar.body_model.basin_intervals import basin_intervals

        sign, pivot = self.stability.pendulum.sign, self.lift.settings.pivot
        return basin_intervals(self.modelled.pendulums, self.stability, sign, pivot)

    def save(self, folder: str | os.PathLike) -> None:
        """Write ``body_model_pendulum.csv``, ``body_model_markers.csv`` and ``body_model_areas.csv``."""
        from lumbar.files import write_csv

        for name in ("pendulum", "markers", "areas"):
            table = self.states if name == "pendulum" else getattr(self, name)
            write_csv(Path(folder) / f"body_model_{name}.csv", table.assign(data=self.lift.data))

    def __str__(self) -> str:
        lines = []
        for row in self.areas.itertuples():
            best, sd = (
                self.modelled.pendulums.states[row.com, row.plane],
                self.modelled.pendulums.sd(row.com, row.plane),
            )
            lost = f"; {row.draws_without_basin} draws without a basin" if row.draws_without_basin else ""
            lines.append(
                f"{row.com}, {row.plane}, {row.sign}: θ {best.angle.mean():+.3f} ± {sd.angle.mean():.3f} rad on average, "
                f"area {row.mean_area:.4g} rad²/s (95 %: {row.mean_area_low:.4g} to {row.mean_area_high:.4g}{lost})"
            )
        out = self.markers[self.markers.share_left_out > 0]
        lines += [
            f"{row.marker}: {row.remark or f'{100 * row.share_left_out:.0f} % of its frames are outliers'}"
            for row in out.itertuples()
        ]
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"<LiftModel of {self.lift.name}>"


def body_model(lift: Lift, stability: StabilitySettings | None = None, draws: int = DRAWS) -> LiftModel:
    """Fit the body model to the file of an analysed lift.

    Raises
    ------
    InputError
        The lift has no deposit, or its file too few markers of pelvis or thorax.
    """
    from lumbar.settings.stability import StabilitySettings

    reason = no_deposit(lift.analysed.events)
    if reason:
        raise InputError(f"{lift.name}: the body model's pendulums are those of the deposit, but {reason}")
    source = lift.analysed.complete.source
    modelled = model_of_lift(source, lift.analysed, lift.subject, lift.trial, lift.settings, draws)
    return LiftModel(lift, modelled, stability or StabilitySettings())
