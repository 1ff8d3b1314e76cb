"""Lifts that ``lumbar explore`` serves: those saved in a folder, or made for a study."""

from __future__ import annotations

import sys
from pathlib import Path

from lumbar.interface.lift_page import saved_lifts
from lumbar.page_server.served_lifts import ServedLift


def lifts_of_folder(options) -> list[ServedLift]:
    """Lifts that the folder ``target`` holds; none where it is a folder of records."""
    from lumbar.study.load_study import load_settings

    found = saved_lifts(options.target)
    settings = load_settings(*options.config).stability if found else None
    return [ServedLift(folder, settings, options.data) for folder in found]


def lifts_of_study(options) -> list[ServedLift]:
    """Lifts of the study whose file is ``target``, as far as they are made; the others are counted on standard error."""
    from lumbar.study.load_study import load_study_file

    study = load_study_file(Path(), options.target)
    made = [path for path in saved_lifts(Path("results") / study.name) if path.name in study.lifts]
    absent = len(study.lifts) - len(made)
    if absent:
        print(
            f"{absent} of {len(study.lifts)} lifts are not there yet: 'snakemake lifting' makes them",
            file=sys.stderr,
        )
    return [ServedLift(path, study.settings.stability, study.data_label) for path in made]
