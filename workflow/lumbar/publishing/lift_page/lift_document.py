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
from lumbar.publishing.figures.stability_figures import PLANE_TITLES
from lumbar.publishing.figures.style import MEASURED, SEGMENTS, SERIES
from lumbar.publishing.lift_page import lift_data, lift_pictures
from lumbar.settings.lifting import StabilitySettings

PAGE = "publishing/lift_page/lift_page.html.jinja"
N_STATES = 250
"""Drawn instants of a pendulum's states."""


@cache
def _pictures() -> EmbeddedPictures:
    """Return the pictures of every page: they are equal, since a page's script fills them."""
    return embed_pictures(lambda document: add_roots(document, lift_pictures.lift_pictures()))


@dataclass(frozen=True, eq=False)
class LiftPage:
    """A lift as a page."""

    lift: lift_data.LiftTables
    settings: StabilitySettings

    @cached_property
    def course(self) -> Course:
        """Measures of the lift at every instant."""
        gravity = self.settings.pendulum.gravity_m_s2
        return course_of_lift(Lifter(self.lift.body, self.lift.facts, self.settings.measures, gravity))

    @cached_property
    def _pendulums(self) -> tuple[list[lift_data.PushedPendulum], list[Failure]]:
        return lift_data.pushed_pendulums(LiftStates(self.lift.states, self.lift.facts), self.settings)

    @cached_property
    def _frames(self) -> slice:
        """Drawn frames: evenly spaced from the first."""
        time = self.lift.body["time_s"].to_numpy()
        rate = (len(time) - 1) / (time[-1] - time[0])
        steps = rate / lift_data.MAX_FRAMES_PER_S, len(time) / lift_data.MAX_FRAMES
        return slice(None, None, max(1, *map(math.ceil, steps)))

    @cached_property
    def _balance(self) -> dict[str, np.ndarray]:
        share = self.settings.measures.functional_share
        return lift_data.balance_columns(self.course.frame, share, self._frames)

    @property
    def title(self) -> str:
        """Title of the page."""
        return f"Lift {self.lift.facts['lift']}"

    def _sources(self) -> list[ColumnDataSource]:
        """Return the data that the page's script draws."""
        columns = {"body": lift_data.body_columns(self.lift, self._frames)}
        outlines = {name: values.ravel() for name, values in self._balance.items() if values.ndim == 2}
        if outlines:
            columns["balance"] = {name: values for name, values in self._balance.items() if values.ndim == 1}
            columns["bases"] = outlines
        for (com, plane), rows in self.lift.states.groupby(["com", "plane"], sort=False):
            drawn = rows.iloc[np.linspace(0, len(rows) - 1, N_STATES).round().astype(int)]
            names = {"time": "time_s", "angle": "angle_rad", "velocity": "angular_velocity_rad_s"}
            states = {name: drawn[column].to_numpy(float) for name, column in names.items()}
            columns[f"states:{com}/{plane}"] = states
        for item in self._pendulums[0]:
            columns |= {f"loop:{item.key}": item.columns, f"level:{item.key}": {"level": item.level}}
        return [ColumnDataSource(values, name=name) for name, values in columns.items()]

    def variables(self) -> dict[str, Any]:
        """Return the template's variables."""
        pendulum = self.settings.pendulum
        pendulums, failures = self._pendulums
        return {
            "title": self.title,
            "data": self.lift.source_label,
            "facts": self.lift.facts,
            "events": self.lift.events,
            "event_labels": EVENT_LABELS,
            "measures": self._measures(),
            "notes": self.course.notes,
            "no_balance": self.course.missing.get("margin_of_stability_m", ""),
            "share": self.settings.measures.functional_share,
            "centres": self._centres,
            "has_states": not self.lift.states.empty,
            "planes": PLANE_TITLES,
            "pendulums": pendulums,
            "failures": sorted(
                {f"{item.com}, {PLANE_TITLES[item.plane]}: {item.reason}" for item in failures}
            ),
            "sign": pendulum.sign,
            "clock": pendulum.time,
            "colours": {
                "certified": lift_pictures.CERTIFIED,
                "goal": lift_pictures.GOAL,
                "pushed": lift_pictures.PUSHED,
                "ink": MEASURED,
                "first": SERIES[0],
            },
            "content": self._content(),
        }

    @property
    def _centres(self) -> list[dict[str, str]]:
        """Known centres of mass: point, name, colour and marker."""
        colours, marks = {**SEGMENTS, "whole body": SERIES[4], "box": SERIES[3]}, lift_pictures.MARKS
        return [
            {**item, "colour": colours[item["name"]], "mark": marks[item["name"]]}
            for item in lift_data.centres(self.lift.body)
        ]

    def _measures(self) -> list[dict[str, str]]:
        """Return the headline measures: name, value or why it is missing, and the safer direction."""

        def typeset(value: float, unit: str) -> str:
            value, unit = (1000 * value, "mm") if unit == "m" else (value, unit)
            return typeset_minus_signs(f"{value:.3g} {unit}")

        values = values_of_lift(self.course, self.lift.facts).drop_duplicates("measure")
        return [
            {
                "name": print_measure(row.measure),
                "value": "" if row.reason else typeset(row.value, row.unit),
                "reason": row.reason,
                "below": row.safer == "higher" and row.value < 0,
                "told": headline_sentence(row.measure, row.value, typeset(abs(row.value), row.unit)),
                "safer": row.safer,
                "meaning": MEASURES[row.measure].meaning,
                "phase": WINDOWS[MEASURES[row.measure].phase],
            }
            for row in values.itertuples()
            if MEASURES[row.measure].headline
        ]

    def _content(self) -> dict[str, Any]:
        """Return the data of the page's script."""
        facts, points = self.lift.facts, dict(points_of(self.lift.body))
        # The smallest and largest coordinate of the body and the ground.
        every = np.concatenate(list(points.values()))
        low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
        low[2] = min(low[2], 0.0)
        dashes = lift_pictures.DASHES
        # Name, start and end of every phase.
        time, phase = (self.lift.body[name].to_numpy() for name in ("time_s", "phase"))
        starts = [0, *(np.flatnonzero(phase[1:] != phase[:-1]) + 1)]
        ends = zip(starts, [*starts[1:], len(time) - 1], strict=True)
        return {
            "chains": lift_data.stick_figure(points),
            "centres": self._centres,
            "segments": {com: {"colour": colour, "dash": dashes[com]} for com, colour in SEGMENTS.items()},
            "phases": [(str(phase[i]), float(time[i]), float(time[j])) for i, j in ends],
            "deposit": None if facts["no_deposit"] else [facts["start_s"], facts["stop_s"]],
            "balance": bool(self._balance),
            "outlines": lift_pictures.OUTLINES,
            "bounds": dict(zip("xyz", zip(low.tolist(), high.tolist(), strict=True), strict=True)),
            "shades": lift_pictures.SHADES,
            "pendulums": {item.key: {**item.constants, "binds": item.binds} for item in self._pendulums[0]},
        }

    def to_html(self) -> str:
        """Return the page as one self-contained file: the same bytes for the same lift."""
        return one_file(_pictures(), PAGE, self.variables(), self._sources())

    def save(self, path: str | Path) -> None:
        """Write the page to a file."""
        write_text(Path(path), self.to_html())
