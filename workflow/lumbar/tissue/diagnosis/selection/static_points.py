"""Points of a static test, a table of position and force without a clock: which law of position alone a spring is missing."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import scipy

from lumbar.base.errors import InputError
from lumbar.records.record import Record, same_units
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.preparation import (
    Experiment,
    check_unseen,
    choose_training,
    put_together,
)
from lumbar.tissue.diagnosis.selection.candidate import Candidate, fit_base
from lumbar.tissue.diagnosis.selection.findings import offsets
from lumbar.tissue.diagnosis.selection.forward_selection import Selection, extend
from lumbar.tissue.diagnosis.selection.result import DiagnosisResult, Status
from lumbar.tissue.diagnosis.selection.thresholds import UNSEEN
from lumbar.tissue.effects.catalogue import with_forms_that
from lumbar.tissue.models.bases import BASES, CHOSEN_BY_DATA, Base
from lumbar.tissue.models.motion import Motion

FEWEST = 12
"""Points of one table at least: a third of them is held back where there is no other table."""
_EVERY = 3
"""Of the points in the order of their positions, one in so many is held back."""
_SPRINGS = ("LE", "LE-contact")


Met = Callable[[Experiment], tuple[Experiment, Candidate] | None]


def diagnose_points(
    records: Sequence[Record], settings: DiagnosisSettings, met_at_surface: Met
) -> DiagnosisResult:
    """Diagnose which law of position alone a spring is missing.

    Neither rates nor delays, relaxation, hysteresis or drift can be seen in points without a clock, nor faults of one: none of
    them is looked for, and nothing is filtered. Points count in the order of their positions. `met_at_surface` fits a spring that
    is met at a surface.

    Raises
    ------
    InputError
        If tables with and without a clock are mixed, a table has few points, or the base is none of a static test.
    """
    experiment = _prepare(records, settings)
    scale = experiment.training.scale
    catalogue = with_forms_that(settings.candidates, lambda form: form.is_static, scale)
    settings = replace(settings, catalogue=catalogue, most_effects=1)
    experiment, base = _spring(experiment, settings, met_at_surface)
    found = _StaticSelection(experiment, base, settings).result()
    if _bends(found.model, experiment):
        # Neighbours err alike: the points lie on a curve that no law tried has.
        found = replace(found, refined_status=Status.UNEXPLAINED)
        if found.model is found.base:
            found = replace(found, status=Status.UNEXPLAINED)
    own = experiment.tests[0].name == experiment.training.records[0].name
    unseen = f"One point in {_EVERY} was held back as unseen" if own else "Other tables are the unseen points"
    count = sum(len(record) for record in experiment.records)
    sentence = (
        f"These {count} points have no clock and are treated as a static test: only laws of {experiment.input_quantity} were "
        f"tried, because rates, delays, relaxation, hysteresis, drift and faults of a clock cannot be seen in them. {unseen}; "
        "nothing was filtered."
    )
    finding = Finding("static_points", sentence, float(count), "1")
    return replace(found, findings=(finding, *offsets(found)))


class _StaticSelection(Selection):
    """A search whose false alarms are counted by the F test: simulated ones are of long records and of all effects."""

    def p_value(self, before: Candidate, after: Candidate) -> float:
        """Probability that the best of all forms gains as much where nothing is missing, at most (Bonferroni)."""
        more = after.parameters - before.parameters
        left = self.experiment.training.size - after.parameters - 1
        gained = max(before.fit.squared_error / max(after.fit.squared_error, 1e-300) - 1, 0.0)
        return float(min(1.0, self.forms * scipy.special.fdtrc(more, left, gained * left / more)))


def _prepare(records: Sequence[Record], settings: DiagnosisSettings) -> Experiment:
    same_units(list(records))
    clocked = [record.name for record in records if not record.points]
    if clocked:
        raise InputError(
            f"{', '.join(clocked)}: has a clock, which other tables here lack (points of a static test): diagnose them apart"
        )
    if settings.system != "tissue" or settings.forward:
        raise InputError(
            "points of a static test, without a clock, are diagnosed as force over position of a tissue: leave the base "
            f"{settings.base} or forward out"
        )
    for record in records:
        if len(record) < FEWEST:
            raise InputError(
                f"{record.source or record.name}: {len(record)} points of a static test; at least {FEWEST} are needed"
            )
    chosen, others = choose_training(list(records), settings.train)
    check_unseen(chosen, others)
    fitted, tests = list(map(_points, chosen)), list(map(_points, others))
    if not tests:
        tests = [_points(record, lambda number: number % _EVERY == 1) for record in chosen]
        fitted = [_points(record, lambda number: number % _EVERY != 1) for record in chosen]
    return put_together(chosen[0], fitted, tests, None, records=tuple(records), points=True).from_rest()


def _points(record: Record, wanted=lambda number: number >= 0) -> FitData:
    """Points in the order of their positions; of these, those whose numbers are wanted."""
    order = np.argsort(record["input"], kind="stable")
    order = order[wanted(np.arange(len(order)))]
    number = np.arange(float(len(order)))
    return FitData(record.name, Motion(number, record["input"][order], 1.0), record["output"][order])


def _spring(
    experiment: Experiment, settings: DiagnosisSettings, met_at_surface: Met
) -> tuple[Experiment, Candidate]:
    """The spring that is asked for, or the likelier one: met at a surface, if that beats every law beside the fastened one."""
    name = settings.base
    if isinstance(name, Base):
        if not name.form.is_static:
            raise InputError(f"{name.name}: its equation holds more than position, and points have no clock")
        return experiment, fit_base(name, experiment)
    if name not in (CHOSEN_BY_DATA, *_SPRINGS):
        raise InputError(
            f"base {name}: points of a static test have no clock, and a spring alone can be fitted to them: {', '.join(_SPRINGS)}"
        )
    fastened = fit_base(BASES["LE"], experiment)
    met = None if name == "LE" else met_at_surface(experiment)
    if met is None or name == "LE-contact":
        return met or (experiment, fastened)
    rivals = [fastened, *extend(fastened, settings.candidates, experiment)]
    return met if met[1].score < min(item.score for item in rivals) else (experiment, fastened)


def _bends(model: Candidate, experiment: Experiment) -> bool:
    """Whether errors of neighbouring points are surely alike (J. von Neumann, Ann. Math. Stat. 12 (1941) 367-395)."""
    parts = [*experiment.training.records, *experiment.tests]
    position = np.concatenate([part.motion.position for part in parts])
    errors = np.concatenate([model.fit.errors(part) for part in parts])[np.argsort(position, kind="stable")]
    size, square = len(errors), float(np.sum(errors**2))
    if square <= 0:
        return False
    ratio = float(np.sum(np.diff(errors) ** 2)) / square
    spread = 2 * np.sqrt((size - 2) / (size**2 - 1))
    return bool((2 - ratio) / spread > UNSEEN)
