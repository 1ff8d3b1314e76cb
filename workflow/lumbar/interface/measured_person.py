"""All measures of every lift of one person, from marker files to a long table."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from lumbar.base.errors import LumbarError

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd

    from lumbar.interface.person import Lift
    from lumbar.lifting.stability.model.trajectories import Trajectory
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
SIGNS = ("inverted", "hanging")
ABSENT = (float("nan"),) * len(SIGNS)
NO_BASIN = "no basin with one of the signs"
BASIN_SOURCE = "lumbar.lifting.stability: exact funnel of Eq. 4.1 with the regulator of the configuration"


def measure_person(
    markers: Mapping[str, str | os.PathLike],
    trials: Mapping[str, TrialSettings],
    subject: SubjectSettings,
    lifting: LiftingSettings,
    stability: StabilitySettings,
    *,
    static: str | os.PathLike | None = None,
    data: str = "",
    each: Callable[[Lift], object] | None = None,
) -> pd.DataFrame:
    """Measure every lift of a person: balance, posture, load of the back, and areas of the basins with either sign.

    Parameters
    ----------
    markers : mapping of str to path
        Marker file of every lift.
    trials : mapping of str to TrialSettings
        By the same names.
    static : path, optional
        Marker file of a static trial.
    data : str
        Words for the source of the data.
    each : callable, optional
        Called with every lift that could be analysed.

    Returns
    -------
    pandas.DataFrame
        Long, columns `COLUMNS`; a value that is absent is NaN, and the reason says why.
    """
    import pandas as pd

    from lumbar.interface.movement import measure_movement
    from lumbar.interface.person import lift

    found: dict[str, Lift] = {}
    frames: dict[str, pd.DataFrame] = {}
    for name, path in markers.items():
        try:
            one = lift(
                path, subject, trial=trials[name], name=name, settings=lifting, static=static, data=data
            )
            frames[name] = measure_movement(one, settings=stability).values
            found[name] = one
            if each is not None:
                each(one)
        except LumbarError as error:
            frames[name] = _unmeasured(str(error))
    areas = _basin_areas(found, stability)
    counted: Counter = Counter()
    tables = []
    for name, values in frames.items():
        mass = trials[name].box_mass_kg
        counted[mass] += 1
        table = pd.concat([values, areas[areas["lift"] == name]], ignore_index=True)
        tables.append(table.assign(lift=name, person=subject.name, box_mass_kg=mass, trial=counted[mass]))
    return pd.concat(tables, ignore_index=True)[list(COLUMNS)]


def _basin_areas(lifts: Mapping[str, Lift], settings: StabilitySettings) -> pd.DataFrame:
    """Average cross-sections of the basins (exact method) of some lifts, with both signs of gravity."""
    import pandas as pd

    from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels
    from lumbar.lifting.stability.model.eq_4_2_regulator import close_loops
    from lumbar.lifting.stability.model.failures import attempts
    from lumbar.lifting.stability.model.trajectories import trajectories_of_lift

    sound: list[tuple[str, Trajectory]] = []
    rows: list[tuple] = []
    for name, found in lifts.items():
        trajectories, failures = trajectories_of_lift(found.states, found.facts, settings.pendulum.mass)
        sound += [(name, item) for item in trajectories]
        rows += [(name, item, ABSENT, item.reason) for item in failures]
    computed: dict[int, np.ndarray] = {}
    fewer = replace(settings, knots=settings.limits.knots)
    for attempt in attempts([item for _, item in sound], "exact, both signs", []):
        with attempt as items:
            loops = close_loops(items * len(SIGNS), [sign for sign in SIGNS for _ in items], fewer)
            areas = exact_funnels(loops, settings.goal_level).mean_area.reshape(len(SIGNS), len(items))
            computed |= zip(map(id, items), areas.T, strict=True)
    for name, item in sound:
        found = computed.get(id(item))
        rows.append((name, item, ABSENT, NO_BASIN) if found is None else (name, item, found, ""))
    frame = pd.DataFrame(
        [
            (name, f"basin_area_{item.com}_{sign}", item.plane, area, reason)
            for name, item, areas, reason in rows
            for sign, area in zip(SIGNS, areas, strict=True)
        ],
        columns=["lift", "measure", "plane", "value", "reason"],
    )
    return frame.assign(unit="rad²/s", safer="higher", source=BASIN_SOURCE)


def _unmeasured(reason: str) -> pd.DataFrame:
    """Rows of all measures of a lift that could not be analysed."""
    import pandas as pd

    from lumbar.lifting.measures.registry import MEASURES
    from lumbar.lifting.stability.model.trajectories import COMS, PLANES

    rows = [
        (measure.name, plane, measure.unit, measure.safer, measure.source)
        for measure in MEASURES.values()
        for plane in measure.columns
    ]
    rows += [
        (f"basin_area_{com}_{sign}", plane, "rad²/s", "higher", BASIN_SOURCE)
        for sign in SIGNS
        for com in COMS
        for plane in PLANES
    ]
    frame = pd.DataFrame(rows, columns=["measure", "plane", "unit", "safer", "source"])
    return frame.assign(value=float("nan"), reason=reason)
