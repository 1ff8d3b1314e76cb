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
from lumbar.settings.lifting import (
    ALIASES,
    LiftingSettings,
    StabilitySettings,
    SubjectSettings,
    TrialSettings,
)


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
        Result of `lift`, or a file ``body.csv``.
    facts : mapping, optional
        Masses, stature and missing points for a file; default ``pendulum.json`` next to it.
    settings : StabilitySettings, optional
        ``measures``, and gravity of ``pendulum``.
    source_label : str
        Name of the source of the data; default the source of the lift.

    Raises
    ------
    InputError
        If `lift` did not write the file.

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
    facts = facts or read_json(Path(lift).with_name("pendulum.json"))
    body = read_table(lift, "a body's trajectories")
    missing = [name for name in ("time_s", "phase", "load_held", "RIGHT_x") if name not in body]
    if missing or "missing_points" not in facts:
        columns = f"no columns {', '.join(missing)}; " if missing else ""
        raise InputError(
            f"{lift}: {columns}body.csv and pendulum.json as 'lumbar lift' writes them are needed"
        )
    return Measures(body, facts, settings, source_label or facts.get("data", UNKNOWN_SOURCE))


@dataclass(frozen=True, eq=False, repr=False)
class Measures(Result):
    """Measures of one lift."""

    body: pd.DataFrame
    """Trajectories from which the measures are computed."""
    facts: Mapping
    settings: StabilitySettings
    source_label: str

    @cached_property
    def course(self) -> Course:
        """Measures at every instant, and missing points."""
        gravity = self.settings.pendulum.gravity_m_s2
        return course_of_lift(Lifter(self.body, self.facts, self.settings.measures, gravity))

    @property
    def instants(self) -> pd.DataFrame:
        """Table of all measures at every instant of the recording."""
        return self.course.frame

    @cached_property
    def values(self) -> pd.DataFrame:
        """Table with one row per measure and plane: value or reason for its absence, unit, safer direction, source."""
        return values_of_lift(self.course, self.facts)

    @property
    def table(self) -> pd.DataFrame:
        """The measures' `values`."""
        return self.values

    def files(self) -> Iterator[tuple[str, Any]]:
        """Yield ``movement_measures.csv`` (the values) and ``movement_course.csv`` (every instant)."""
        yield "movement_measures.csv", self.values.assign(data=self.source_label)
        yield "movement_course.csv", self.instants.assign(data=self.source_label)

    def __str__(self) -> str:
        headlines = self.values[self.values["measure"].map(lambda name: MEASURES[name].headline)]
        lines: list[str] = []
        absent: dict[str, list[str]] = {}
        for row in headlines.drop_duplicates("measure").itertuples():
            if row.reason:
                absent.setdefault(row.reason, []).append(row.measure)
                continue
            phase = WINDOWS[MEASURES[row.measure].phase]
            lines.append(f"{row.measure}: {row.value:.3g} {row.unit} ({row.safer} is safer; {phase})")
        lines += [f"{', '.join(measures)}: none ({reason})" for reason, measures in absent.items()]
        named = {name for reason in absent for name in re.findall(r"\w+", reason)}
        unfilled = ", ".join(sorted(named & set(ALIASES)))
        if unfilled:
            lines.append(f"if the file has {unfilled}, name their labels in lifting.markers.aliases")
        return "\n".join([*lines, *self.course.notes])

    def __repr__(self) -> str:
        return f"<Measures of {self.facts['lift']}>"


COLUMNS = (
    *("lift", "person", "box_mass_kg", "trial"),
    *("measure", "plane", "value", "unit", "safer", "source", "reason"),
)
SIGNS = ("inverted", "hanging")
BASIN_SOURCE = "lumbar.lifting.stability: exact funnel of Eq. 4.1 with the regulator of the configuration"


def measure_person(
    recordings: Mapping[str, tuple[str | os.PathLike, TrialSettings]],
    subject: SubjectSettings,
    lifting: LiftingSettings,
    stability: StabilitySettings,
    *,
    static: str | os.PathLike | None = None,
    source_label: str = "",
) -> pd.DataFrame:
    """Measure every lift of a subject: balance, posture, load of the back, and areas of the basins with both signs of gravity.

    The long table has the columns `COLUMNS`; an absent value is NaN and has a reason.

    Parameters
    ----------
    recordings : mapping of str to tuple (path, TrialSettings)
        Marker file and trial of every lift by its name.
    subject, lifting, stability
        Settings of the subject, of the pipeline, and of pendulum and measures.
    static : path, optional
        Marker file of a static trial.
    source_label : str
        Name of the source of the data.
    """
    lifts: dict[str, Lift] = {}
    frames: dict[str, pd.DataFrame] = {}
    common: dict[str, Any] = {"settings": lifting, "static": static, "source_label": source_label}
    for name, (path, trial) in recordings.items():
        try:
            analysed = lift(path, subject, trial=trial, name=name, **common)
            frames[name] = measure_movement(analysed, settings=stability).values
            lifts[name] = analysed
        except LumbarError as error:
            frames[name] = _missing_measures(str(error))
    areas = _basin_areas(lifts, stability)
    counts: Counter = Counter()
    tables = []
    for name, values in frames.items():
        mass = recordings[name][1].box_mass_kg
        counts[mass] += 1
        table = pd.concat([values, areas[areas["lift"] == name]], ignore_index=True)
        tables.append(table.assign(lift=name, person=subject.name, box_mass_kg=mass, trial=counts[mass]))
    return pd.concat(tables, ignore_index=True)[list(COLUMNS)]


def _basin_areas(lifts: Mapping[str, Lift], settings: StabilitySettings) -> pd.DataFrame:
    """Return average cross-sections of the basins (exact method) of some lifts, with both signs of gravity."""
    from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels
    from lumbar.lifting.stability.model import pendulum_trajectories as pendulums
    from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import close_loops

    items: list[tuple[str, Any]] = []
    for name, analysed in lifts.items():
        mass = settings.pendulum.mass
        trajectories, failures = pendulums.trajectories_of_lift(analysed.states, analysed.facts, mass)
        items += [(name, item) for item in (*failures, *trajectories)]
    fewer = settings.model_copy(update={"knots": settings.fewer_knots})

    def areas_by_sign(some: list[pendulums.Trajectory]) -> np.ndarray:
        loops = close_loops(some * len(SIGNS), [sign for sign in SIGNS for _ in some], fewer)
        return exact_funnels(loops, settings.goal_level).mean_area.reshape(len(SIGNS), len(some)).T

    every = [item for _, item in items if isinstance(item, pendulums.Trajectory)]
    computed: dict[Any, np.ndarray] = {}
    for some, areas in pendulums.compute_together(areas_by_sign, every, "exact, both signs", []):
        computed |= zip(some, areas, strict=True)
    rows = []
    for name, item in items:
        areas = computed.get(item, np.full(len(SIGNS), np.nan))
        reason = "" if item in computed else getattr(item, "reason", "no basin with one of the signs")
        for sign, area in zip(SIGNS, areas, strict=True):
            rows.append((name, f"basin_area_{item.com}_{sign}", item.plane, area, reason))
    frame = pd.DataFrame(rows, columns=["lift", "measure", "plane", "value", "reason"])
    return frame.assign(unit="rad²/s", safer="higher", source=BASIN_SOURCE)


def _missing_measures(reason: str) -> pd.DataFrame:
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
