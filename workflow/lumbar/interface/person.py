"""``lumbar.lift`` and ``lumbar.basins``: from markers to pendulums, and from pendulums to basins of attraction."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.errors import InputError
from lumbar.interface.data_label import NOT_SAID, data_label
from lumbar.interface.trials import forces_of, static_of, trial_of
from lumbar.lifting import lift as lifting
from lumbar.lifting.events import found_by, hands_doubt
from lumbar.lifting.file_events import comparison
from lumbar.lifting.rigid_filling import BodyFilling
from lumbar.settings.lifting import LiftingSettings
from lumbar.settings.plain import plain
from lumbar.settings.seed import SEED
from lumbar.settings.stability import StabilitySettings
from lumbar.settings.subject import SubjectSettings, TrialSettings

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd

    from lumbar.interface.body_model import LiftModel
    from lumbar.lifting.other_pivots import OtherPivot
    from lumbar.lifting.plate_check import PlateCheck
    from lumbar.quality.sheet import QualitySheet
    from lumbar.settings.layout import MarkerLayout
    from lumbar.stability.basins import LiftBasins
    from lumbar.stability.model.failures import Failure
    from lumbar.stability.model.lift_trajectories import LiftStates
    from lumbar.stability.model.trajectory import Trajectory


def lift(
    markers: str | os.PathLike,
    subject: SubjectSettings | str | os.PathLike,
    box_mass_kg: float | None = None,
    *,
    trial: TrialSettings | str | None = None,
    name: str | None = None,
    settings: LiftingSettings | None = None,
    static: str | os.PathLike | None = None,
    forces: str | os.PathLike | None = None,
    data: str = "",
) -> Lift:
    """Find the events, centres of mass and pendulum states of one lift.

    Parameters
    ----------
    markers : path
        C3D, TRC, CSV, MAT or BVH file, also packed (``.gz``).
    subject : SubjectSettings or path
        The person: settings, or a file as in ``config/subjects``.
    box_mass_kg : float, optional
        Mass of the box; default that of the trial.
    trial : TrialSettings or str, optional
        The trial, or the name of its lift, as ``ann_15kg_2``; default the one among the subject's trials whose marker
        file this is. A subject without trials needs none.
    name : str, optional
        Name of the lift; default that of the trial, as in a study.
    settings : LiftingSettings, optional
    static : path, optional
        Marker file of a static trial; default the subject's, looked for below the folder that the trial's file lies below.
    forces : path, optional
        File of the ground reaction forces (``.mot`` or C3D); default the trial's, and without one the plates of the marker
        file itself.
    data : str
        Words for the source of the data; default the folder or file they were read from.

    Returns
    -------
    Lift

    Raises
    ------
    InputError, NumericalError
        Naming the file and what is wrong with it.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.synthetic.examples import example_lift
    >>> somebody = example_lift("lift.c3d")
    >>> print(lumbar.lift("lift.c3d", somebody, box_mass_kg=15))
    lift_off: 2.310 s (box; 2.27 to 2.36)
    toe_off: 3.930 s (toes)
    deposit_start: 5.820 s (box; 5.78 to 6.06)
    release: 7.070 s (box)
    """
    from lumbar.quality.screening import read_screened

    subject = subject_of(subject)
    settings = settings or LiftingSettings()
    found, trial = trial_of(subject, Path(markers), box_mass_kg, trial)
    name = name or found
    static = static or static_of(subject, trial, Path(markers))
    forces = forces or forces_of(subject, trial, Path(markers))
    standing = None if static is None else labelled_markers(static, settings.markers, subject.height_m)
    bodies = BodyFilling(settings, standing)
    recording, sheet = read_screened(markers, settings.markers, name, subject.height_m, bodies)
    sheet = replace(sheet, findings=(*sheet.findings, *bodies.findings))
    return Lift(
        lifting.analyse_lift(recording, name, subject, trial, settings, bodies.gaps, sheet.findings),
        subject,
        trial,
        settings,
        data_label(data, [recording.source]),
        sheet,
        None if forces is None else Path(forces),
    )


def labelled_markers(path: str | os.PathLike, layout: MarkerLayout, height_m: float) -> dict[str, np.ndarray]:
    """Markers of a static trial by their own labels, in metres and standard axes, without what cannot be a body's."""
    from lumbar.quality.screening import Screening
    from lumbar.records.markers import read_markers

    bare = replace(layout, aliases={}, required=None, check_axes=False)
    screening = Screening(height_m, layout.aliases)
    try:
        return read_markers(path, bare, minimum_frames=1, screen=screening).positions
    except InputError as error:
        text = str(error)
        raise error if text.startswith(str(path)) else InputError(f"{path}: {text}") from error


def subject_of(subject: SubjectSettings | str | os.PathLike) -> SubjectSettings:
    """Return the person, read from a file where one is given."""
    if isinstance(subject, SubjectSettings):
        return subject
    from lumbar.config.settings_files import load_subject

    return load_subject(Path(subject))


@dataclass(frozen=True, eq=False, repr=False)
class Lift:
    """One analysed lift.

    Attributes
    ----------
    analysed : lumbar.lifting.lift.AnalysedLift
        Events, centres of mass, pendulum states.
    subject : SubjectSettings
    trial : TrialSettings
    settings : LiftingSettings
    data : str
    quality : lumbar.quality.sheet.QualitySheet
        What is in the recording and what in it cannot be a body: such stretches were left out.
    forces : Path or None
        File of the ground reaction forces, where it is not the recording's own.
    """

    analysed: lifting.AnalysedLift
    subject: SubjectSettings
    trial: TrialSettings
    settings: LiftingSettings
    data: str
    quality: QualitySheet
    forces: Path | None = None

    @property
    def name(self) -> str:
        """Name of the lift, e.g. ``"expert_23kg"``."""
        return self.analysed.name

    @cached_property
    def states(self) -> pd.DataFrame:
        """Pendulum states of the deposit: one row per centre of mass, plane and instant."""
        return lifting.states_frame(self.analysed)

    @cached_property
    def facts(self) -> dict:
        """What the pendulums are made of: masses, lengths, pivots, rules, assumptions; and what measures need beside."""
        return {
            **lifting.summary(self.analysed, self.subject, self.trial, self.settings),
            "other_pivots": {name: about.facts for name, about in self._other_pivots.items()},
            "height_m": self.subject.height_m,
            "no_deposit": lifting.no_deposit(self.analysed.events),
            "missing_points": self._body[1],
        }

    @cached_property
    def _other_pivots(self) -> dict[str, OtherPivot]:
        from lumbar.lifting.other_pivots import other_pivots

        return other_pivots(self.analysed, self.settings)

    @cached_property
    def other_states(self) -> pd.DataFrame:
        """Pendulum states about the pivots that conclusions are compared about, beside the study's own."""
        from lumbar.lifting.other_pivots import other_states_frame

        return other_states_frame(self._other_pivots)

    @cached_property
    def _body(self) -> tuple[pd.DataFrame, dict[str, str]]:
        from lumbar.lifting.body import body_frame

        return body_frame(self.analysed)

    @property
    def body(self) -> pd.DataFrame:
        """Trajectories of joints, feet, hands, load and centres of mass: ``lumbar.lifting.body.body_frame``."""
        return self._body[0]

    @cached_property
    def spread(self) -> pd.DataFrame:
        """How far other segment tables and ends, hip regressions and cut-offs move the trunk's centre of mass."""
        from lumbar.lifting.model_spread import model_spread

        return model_spread(self.analysed, self.subject, self.settings)

    @cached_property
    def plates(self) -> PlateCheck | None:
        """What the force plates of the recording, or of the trial's file of forces, say of the centre of mass; None without."""
        from lumbar.lifting.plate_check import plate_check

        return plate_check(self.analysed, self.subject, self.trial, self.settings, self.forces)

    @property
    def sheet(self) -> QualitySheet:
        """The quality sheet, after what the force plates tell of the rate."""
        return self.quality.told_by_plates(self.plates.rate_factor if self.plates else None)

    @property
    def checks(self) -> list[str]:
        """Lines on ends that are the skin's, on other choices and on force plates."""
        from lumbar.lifting.model_spread import spread_lines

        points, ends = self.analysed.points, self.analysed.table.ends
        inner = self.settings.segment_ends == "inner"
        plates = str(self.plates).splitlines() if self.plates else ["force plates: none in the file"]
        return [*(points.on_skin(ends) if inner else []), *spread_lines(self.spread), *plates]

    @property
    def without_pendulum(self) -> list[str]:
        """Indented lines on centres of mass without a pendulum, and on what would give them markers."""
        reasons = [
            *without_pendulum(self.analysed.missing),
            lifting.recognised_unaliased(self.analysed.recording),
        ]
        return [f"  {line}" for reason in reasons for line in reason.splitlines()]

    @property
    def doubt(self) -> str:
        """Whether hands that stand for the box may have made several lifts; empty where not."""
        return hands_doubt(self.analysed.recording, self.analysed.events, self.settings.events)

    def body_model(self, stability: StabilitySettings | None = None) -> LiftModel:
        """Fit one model of trunk, limbs and box to all markers: the same pendulums with standard deviations."""
        from lumbar.interface.body_model import body_model

        return body_model(self.analysed, self.subject, self.trial, self.settings, self.data, stability)

    @property
    def file_events(self) -> list[str]:
        """Lines on the events that the file itself holds, beside those detected."""
        return comparison(self.analysed.recording, self.analysed.events, self.settings.events.labels)

    def save(self, folder: str | os.PathLike) -> None:
        """Write ``pendulum``, ``other_pivots``, ``com``, ``body``, ``spread``, ``events``, ``gaps``, ``quality``, for figures."""
        from lumbar.files import write_csv, write_json

        folder, label = Path(folder), {"data": self.data}
        tables = {
            "pendulum": self.states,
            "other_pivots": self.other_states,
            "com": lifting.centres_frame(self.analysed),
            "body": self.body,
            "spread": self.spread,
            "gaps": lifting.gaps_frame(self.analysed),
            "motion": lifting.motion_frame(self.analysed),
            "landmarks": lifting.landmarks_frame(self.analysed),
        }
        for name, frame in tables.items():
            write_csv(folder / f"{name}.csv", frame.assign(**label))
        events = {name: event.as_dict() for name, event in self.analysed.events.items()}
        rules = plain(self.settings.events)
        in_file = {"file": self.file_events} if self.file_events else {}
        write_json(
            folder / "events.json", {"lift": self.name, "events": events, **in_file, "rules": rules, **label}
        )
        checked = {"force_plates": self.plates.as_dict() if self.plates else None}
        write_json(folder / "quality.json", {"lift": self.name, **self.sheet.as_dict(), **label})
        write_json(folder / "pendulum.json", {**self.facts, **checked, **label})

    def __str__(self) -> str:
        lines = [*self._events_in_words(), *without_pendulum(self.analysed.missing)]
        return "\n".join([*lines, *(f"{finding.outcome}: {finding}" for finding in self.quality.findings)])

    def _events_in_words(self) -> list[str]:
        """Each event, what it was found in, between which times it must lie; and what hands leave open."""
        sources, lines = found_by(self.analysed.recording, self.analysed.events), []
        for name, event in self.analysed.events.items():
            if event.time_s is None:
                lines.append(f"{name}: none ({event.how})")
                continue
            known = event.earliest_s is not None and event.latest_s is not None
            between = f"; {event.earliest_s:.2f} to {event.latest_s:.2f}" if known else ""
            lines.append(f"{name}: {event.time_s:.3f} s ({sources[name]}{between})")
        if "hands" in sources.values():
            lines.append(
                "the hands stand for the box, which has no markers; whether they hold anything is not known"
            )
        return [*lines, *filter(None, [self.doubt]), *self.file_events]

    def __repr__(self) -> str:
        return f"<Lift {self.name}>"

    def _repr_html_(self) -> str:
        import pandas as pd

        return pd.DataFrame([event.as_dict() for event in self.analysed.events.values()]).to_html(index=False)


def without_pendulum(missing: Mapping[str, str]) -> list[str]:
    """Say once which centres of mass have no pendulum for the same reason."""
    coms: dict[str, list[str]] = {}
    for com, reason in missing.items():
        coms.setdefault(reason, []).append(com)
    return [f"no pendulum of {', '.join(names)}: {reason}" for reason, names in coms.items()]


def basins(
    lift: Lift | str | os.PathLike,
    *,
    facts: Mapping | None = None,
    settings: StabilitySettings | None = None,
    seed: int = SEED,
    data: str = "",
) -> Basins:
    """Compute the basins of attraction of one lift, with the checks of the settings.

    Parameters
    ----------
    lift : Lift or path
        Of `lift`, or a file ``pendulum.csv``.
    facts : mapping, optional
        With a file: what the pendulums are made of; default ``pendulum.json`` beside it.
    settings : StabilitySettings, optional
    seed : int
        Of the simulated starts.
    data : str
        Words for the source of the data; default those of the lift.

    Returns
    -------
    Basins

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.settings.stability import StabilitySettings
    >>> from lumbar.synthetic.examples import example_lift
    >>> lift = lumbar.lift("lift.c3d", example_lift("lift.c3d"), box_mass_kg=15)
    >>> exact_alone = StabilitySettings(knots=51, checks=())
    >>> basins = lumbar.basins(lift, settings=exact_alone)
    >>> print(basins)
    thorax, lateral_bending, inverted, real time: 0.4545 rad²/s on average, 0.6201 at first
    thorax, flexion_extension, inverted, real time: 0.4301 rad²/s on average, 0.5512 at first
    abdomen, lateral_bending, inverted, real time: 1.104 rad²/s on average, 1.745 at first
    abdomen, flexion_extension, inverted, real time: 1.065 rad²/s on average, 1.621 at first
    pelvis, lateral_bending, inverted, real time: 1.374 rad²/s on average, 2.101 at first
    pelvis, flexion_extension, inverted, real time: 1.338 rad²/s on average, 1.978 at first
    thorax, lateral_bending, hanging, unit time: 0.2745 rad²/s on average, 0.4887 at first
    thorax, flexion_extension, hanging, unit time: 0.2734 rad²/s on average, 0.4861 at first
    abdomen, lateral_bending, hanging, unit time: 0.6901 rad²/s on average, 1.47 at first
    abdomen, flexion_extension, hanging, unit time: 0.6885 rad²/s on average, 1.466 at first
    pelvis, lateral_bending, hanging, unit time: 0.8897 rad²/s on average, 1.928 at first
    pelvis, flexion_extension, hanging, unit time: 0.889 rad²/s on average, 1.925 at first
    """
    from lumbar.stability.model.lift_trajectories import LiftStates

    settings = settings or StabilitySettings()
    if isinstance(lift, Lift):
        states, data = LiftStates(lift.states, lift.facts, lift.other_states), data or lift.data
    else:
        states = _read_states(Path(lift), facts)
        data = data or states.facts.get("data", "")
    return Basins(states, settings, seed, data or NOT_SAID)


def _read_states(path: Path, facts: Mapping | None) -> LiftStates:
    """Read ``pendulum.csv``, the facts beside it unless they are given, and ``other_pivots.csv`` where it is there."""
    from lumbar.files import read_json
    from lumbar.stability.model.lift_trajectories import LiftStates

    facts = facts or read_json(path.with_suffix(".json"))
    others = path.with_name("other_pivots.csv")
    return LiftStates(_read_table(path), facts, _read_table(others) if others.is_file() else None)


def _read_table(path: Path) -> pd.DataFrame:
    import pandas as pd

    try:
        return pd.read_csv(path)
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a table of pendulum states ({error})") from error


@dataclass(frozen=True, eq=False, repr=False)
class Basins:
    """Basins of attraction of one lift.

    Attributes
    ----------
    states : LiftStates
    settings : StabilitySettings
    seed : int
    data : str
    """

    states: LiftStates
    settings: StabilitySettings
    seed: int
    data: str

    @cached_property
    def _found(self) -> tuple[list[Trajectory], list[Failure]]:
        from lumbar.stability.comparison.grid import headline

        return self.states.trajectories(headline(self.settings, self.states.facts["pivot"]))

    @property
    def trajectories(self) -> list[Trajectory]:
        """The sound trajectories of the headline."""
        return self._found[0]

    @property
    def without_trajectory(self) -> list[Failure]:
        """Pendulums of the headline whose states cannot be used."""
        return self._found[1]

    @cached_property
    def computed(self) -> LiftBasins:
        """Areas, funnels and what could not be computed."""
        from lumbar.stability.basins import basins_of_lift
        from lumbar.stability.model.convention import THESIS

        as_in_thesis, _ = self.states.trajectories(THESIS)
        return basins_of_lift(self.trajectories, self.settings, self.seed, as_in_thesis)

    @cached_property
    def grid(self) -> pd.DataFrame:
        """Average cross-sections under every convention, each with its null control (θ0 = 0)."""
        from lumbar.stability.comparison.grid import grid_areas

        return grid_areas(self.states, self.settings)

    @property
    def areas(self) -> pd.DataFrame:
        """One row per centre of mass, plane, method and sign of gravity, with the checks."""
        return self.computed.summary

    @property
    def funnels(self) -> pd.DataFrame:
        """The exact funnels, knot by knot."""
        return self.computed.funnels

    @cached_property
    def _extended(self) -> tuple[pd.DataFrame, list[Failure]]:
        from lumbar.stability.extended_basins import extended_basins, nothing_extended

        if "extended" not in self.settings.checks:
            return nothing_extended(), []
        return extended_basins(self.trajectories, self.settings, self.seed)

    @property
    def extended(self) -> pd.DataFrame:
        """The same basins with limited torque, uncertain mass and a better V; empty unless among the checks."""
        return self._extended[0]

    def failures(self) -> pd.DataFrame:
        """Basins that could not be computed, with their reasons."""
        from lumbar.stability.model.failures import failures_frame

        return failures_frame([*self.without_trajectory, *self.computed.failures, *self._extended[1]])

    def save(self, folder: str | os.PathLike) -> None:
        """Write ``boa.csv``, ``funnel.csv``, ``grid.csv``, ``extended.csv`` and ``failures.csv``."""
        from lumbar.files import write_csv

        folder = Path(folder)
        write_csv(folder / "boa.csv", self.areas)
        write_csv(folder / "funnel.csv", self.funnels)
        write_csv(folder / "grid.csv", self.grid)
        write_csv(folder / "extended.csv", self.extended)
        write_csv(folder / "failures.csv", self.failures())

    def __str__(self) -> str:
        shown = self.areas[self.areas["method"] == "exact"]
        return "\n".join(
            f"{row.com}, {row.plane}, {row.sign}, {row.time} time: {row.mean_area:.4g} rad²/s on average, "
            f"{row.initial_area:.4g} at first"
            for row in shown.itertuples()
        )

    def __repr__(self) -> str:
        return f"<Basins of {len(self.trajectories)} pendulums>"

    def _repr_html_(self) -> str:
        columns = [
            "com",
            "plane",
            "method",
            "sign",
            "mean_area",
            "initial_area",
            "minimum_area",
            "proved_share",
        ]
        return self.areas[columns].to_html(index=False)
