"""Which trial of a person a marker file is the recording of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from lumbar.base.errors import InputError
from lumbar.interface.reading import MARKER_ENDINGS
from lumbar.records.unpacking import ending_of
from lumbar.settings.subject import SubjectSettings, TrialSettings

TABLES = (".csv", ".mat")
"""Endings of files that may hold markers or anything else: in a folder they count where a trial names them."""


def marker_files(folder: Path, tables: bool = False) -> list[Path]:
    """Marker files in a folder and the folders below it, in order of their paths.

    Parameters
    ----------
    tables : bool
        Whether CSV and MAT files count too.

    Raises
    ------
    InputError
        If there is none.
    """
    endings = (*MARKER_ENDINGS, *(TABLES if tables else ()))
    files = sorted(path for path in folder.rglob("*") if ending_of(path) in endings and path.is_file())
    if not files:
        raise InputError(f"{folder}: no marker file ({', '.join(endings)}) in this folder")
    return files


def trial_of(
    subject: SubjectSettings,
    markers: Path,
    box_mass_kg: float | None,
    trial: TrialSettings | str | None = None,
) -> tuple[str, TrialSettings]:
    """Return the trial that a file is the recording of, with the name of its lift.

    Parameters
    ----------
    markers : Path
        Marker file.
    box_mass_kg : float, optional
        Mass of the box; picks among several lifts of the same file.
    trial : TrialSettings or str, optional
        The trial itself, or the name of its lift.

    Raises
    ------
    InputError
        Listing the subject's trials, if none or several of them fit: events declared for another file are another
        lift's.
    """
    if box_mass_kg is not None and not 0 <= box_mass_kg <= 100:
        raise InputError(f"mass of the box is {box_mass_kg:g} kg; allowed: 0 to 100")
    if isinstance(trial, TrialSettings) or not subject.trials:
        if isinstance(trial, str):
            raise InputError(f"{subject.name} has no trials, so none is named {trial!r}")
        if trial is None:
            if box_mass_kg is None:
                raise InputError(
                    f"{subject.name} has no trials: give the mass of the box (--box-mass KG; box_mass_kg in Python)"
                )
            trial = TrialSettings(box_mass_kg=box_mass_kg, markers=markers.name)
        chosen = trial if box_mass_kg is None else replace(trial, box_mass_kg=box_mass_kg)
        return f"{subject.name}_{chosen.box_mass_kg:g}kg", chosen
    lifts = lift_names(subject)
    if trial is not None:
        fitting = {name: item for name, item in lifts.items() if name == trial}
        sought = f"no trial of {subject.name} is named {trial!r}"
    else:
        fitting = _recorded_in(lifts, markers)
        sought = f"{markers}: no trial of {subject.name} names this file"
    if box_mass_kg is not None and fitting:
        others = fitting
        fitting = {name: item for name, item in others.items() if item.box_mass_kg == box_mass_kg}
        sought = f"{markers}: {', '.join(others)} had no box of {box_mass_kg:g} kg"
    if len(fitting) == 1:
        return next(iter(fitting.items()))
    if fitting:
        sought = f"{markers}: several trials of {subject.name} name this file ({', '.join(fitting)}); name one of them"
    listed = "\n".join(
        f"  - {name}: {item.markers}, box of {item.box_mass_kg:g} kg" for name, item in lifts.items()
    )
    raise InputError(f"{sought}; its trials are\n{listed}")


def lift_names(subject: SubjectSettings) -> dict[str, TrialSettings]:
    """Trials of one person by the names that a study gives their lifts."""
    from lumbar.study.load_study import name_lifts

    return {name: lift.trial for name, lift in name_lifts({subject.name: subject}).items()}


def _recorded_in(lifts: dict[str, TrialSettings], markers: Path) -> dict[str, TrialSettings]:
    """Lifts whose marker file this is: by as much of the path as both have, by the name at least."""
    path = markers.resolve().parts

    def shared(trial: TrialSettings) -> int:
        parts = Path(trial.markers).parts
        if path[-len(parts) :] == parts:
            return len(parts)
        return 1 if parts[-1] == path[-1] else 0

    lengths = {name: shared(trial) for name, trial in lifts.items()}
    longest = max(lengths.values())
    return {name: lifts[name] for name, length in lengths.items() if length == longest > 0}


def static_of(subject: SubjectSettings, trial: TrialSettings, markers: Path) -> Path | None:
    """Return the file of the subject's static trial, which lies below the same folder as the trial's; None without one.

    Raises
    ------
    InputError
        Naming the places where it was looked for.
    """
    return _beside(f"subject.static of {subject.name}", subject.static, trial, markers)


def forces_of(subject: SubjectSettings, trial: TrialSettings, markers: Path) -> Path | None:
    """Return the file of the trial's ground reaction forces; otherwise as `static_of`."""
    return _beside(f"forces of a trial of {subject.name}", trial.forces, trial, markers)


def _beside(key: str, named: str | None, trial: TrialSettings, markers: Path) -> Path | None:
    """Return a file that is named relative to the folder which the trial's file is named relative to."""
    if named is None:
        return None
    path, parts = markers.resolve(), Path(trial.markers).parts
    root = path.parents[len(parts) - 1] if path.parts[-len(parts) :] == parts else path.parent
    places = [root / named, path.parent / Path(named).name]
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        raise InputError(
            f"{key} is {named}, and there is no file " + " or ".join(map(str, dict.fromkeys(places)))
        )
    return found
