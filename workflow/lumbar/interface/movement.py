"""``lumbar.measure_movement``: how near a lift comes to a step, how the trunk is bent, and what the back carries."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lumbar.base.errors import InputError
from lumbar.interface.data_label import NOT_SAID
from lumbar.interface.person import Lift
from lumbar.interface.result import Result
from lumbar.settings.stability import StabilitySettings

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.lifting.measures.course import Course


def measure_movement(
    lift: Lift | str | os.PathLike,
    *,
    facts: Mapping | None = None,
    settings: StabilitySettings | None = None,
    data: str = "",
) -> Measures:
    """Compute the measures of one lift that see its movement: balance over the feet, posture, moment about L5/S1.

    Parameters
    ----------
    lift : Lift or path
        Of `lift`, or a file ``body.csv``.
    facts : mapping, optional
        With a file: masses, stature and what is missing; default ``pendulum.json`` beside it.
    settings : StabilitySettings, optional
        ``measures``, and gravity of ``pendulum``.
    data : str
        Words for the source of the data; default those of the lift.

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
    margin_of_stability: 0.0035 m (higher is safer)
    smallest_impulse: 1.1 N·s (higher is safer)
    lumbar_flexion_peak: 14.8 ° (lower is safer)
    l5s1_moment_peak: 133 N·m (lower is safer)
    """
    settings = settings or StabilitySettings()
    if isinstance(lift, Lift):
        return Measures(lift.body, lift.facts, settings, data or lift.data)
    body, facts = _read_body(Path(lift), facts)
    return Measures(body, facts, settings, data or facts.get("data", NOT_SAID))


def _read_body(path: Path, facts: Mapping | None) -> tuple[pd.DataFrame, Mapping]:
    import pandas as pd

    from lumbar.base.files import read_json

    facts = facts or read_json(path.with_name("pendulum.json"))
    try:
        body = pd.read_csv(path)
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a table of a body's trajectories ({error})") from error
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
    data: str

    @cached_property
    def course(self) -> Course:
        """All measures at every instant, and what is missing."""
        from lumbar.lifting.measures.course import Lifter, course_of_lift

        gravity = self.settings.pendulum.gravity_m_s2
        return course_of_lift(Lifter(self.body, self.facts, self.settings.measures, gravity))

    @property
    def instants(self) -> pd.DataFrame:
        """All measures at every instant of the recording."""
        return self.course.frame

    @cached_property
    def values(self) -> pd.DataFrame:
        """One row per measure and plane: value, unit, which way is safer, source, or why there is none."""
        from lumbar.lifting.measures.lift_values import values_of_lift

        return values_of_lift(self.course, self.facts)

    def files(self) -> Iterator[tuple[str, Any]]:
        """``movement_measures.csv`` (the values) and ``movement_course.csv`` (every instant)."""
        yield "movement_measures.csv", self.values.assign(data=self.data)
        yield "movement_course.csv", self.instants.assign(data=self.data)

    def __str__(self) -> str:
        from lumbar.lifting.measures.registry import MEASURES

        named = self.values[self.values["measure"].map(lambda name: MEASURES[name].headline)]
        lines = [
            f"{row.measure}: none ({row.reason})"
            if row.reason
            else f"{row.measure}: {row.value:.3g} {row.unit} ({row.safer} is safer)"
            for row in named.drop_duplicates("measure").itertuples()
        ]
        return "\n".join([*lines, *self.course.notes])

    def __repr__(self) -> str:
        return f"<Measures of {self.facts['lift']}>"

    @property
    def shown(self) -> pd.DataFrame:
        """The values."""
        return self.values
