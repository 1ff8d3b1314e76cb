"""Other trials of the person in a recording: they tell what posture does to the places of markers."""

import os
from collections.abc import Iterable
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError
from lumbar.base.yaml_file import shipped_names
from lumbar.lifting.quality.displacement import percentiles
from lumbar.lifting.quality.gate import mask_findings
from lumbar.lifting.quality.screening import Screening
from lumbar.records.markers import read_markers
from lumbar.settings.layout import MarkerLayout

_AT = shipped_names(Path(__file__).with_name("thresholds.yaml"), "other_trials")
Trials = dict[str, dict[str, np.ndarray]]
"""By path, some frames of a trial: positions by the file's labels, shape (n, 3), metres; NaN where not seen or left out."""


def other_trials(
    paths: Iterable[str | os.PathLike | None],
    layout: MarkerLayout,
    height_m: float | None = None,
    own: bool = False,
) -> Trials:
    """Read the trials that can be read and hold no error, without what the findings of each leave out.

    None of them where they are too few for `beside`; `own` says that the trial itself is among them.
    """
    known = dict.fromkeys(str(path) for path in paths if path is not None)
    bare = replace(layout, aliases={}, required=None, check_axes=False)
    found: Trials = {}
    for path in known if len(known) > 1 + own else ():
        screening = Screening(height_m, layout.aliases, refuse=False)
        try:
            read_markers(path, bare, minimum_frames=1, screen=screening)
            screening.raise_errors()
        except InputError:
            continue
        points = mask_findings(screening.points, screening.findings)
        count = len(next(iter(points.values())))
        frames = np.linspace(0, count - 1, min(_AT.frames, count)).astype(int)
        found[path] = {label: positions[frames] for label, positions in points.items()}
    return found


def beside(trials: Trials, path: str | os.PathLike) -> Trials:
    """Those that are not of this file, as many as help; none where it is one alone, which may be the one that drifts."""
    others = ((other, points) for other, points in trials.items() if Path(other) != Path(path))
    found = dict(islice(others, _AT.most))
    return found if len(found) > 1 else {}


def of_same_person(trials: Trials, path: str | os.PathLike) -> Trials:
    """Those with the labels of this file's, in which nearly all distances that are constant are alike."""
    own = trials.get(str(path), {})
    alike = {
        other: points
        for other, points in trials.items()
        if points.keys() == own.keys() and _alike(own, points)
    }
    return beside(alike, path)


def _alike(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> bool:
    apart = np.abs(_constant_distances(one) - _constant_distances({label: other[label] for label in one}))
    apart = apart[np.isfinite(apart)]
    return len(apart) >= _AT.fewest and float(np.quantile(apart, _AT.nearly_all)) < _AT.other_person_m


def _constant_distances(points: dict[str, np.ndarray]) -> np.ndarray:
    """Distances of pairs of markers, NaN of those that vary, shape (n_pairs,)."""
    every = np.stack(list(points.values()))
    rows, columns = np.triu_indices(len(every), 1)
    low, middle, high = percentiles(np.linalg.norm(every[rows] - every[columns], axis=2), (0.05, 0.5, 0.95))
    return np.where((high - low < _AT.rigid_m) & (middle > _AT.apart_m), middle, np.nan)
