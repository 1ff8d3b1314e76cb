"""All measures of every lift of one person, from marker files to a long table."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from lumbar.errors import LumbarError

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.interface.person import Lift
    from lumbar.settings.lifting import LiftingSettings
    from lumbar.settings.stability import StabilitySettings
    from lumbar.settings.subject import SubjectSettings, TrialSettings

COLUMNS = (
    "lift",
    "person",
    "box_mass_kg",
    "trial",
    "measure",
    "plane",
    "value",
    "unit",
    "safer",
    "source",
    "reason",
)
BASIN_SOURCE = "lumbar.stability: exact funnel of Eq. 4.1 with the regulator of the configuration"


def measure_person(
    markers: Mapping[str, str | os.PathLike],
    trials: Mapping[str, TrialSettings],
    subject: SubjectSettings,
    lifting: LiftingSettings,
    stability: StabilitySettings,
    *,
    static: str | os.PathLike | None = None,
    data: str = "",
) -> pd.DataFrame:
    """Measure every lift of a person: balance, posture, load of the back, and areas of the basins with either sign.

    Parameters
    ----------
    markers : mapping of str to path
        Marker file of every lift.
    trials : mapping of str to TrialSettings
        By the same names.
    subject : SubjectSettings
    lifting : LiftingSettings
    stability : StabilitySettings
    static : path, optional
        Marker file of a static trial.
    data : str
        Words for the source of the data.

    Returns
    -------
    pandas.DataFrame
        Long, columns `COLUMNS`; a value that is absent is NaN, and the reason says why.
    """
    import pandas as pd

    from lumbar.interface.person import lift

    counted: Counter = Counter()
    frames = []
    for name, path in markers.items():
        trial = trials[name]
        counted[trial.box_mass_kg] += 1
        try:
            found = lift(
                path,
                subject,
                trial.box_mass_kg,
                trial=trial,
                name=name,
                settings=lifting,
                static=static,
                data=data,
            )
            values = _values(found, stability)
        except LumbarError as error:
            values = _unmeasured(str(error))
        frames.append(
            values.assign(
                lift=name,
                person=subject.name,
                box_mass_kg=trial.box_mass_kg,
                trial=counted[trial.box_mass_kg],
            )
        )
    return pd.concat(frames, ignore_index=True)[list(COLUMNS)]


def _values(found: Lift, settings: StabilitySettings) -> pd.DataFrame:
    import pandas as pd

    from lumbar.interface.movement import measure_movement

    return pd.concat(
        [measure_movement(found, settings=settings).values, _basin_areas(found, settings)], ignore_index=True
    )


def _basin_areas(found: Lift, settings: StabilitySettings) -> pd.DataFrame:
    """Average cross-sections of the basins (exact method), both signs of gravity."""
    import pandas as pd

    from lumbar.stability.comparison.percent_differences import varied_areas
    from lumbar.stability.model.failures import all_or_each
    from lumbar.stability.model.lift_trajectories import trajectories_of_lift

    trajectories, failures = trajectories_of_lift(found.states, found.facts, settings.pendulum.mass)
    rows = []
    for sign in ("inverted", "hanging"):
        signed = replace(settings, pendulum=replace(settings.pendulum, sign=sign))
        results, failed = all_or_each(
            lambda items, own=signed: varied_areas(items, own, ["base"])["base"], trajectories, basin=sign
        )
        rows += [
            (f"basin_area_{item.com}_{sign}", item.plane, area, "")
            for items, areas in results
            for item, area in zip(items, areas, strict=True)
        ]
        rows += [
            (f"basin_area_{item.com}_{sign}", item.plane, float("nan"), item.reason)
            for item in (*failures, *failed)
        ]
    frame = pd.DataFrame(rows, columns=["measure", "plane", "value", "reason"])
    return frame.assign(unit="rad²/s", safer="higher", source=BASIN_SOURCE)


def _unmeasured(reason: str) -> pd.DataFrame:
    """Rows of all measures of a lift that could not be analysed."""
    import pandas as pd

    from lumbar.measures.registry import MEASURES
    from lumbar.stability.model.trajectory import COMS, PLANES

    rows = [
        (measure.name, plane, measure.unit, measure.safer, measure.source)
        for measure in MEASURES.values()
        for plane in measure.columns
    ]
    rows += [
        (f"basin_area_{com}_{sign}", plane, "rad²/s", "higher", BASIN_SOURCE)
        for sign in ("inverted", "hanging")
        for com in COMS
        for plane in PLANES
    ]
    frame = pd.DataFrame(rows, columns=["measure", "plane", "unit", "safer", "source"])
    return frame.assign(value=float("nan"), reason=reason)
