"""``lumbar.lift_page``: an interactive page of one lift, with a push that can be dragged."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lumbar.base.errors import InputError
from lumbar.base.files import read_json
from lumbar.interface.lift import Lift
from lumbar.interface.result import UNKNOWN_SOURCE, read_table
from lumbar.publishing.lift_page.lift_data import LiftTables
from lumbar.settings.lifting import StabilitySettings

if TYPE_CHECKING:
    from lumbar.publishing.lift_page.lift_document import LiftPage

FILES = ("body.csv", "com.csv", "pendulum.csv", "pendulum.json", "events.json")
"""Files that the page of a saved lift needs."""


def lift_page(
    lift: Lift | str | os.PathLike, *, settings: StabilitySettings | None = None, source_label: str = ""
) -> LiftPage:
    """Make the page of one lift: body, balance, pendulum states, and pushes against the funnel.

    The page contains all its data; its script integrates a push with the equations of `basins`.

    Parameters
    ----------
    lift : Lift or path
        Result of `lift`, or the folder of a saved result.
    settings : StabilitySettings, optional
        Pendulum, regulator, goal and limits of the torque; no checks are run.
    source_label : str
        Name of the source of the data; default the source of the lift.

    Returns
    -------
    LiftPage
        ``to_html()`` is the page, ``save(path)`` writes it.

    Raises
    ------
    InputError
        If the folder lacks a file, or `lift` did not write a file.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.twin.examples import example_lift
    >>> lift = lumbar.lift("lift.c3d", example_lift("lift.c3d"), box_mass_kg=15)
    >>> lumbar.lift_page(lift).save("lift.html")
    """
    from lumbar.publishing.lift_page.lift_document import LiftPage

    if isinstance(lift, Lift):
        label, pivot = source_label or lift.source_label, lift.analysed.pivot
        tables = LiftTables(lift.body, pivot, lift.states, lift.facts, lift.events, label)
    else:
        tables = _read_tables(Path(lift), source_label)
    return LiftPage(tables, settings or StabilitySettings())


def saved_lifts(folder: str | os.PathLike) -> list[Path]:
    """Return the folders of lifts: `folder` itself, folders in it, and folders in its ``lifting`` (a study's results).

    Parameters
    ----------
    folder : path
        Folder of a lift, of several, or of a study's results.
    """
    folder = Path(folder)
    inner = [path for parent in (folder, folder / "lifting") for path in sorted(parent.glob("*/"))]
    return [path for path in (folder, *inner) if all((path / name).is_file() for name in FILES)]


def _read_tables(folder: Path, source_label: str) -> LiftTables:
    absent = [name for name in FILES if not (folder / name).is_file()]
    if absent:
        raise InputError(f"{folder}: no {', '.join(absent)}; a folder that 'lumbar lift' writes is needed")
    try:
        body, centres, states = (read_table(folder / name, "a lift") for name in FILES[:3])
        pivots = centres.drop_duplicates("time_s")[[f"pivot_{axis}_m" for axis in "xyz"]].to_numpy(float)
    except KeyError as error:
        raise InputError(f"{folder}: not the tables that 'lumbar lift' writes ({error})") from error
    facts, events = (read_json(folder / name) for name in FILES[3:])
    pivot = pivots if len(pivots) == len(body) and np.isfinite(pivots).any() else None
    source_label = source_label or facts.get("data", UNKNOWN_SOURCE)
    return LiftTables(body, pivot, states, facts, events["events"], source_label)
