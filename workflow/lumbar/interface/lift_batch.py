"""Several lifts of one person at once, from files or a folder."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from lumbar.base.errors import InputError, LumbarError
from lumbar.base.files import write_csv
from lumbar.interface.lift import Lift, lift, lift_names, marker_files, without_pendulum
from lumbar.interface.movement import measure_movement
from lumbar.lifting.measures.lift_values import long_table
from lumbar.lifting.movement.events import EVENTS, event_sources
from lumbar.lifting.quality.other_trials import other_trials
from lumbar.records.unpacking import stem_of
from lumbar.settings.lifting import LiftingSettings
from lumbar.settings.stability import StabilitySettings
from lumbar.settings.subject import SubjectSettings, TrialSettings

COLUMNS = (
    *("lift", "file", "box_mass_kg"),
    *(f"{event}_{part}" for event in EVENTS for part in ("s", "earliest_s", "latest_s", "method")),
    *("pendulums", "remark"),
)
"""Of ``lifts.csv``; an event's method is what it was found in: box, hands, toes, set by hand or absent."""


@dataclass(frozen=True)
class PlannedLift:
    """One lift to be analysed: its marker file, its trial, and the name of its results."""

    name: str
    markers: Path | None
    """None where the folder does not hold the trial's file."""
    trial: TrialSettings | None
    """None for a file that is named by itself."""


def planned_lifts(paths: Sequence[Path], subject: SubjectSettings) -> list[PlannedLift]:
    """Lifts that files and folders hold: of a folder the subject's trials, or every marker file without trials.

    Raises
    ------
    InputError
        For a path that does not exist, and a folder without a marker file.
    """
    lifts = []
    for path in paths:
        if not path.is_dir():
            lifts.append(PlannedLift(stem_of(path), path, None))
            continue
        files = marker_files(path, tables=bool(subject.trials))
        if subject.trials:
            lifts += [
                PlannedLift(name, _found(trial, files), trial) for name, trial in lift_names(subject).items()
            ]
        else:
            static = Path(subject.static).name if subject.static else None
            lifts += [PlannedLift(stem_of(file), file, None) for file in files if file.name != static]
    names = [item.name for item in lifts]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(
            f"{', '.join(twice)}: two files of this name; the results of one would replace the other's"
        )
    return lifts


def _found(trial: TrialSettings, files: list[Path]) -> Path | None:
    parts = Path(trial.markers).parts
    by_path = [file for file in files if file.resolve().parts[-len(parts) :] == parts]
    by_name = [file for file in files if file.name == parts[-1]]
    return next(iter(by_path or by_name), None)


def lift_all(
    lifts: Sequence[PlannedLift],
    subject: SubjectSettings,
    box_mass_kg: float | None,
    settings: LiftingSettings,
    output: Path,
    data: str | None = None,
    static: Path | None = None,
    stability: StabilitySettings | None = None,
) -> tuple[pd.DataFrame, list[str]]:
    """Analyse lifts one after the other; one that fails does not keep the others from their results.

    Parameters
    ----------
    box_mass_kg : float, optional
        Default that of the trials.
    output : Path
        Folder: a folder of its own for every lift, ``lifts.csv``, and ``movement_measures.csv`` with the measures of all.
    data : str, optional
        Words for the source of the data; default each file's name.
    static : Path, optional
        Marker file of a static trial; default the subject's.
    stability : StabilitySettings, optional
        Of the measures.

    Returns
    -------
    table : pandas.DataFrame
        As ``lifts.csv``: events, number of pendulums, what is missing and why.
    failed : list of str
        Names of the lifts without any result.
    """
    rows, failed, measured = [], [], []
    paths = [static, *(item.markers for item in lifts)]
    others = other_trials(paths, settings.markers, subject.height_m, own=True)
    for item in lifts:
        try:
            if item.markers is None:
                raise InputError(f"{item.trial and item.trial.markers} is not in the folder")
            found = lift(
                item.markers,
                subject,
                box_mass_kg,
                trial=item.name if item.trial else None,
                name=item.name,
                settings=settings,
                static=static,
                others=others,
                data=data or item.markers.name,
            )
            found.save(output / item.name)
            measures = measure_movement(found, settings=stability)
            measures.save(output / item.name)
            measured.append((measures.values, found.facts))
            rows.append(_row(item, found))
        except LumbarError as error:
            failed.append(item.name)
            rows.append(
                {"lift": item.name, "file": str(item.markers or ""), "pendulums": 0, "remark": str(error)}
            )
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    write_csv(output / "lifts.csv", table)
    write_csv(output / "movement_measures.csv", long_table(measured, {subject.name: subject.experience}))
    return table, failed


def _row(item: PlannedLift, found: Lift) -> dict:
    events = found.analysed.events
    methods = event_sources(found.analysed.recording, events)
    columns: dict[str, float | str | None] = {}
    for name, event in events.items():
        columns[f"{name}_s"], columns[f"{name}_method"] = event.time_s, methods[name]
        columns[f"{name}_earliest_s"], columns[f"{name}_latest_s"] = event.earliest_s, event.latest_s
    return {
        "lift": item.name,
        "file": str(item.markers),
        "box_mass_kg": found.trial.box_mass_kg,
        **columns,
        "pendulums": len(found.analysed.states),
        "remark": "; ".join([*without_pendulum(found.analysed.missing), *filter(None, [found.doubt])]),
    }
