"""Interactive page of a lift: pictures, their data, and the template's variables."""

import math
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource

from lumbar.base.files import write_text
from lumbar.base.templates import typeset_minus_signs
from lumbar.lifting.measures.course import Course, Lifter, course_of_lift
from lumbar.lifting.measures.lift_values import (
    MEASURES,
    WINDOWS,
    headline_sentence,
    print_measure,
    values_of_lift,
)
from lumbar.lifting.movement.lift_tables import points_of
from lumbar.lifting.stability.model.pendulum_trajectories import Failure, LiftStates
from lumbar.publishing.explorer.one_file import EmbeddedPictures, add_roots, embed_pictures, one_file
from lumbar.publishing.figures.lifting_figures import EVENT_LABELS
from lumbar.publishing.figures.palette import MEASURED, SEGMENTS, SERIES
from lumbar.publishing.figures.stability_figures import PLANE_TITLES
from lumbar.publishing.lift_page.lift_data import (
    MAX_FRAMES,
    MAX_FRAMES_PER_S,
    LiftTables,
    PushedPendulum,
    balance_columns,
    body_columns,
    centres,
    chains,
    pushed_pendulums,
)
from lumbar.publishing.lift_page.lift_pictures import (
    CERTIFIED,
    DASHES,
    GOAL,
    MARKS,
    OUTLINES,
    PUSHED,
    SHADES,
    lift_pictures,
)
from lumbar.settings.stability import StabilitySettings

PAGE = "publishing/lift_page/lift_page.html.jinja"
COLOURS = {**SEGMENTS, "whole body": SERIES[4], "box": SERIES[3]}
STATES_DRAWN = 250
"""Drawn instants of a pendulum's states."""


@cache
def _pictures() -> EmbeddedPictures:
    """Return the pictures of every page: they are equal, since a page's script fills them."""
    return embed_pictures(lambda document: add_roots(document, lift_pictures()))


def _in_print(value: float, unit: str) -> str:
    """Format a value: lengths in mm, with a minus sign."""
    value, unit = (1000 * value, "mm") if unit == "m" else (value, unit)
    return typeset_minus_signs(f"{value:.3g} {unit}")


@dataclass(frozen=True, eq=False)
class LiftPage:
    """A lift as a page."""

    lift: LiftTables
    settings: StabilitySettings

    @cached_property
    def course(self) -> Course:
        """Measures of the lift at every instant."""
        gravity = self.settings.pendulum.gravity_m_s2
        return course_of_lift(Lifter(self.lift.body, self.lift.facts, self.settings.measures, gravity))

    @cached_property
    def _pendulums(self) -> tuple[list[PushedPendulum], list[Failure]]:
        return pushed_pendulums(LiftStates(self.lift.states, self.lift.facts), self.settings)

    @property
    def pendulums(self) -> list[PushedPendulum]:
        """Pendulums that can be pushed."""
        return self._pendulums[0]

    @cached_property
    def _frames(self) -> slice:
        """Drawn frames: evenly spaced from the first."""
        time = self.lift.body["time_s"].to_numpy()
        rate = (len(time) - 1) / (time[-1] - time[0])
        step = max(1, math.ceil(rate / MAX_FRAMES_PER_S), math.ceil(len(time) / MAX_FRAMES))
        return slice(None, None, step)

    @cached_property
    def _balance(self) -> dict[str, np.ndarray]:
        return balance_columns(self.course.frame, self.settings.measures.functional_share, self._frames)

    @property
    def title(self) -> str:
        """Title of the page."""
        return f"Lift {self.lift.facts['lift']}"

    def _sources(self) -> list[ColumnDataSource]:
        """Return the data that the page's script draws."""
        held = [ColumnDataSource(body_columns(self.lift, self._frames), name="body")]
        outlines = {name: values.ravel() for name, values in self._balance.items() if values.ndim == 2}
        if outlines:
            alone = {name: values for name, values in self._balance.items() if values.ndim == 1}
            held += [ColumnDataSource(alone, name="balance"), ColumnDataSource(outlines, name="bases")]
        for (com, plane), rows in self.lift.states.groupby(["com", "plane"], sort=False):
            drawn = rows.iloc[np.linspace(0, len(rows) - 1, STATES_DRAWN).round().astype(int)]
            names = {"time": "time_s", "angle": "angle_rad", "velocity": "angular_velocity_rad_s"}
            columns = {name: drawn[column].to_numpy(float) for name, column in names.items()}
            held.append(ColumnDataSource(columns, name=f"states:{com}/{plane}"))
        for item in self.pendulums:
            held.append(ColumnDataSource(item.columns, name=f"loop:{item.key}"))
            held.append(ColumnDataSource({"level": item.level}, name=f"level:{item.key}"))
        return held

    def _bounds(self) -> dict[str, tuple[float, float]]:
        """Return the smallest and largest coordinate of the body and the ground."""
        every = np.concatenate(list(points_of(self.lift.body).values()))
        low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
        low[2] = min(low[2], 0.0)
        return {axis: (float(low[i]), float(high[i])) for i, axis in enumerate("xyz")}

    def _phases(self) -> list[tuple[str, float, float]]:
        """Return name, start and end of every phase."""
        time, phase = (self.lift.body[name].to_numpy() for name in ("time_s", "phase"))
        starts = [0, *(np.flatnonzero(phase[1:] != phase[:-1]) + 1)]
        stops = [*starts[1:], len(time) - 1]
        return [(str(phase[i]), float(time[i]), float(time[j])) for i, j in zip(starts, stops, strict=True)]

    def variables(self) -> dict[str, Any]:
        """Return the template's variables."""
        facts, limits = self.lift.facts, self.settings.pendulum
        return {
            "title": self.title,
            "data": self.lift.source_label,
            "facts": facts,
            "events": [(EVENT_LABELS[name], time) for name, time in self.lift.event_times.items()],
            "absent": [
                f"No {EVENT_LABELS[name]}: {event['how']}."
                for name, event in self.lift.events.items()
                if event["time_s"] is None
            ],
            "measures": self._measures(),
            "phases": self._strip(),
            "notes": self.course.notes,
            "no_balance": self.course.missing.get("margin_of_stability_m", ""),
            "share": self.settings.measures.functional_share,
            "centres": [{**item, "colour": COLOURS[item["name"]]} for item in centres(self.lift.body)],
            "has_states": not self.lift.states.empty,
            "planes": PLANE_TITLES,
            "coms": list(SEGMENTS),
            "looks": {com: {"colour": SEGMENTS[com], "dashed": bool(DASHES[com])} for com in SEGMENTS},
            "pendulums": self.pendulums,
            "failures": sorted(
                {f"{item.com}, {PLANE_TITLES[item.plane]}: {item.reason}" for item in self._pendulums[1]}
            ),
            "sign": limits.sign,
            "clock": limits.time,
            "colours": {
                "certified": CERTIFIED,
                "goal": GOAL,
                "pushed": PUSHED,
                "ink": MEASURED,
                "first": SERIES[0],
            },
            "content": self._content(),
        }

    def _strip(self) -> list[dict[str, Any]]:
        """Return the phases along the slider in percent of the recording."""
        phases = self._phases()
        first, length = phases[0][1], phases[-1][2] - phases[0][1]
        return [
            {
                "name": name,
                "left": f"{100 * (start - first) / length:.3f}",
                "width": f"{100 * (stop - start) / length:.3f}",
            }
            for name, start, stop in phases
        ]

    def _measures(self) -> list[dict[str, str]]:
        """Return the headline measures: name, value or why it is missing, and the safer direction."""
        values = values_of_lift(self.course, self.lift.facts).drop_duplicates("measure")
        return [
            {
                "name": print_measure(row.measure),
                "value": "" if row.reason else _in_print(row.value, row.unit),
                "reason": row.reason,
                "below": row.safer == "higher" and row.value < 0,
                "told": headline_sentence(row.measure, row.value, _in_print(abs(row.value), row.unit)),
                "safer": row.safer,
                "meaning": MEASURES[row.measure].meaning,
                "phase": WINDOWS[MEASURES[row.measure].phase],
            }
            for row in values.itertuples()
            if MEASURES[row.measure].headline
        ]

    def _content(self) -> dict[str, Any]:
        """Return the data of the page's script."""
        facts = self.lift.facts
        return {
            "chains": chains({name.removesuffix("_x_m") for name in self.lift.body if name.endswith("_x_m")}),
            "centres": [
                {**item, "mark": MARKS[item["name"]], "colour": COLOURS[item["name"]]}
                for item in centres(self.lift.body)
            ],
            "segments": {com: {"colour": SEGMENTS[com], "dash": DASHES[com]} for com in SEGMENTS},
            "phases": self._phases(),
            "deposit": None if facts["no_deposit"] else [facts["start_s"], facts["stop_s"]],
            "balance": bool(self._balance),
            "outlines": OUTLINES,
            "bounds": self._bounds(),
            "shades": SHADES,
            "pendulums": {item.key: {**item.constants, "binds": item.binds} for item in self.pendulums},
        }

    def to_html(self) -> str:
        """Return the page as one self-contained file: the same bytes for the same lift."""
        return one_file(_pictures().add_sources(self._sources()), PAGE, self.variables())

    def save(self, path: str | Path) -> None:
        """Write the page to a file."""
        write_text(Path(path), self.to_html())
