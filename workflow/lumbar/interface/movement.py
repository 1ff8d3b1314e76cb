"""``lumbar.measure_movement``: balance over the feet, posture of the trunk, and load of the back during a lift."""

import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lumbar.base.errors import InputError, LumbarError
from lumbar.base.files import read_json
from lumbar.interface.lift import Lift, lift
from lumbar.interface.result import UNKNOWN_SOURCE, Result, read_table
from lumbar.lifting.measures.course import Course, Lifter, course_of_lift
from lumbar.lifting.measures.lift_values import MEASURES, WINDOWS, values_of_lift
from lumbar.settings.lifting import ALIASES, LiftingSettings, SubjectSettings, TrialSettings
from lumbar.settings.stability import StabilitySettings


def measure_movement(
    lift: Lift | str | os.PathLike,
    *,
    facts: Mapping | None = None,
    settings: StabilitySettings | None = None,
    source_label: str = "",
) -> "Measures":
    """Compute the measures of one lift that depend on its movement: balance over the feet, posture, moment about L5/S1.

    Parameters
    ----------
    lift : Lift or path
        Of `lift`, or a file ``body.csv``.
    facts : mapping, optional
        Masses, stature and missing points for a file; default ``pendulum.json`` next to it.
    settings : StabilitySettings, optional
        ``measures``, and gravity of ``pendulum``.
    source_label : str
        Label of the data's source; default that of the lift.

    Raises
    ------
    InputError
        If a file is not what `lift` writes.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.twin.examples import example_lift
    >>> lift = lumbar.lift("lift.c3d", example_lift("lift.c3d"), box_mass_kg=15)
    >>> print(lumbar.measure_movement(lift))
    l5s1_moment_peak_carried: 160 N·m (lower is safer; from lift-off to release, or as far of it as was recorded)
    lumbar_flexion_peak_carried: 32.5 ° (lower is safer; from lift-off to release, or as far of it as was recorded)
    margin_of_stability: 0.0035 m (higher is safer; from the start of the deposit to the release)
    smallest_impulse: 1.1 N·s (higher is safer; from the start of the deposit to the release)
    """
    settings = settings or StabilitySettings()
    if isinstance(lift, Lift):
        return Measures(lift.body, lift.facts, settings, source_label or lift.source_label)
    body, facts = _read_body(Path(lift), facts)
    return Measures(body, facts, settings, source_label or facts.get("data", UNKNOWN_SOURCE))


def _read_body(path: Path, facts: Mapping | None) -> tuple[pd.DataFrame, Mapping]:
    facts = facts or read_json(path.with_name("pendulum.json"))
    body = read_table(path, "a body's trajectories")
    lacking = [name for name in ("time_s", "phase", "load_held", "RIGHT_x") if name not in body]
    if lacking or "missing_points" not in facts:
        raise InputError(
            f"{path}: no columns {', '.join(lacking)}; a body.csv with its pendulum.json, as lumbar lift writes them, is needed"
        )
    return body, facts


@dataclass(frozen=True, eq=False, repr=False)
class Measures(Result):
    """Measures of one lift."""

    body: pd.DataFrame
    """Trajectories they are made of."""
    facts: Mapping
    settings: StabilitySettings
    source_label: str

    @cached_property
    def course(self) -> Course:
        """All measures at every instant, and what is missing."""
        gravity = self.settings.pendulum.gravity_m_s2
        return course_of_lift(Lifter(self.body, self.facts, self.settings.measures, gravity))

    @property
    def instants(self) -> pd.DataFrame:
        """All measures at every instant of the recording."""
        return self.course.frame

    @cached_property
    def values(self) -> pd.DataFrame:
        """One row per measure and plane: value, unit, safer direction, source, or the reason for an absent value."""
        return values_of_lift(self.course, self.facts)

    @property
    def table(self) -> pd.DataFrame:
        """The measures' `values`."""
        return self.values

    def files(self) -> Iterator[tuple[str, Any]]:
        """``movement_measures.csv`` (the values) and ``movement_course.csv`` (every instant)."""
        yield "movement_measures.csv", self.values.assign(data=self.source_label)
        yield "movement_course.csv", self.instants.assign(data=self.source_label)

    def __str__(self) -> str:
        named = self.values[self.values["measure"].map(lambda name: MEASURES[name].headline)]
        lines: list[str] = []
        absent: dict[str, list[str]] = {}
        for row in named.drop_duplicates("measure").itertuples():
            if row.reason:
                absent.setdefault(row.reason, []).append(row.measure)
                continue
            phase = WINDOWS[MEASURES[row.measure].phase]
            lines.append(f"{row.measure}: {row.value:.3g} {row.unit} ({row.safer} is safer; {phase})")
        lines += [f"{', '.join(measures)}: none ({reason})" for reason, measures in absent.items()]
        unfilled = sorted(
            {name for name in ALIASES for reason in absent if name in re.findall(r"\w+", reason)}
        )
        if unfilled:
            lines.append(
                f"if the file has {', '.join(unfilled)}, name their labels in lifting.markers.aliases"
            )
        return "\n".join([*lines, *self.course.notes])

    def __repr__(self) -> str:
        return f"<Measures of {self.facts['lift']}>"


COLUMNS = (
    *("lift", "person", "box_mass_kg", "trial"),
    *("measure", "plane", "value", "unit", "safer", "source", "reason"),
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
    source_label: str = "",
) -> pd.DataFrame:
    """Measure every lift of a subject: balance, posture, load of the back, and areas of the basins with either sign.

    The long table has the columns `COLUMNS`; an absent value is NaN and has a reason.

    Parameters
    ----------
    markers : mapping of str to path
        Marker file of every lift.
    trials : mapping of str to TrialSettings
        Trials by the same names.
    static : path, optional
        Marker file of a static trial.
    source_label : str
        Label of the data's source.
    """
    found: dict[str, Lift] = {}
    frames: dict[str, pd.DataFrame] = {}
    for name, path in markers.items():
        try:
            one = lift(
                path,
                subject,
                trial=trials[name],
                name=name,
                settings=lifting,
                static=static,
                source_label=source_label,
            )
            frames[name] = measure_movement(one, settings=stability).values
            found[name] = one
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
    """Return average cross-sections of the basins (exact method) of some lifts, with both signs of gravity."""
    from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels
    from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import close_loops
    from lumbar.lifting.stability.model.pendulum_trajectories import (
        Trajectory,
        compute_together,
        trajectories_of_lift,
    )

    sound: list[tuple[str, Trajectory]] = []
    rows: list[tuple] = []
    for name, found in lifts.items():
        trajectories, failures = trajectories_of_lift(found.states, found.facts, settings.pendulum.mass)
        sound += [(name, item) for item in trajectories]
        rows += [(name, item, ABSENT, item.reason) for item in failures]
    computed: dict[Trajectory, np.ndarray] = {}
    fewer = settings.model_copy(update={"knots": settings.fewer_knots})

    def areas_of_signs(items: list[Trajectory]) -> np.ndarray:
        loops = close_loops(items * len(SIGNS), [sign for sign in SIGNS for _ in items], fewer)
        return exact_funnels(loops, settings.goal_level).mean_area.reshape(len(SIGNS), len(items)).T

    every = [item for _, item in sound]
    for items, of_signs in compute_together(areas_of_signs, every, "exact, both signs", []):
        computed |= zip(items, of_signs, strict=True)
    for name, item in sound:
        areas = computed.get(item)
        rows.append((name, item, ABSENT, NO_BASIN) if areas is None else (name, item, areas, ""))
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
    """Return the rows of all measures of a lift that could not be analysed."""
    from lumbar.lifting.stability.model.pendulum_trajectories import COMS, PLANES

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
