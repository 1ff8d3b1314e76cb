"""What pushes done tell of persons, as tables: thresholds with intervals, calibration of the curve, increments of measures.

Calibration compares with the outcome of every push the chance that all other pushes give it (importance weights of the draws:
Gelfand, Dey & Chang 1992). Increments are those of the contest: added to size, direction and, where known, mass, learnt on other
persons (`chances`).
"""

from pathlib import Path

import numpy as np
import pandas as pd

from lumbar.base.yaml_file import shipped_yaml
from lumbar.lifting.pushes.chances import told_by_others
from lumbar.lifting.pushes.dose_response import Posterior, PushRecords, chance, log_odds
from lumbar.lifting.pushes.prediction import increment_of
from lumbar.lifting.pushes.push_sheet import KNOWN
from lumbar.lifting.pushes.roc import area, groups_of
from lumbar.settings.pushes import ScoringSettings

SAID: dict[str, str] = shipped_yaml(Path(__file__).with_suffix(".yaml"))
NOBODY = "a person not pushed yet"
ENDS = (0.5, 0.025, 0.975)
FEWEST_OPEN = 3.0
"""Outcomes that were open, each counted as p(1 − p), below which no sum of them is normal."""
BANDS = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0)
"""Of predicted chances, by which pushes are counted together."""


def threshold_rows(records: PushRecords, posterior: Posterior, seed: int) -> list[dict]:
    """Return thresholds by person and direction, and of a person who was not pushed."""
    everybody = np.concatenate([posterior.log_threshold, posterior.someone(seed)[:, None]], axis=1)
    found, rows = np.exp(np.quantile(everybody, ENDS, axis=0)), []
    for index, person in enumerate((*records.persons, NOBODY)):
        for way, direction in enumerate(records.directions):
            outcomes = records.stepped[(records.person == index) & (records.direction == way)]
            values = zip(("threshold_N_s", "low", "high"), found[:, index, way], strict=True)
            counts = {"pushes": len(outcomes), "steps": int(outcomes.sum())}
            rows.append({"person": person, "direction": direction, **dict(values), **counts})
    return rows


def curve_notes(records: PushRecords, posterior: Posterior) -> list[str]:
    """Say how persons scatter, how steep the curve is, and what the phase of the movement does, direction by direction."""
    spread = np.sqrt((posterior.factor**2).sum(axis=2))

    def span(values: np.ndarray) -> str:
        return "{:.3g} ({:.3g} to {:.3g})".format(*np.quantile(values, ENDS))

    notes = []
    for way, direction in enumerate(records.directions):
        widths = {"scatter": spread[:, way], "width": np.log(9) * posterior.width[:, way]}
        spans = {name: span(100 * values) for name, values in widths.items()}
        note = SAID["curve"].format(direction=direction, **spans)
        if len(records.phases) > 1:
            note = SAID["phase"].format(curve=note, growth=span(np.exp(posterior.phase[:, way])))
        notes.append(note)
    return notes


def predicted(records: PushRecords, posterior: Posterior) -> np.ndarray:
    """Chance of a step of every push as all other pushes tell it, shape (pushes,)."""
    found = np.empty(len(records.size))
    for index, size in enumerate(records.size):
        person, way = records.person[index], records.direction[index]
        own = posterior.log_threshold[:, person, way], records.phase[index], posterior.phase[:, way]
        chances = chance(log_odds(np.log(size), *own, posterior.width[:, way]))
        weight = 1 / (chances if records.stepped[index] else 1 - chances)
        found[index] = weight @ chances / weight.sum()
    return found


def calibration_rows(records: PushRecords, told: np.ndarray) -> list[dict]:
    """Return pushes by predicted chance, with the share that stepped and Wilson's interval of it."""
    from statsmodels.stats.proportion import proportion_confint

    band, rows = np.digitize(told, BANDS[1:-1]), []
    for index in np.unique(band):
        outcomes = records.stepped[band == index]
        low, high = proportion_confint(outcomes.sum(), len(outcomes), method="wilson")
        row = {
            "predicted": f"{BANDS[index]:g} to {BANDS[index + 1]:g}",
            "stepped": outcomes.mean(),
            "low": low,
        }
        row |= {"high": high, "mean_predicted": told[band == index].mean(), "pushes": len(outcomes)}
        rows.append(row)
    return rows


def trends(records: PushRecords, told: np.ndarray) -> tuple[float, float]:
    """Standard normal numbers where thresholds keep over a session, and where phase acts as a line; else away from 0.

    The first is positive where steps become more frequent, the second where they are at the movement's begin and end.
    """
    order = np.zeros(len(told))
    for person in range(len(records.persons)):
        here = records.person == person
        order[here] = np.linspace(-1, 1, here.sum()) if here.sum() > 1 else 0.0
    bend = (records.phase - 0.5) ** 2
    found, open_ = [], told * (1 - told)
    for course in (order, bend - bend.sum() / max(len(bend), 1)):
        scatter, more = np.sqrt((open_ * course**2).sum()), ((records.stepped - told) * course).sum()
        found.append(float(more / scatter) if scatter > 0 and open_.sum() > FEWEST_OPEN else 0.0)
    return found[0], found[1]


def increment_rows(
    sheet: pd.DataFrame, records: PushRecords, scoring: ScoringSettings, seed: int
) -> list[dict]:
    """Return what each column of numbers that the sheet has beside adds to size, direction and, where known, mass."""
    rows = []
    mass = [pd.to_numeric(sheet["mass_kg"])] if "mass_kg" in sheet else []
    known = np.log([records.size, *mass])
    for name in sheet.columns.difference(KNOWN, sort=False):
        values = pd.to_numeric(sheet[name], errors="coerce").to_numpy(float)
        here = np.isfinite(values)
        steps, person = records.stepped[here], records.person[here]
        if not steps.any() or steps.all() or len(set(person)) < 2:
            continue
        sets = {"known": [*known[:, here]], "added": [*known[:, here], values[here]]}
        groups = groups_of(person, scoring.folds, [seed, 4])
        told = told_by_others(sets, steps, records.direction[here], groups)
        found = increment_of(told["added"], told["known"], steps, person, scoring)
        counts = {"pushes": len(steps), "persons": len(set(person))}
        rows.append({"measure": name, "known_auc": area(told["known"], steps), **found, **counts})
    return rows
