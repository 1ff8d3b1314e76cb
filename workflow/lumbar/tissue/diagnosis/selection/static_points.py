"""Diagnosis of a spring from points of a static test: a table of position and force without a clock."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import scipy

from lumbar.base.errors import InputError
from lumbar.records.record import Record, require_same_units
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.preparation import (
    Experiment,
    assemble_experiment,
    check_unseen,
    choose_training,
)
from lumbar.tissue.diagnosis.selection.alternatives import report_zeros
from lumbar.tissue.diagnosis.selection.base_choice import first_surface, fit_at_surface
from lumbar.tissue.diagnosis.selection.candidate import Candidate, fit_base
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisState, Status
from lumbar.tissue.diagnosis.selection.forward_selection import Selection, extend, find_ties, select_effects
from lumbar.tissue.diagnosis.selection.thresholds import LEVEL, UNSEEN
from lumbar.tissue.effects.catalogue import filter_forms
from lumbar.tissue.models.bases import BASES, CHOSEN_BY_DATA, Base
from lumbar.tissue.models.motion import Motion

MIN_POINTS = 12
"""Smallest number of points of a table: a third of the points is the test if there is only one table."""
_TEST_STRIDE = 3
"""Interval of test points: one in this number of points, in the order of positions, is used as test."""
_STATIC_BASES = ("LE", "LE-contact")


def prepare_points(state: DiagnosisState) -> DiagnosisState:
    """Prepare points in the order of their positions; one point in three is unseen if there is only one table.

    Points without a clock do not show rates, delays, relaxation, hysteresis, drift or faults of a clock: these are not searched,
    and nothing is filtered.

    Raises
    ------
    InputError
        If tables with and without a clock are mixed, a table has few points, or the base is not one of a static test.
    """
    experiment = _prepare_tables(state.records, state.settings)
    candidates, scale = state.settings.candidates, experiment.training.scale
    catalogue = filter_forms(candidates, lambda form: form.is_static, scale)
    unseen = "Other tables are the unseen points"
    if experiment.tests[0].name == experiment.training.records[0].name:
        unseen = f"One point in {_TEST_STRIDE} was held back as unseen"
    count = sum(len(record) for record in experiment.records)
    sentence = (
        f"These {count} points have no clock and are treated as a static test: only laws of {experiment.input_quantity} were "
        f"tried, because rates, delays, relaxation, hysteresis, drift and faults of a clock cannot be seen in them. {unseen}; "
        "nothing was filtered."
    )
    changes = {"experiment": experiment, "settings": state.settings.limit(catalogue, most_effects=1)}
    reason = f"{count} points without a clock; {len(catalogue)} laws of position can be tried"
    finding = Finding("static_points", sentence, float(count), "1")
    return state.next("prepare points", reason, finding, **changes)


def choose_spring(state: DiagnosisState) -> DiagnosisState:
    """Choose the spring of the settings, or the likelier of a fastened spring and a spring with contact.

    The latter must also be better than every law with the fastened spring.

    Raises
    ------
    InputError
        For a base that depends on more than position.
    """
    experiment, name = state.result.experiment, state.settings.base
    if isinstance(name, Base):
        if not name.form.is_static:
            raise InputError(f"{name.name}: its equation holds more than position, and points have no clock")
        base = fit_base(name, experiment)
    elif name not in (CHOSEN_BY_DATA, *_STATIC_BASES):
        raise InputError(
            f"base {name}: points of a static test have no clock, and a spring alone can be fitted to them: "
            f"{', '.join(_STATIC_BASES)}"
        )
    else:
        base = fit_base(BASES["LE"], experiment)
        if name != "LE" and first_surface(experiment) is not None:
            met, touching = fit_at_surface(experiment, ("LE-contact",))
            rivals = (
                [] if name == "LE-contact" else [base, *extend(base, state.settings.candidates, experiment)]
            )
            if all(touching.score < item.score for item in rivals):
                experiment, base = met, touching
    reason = f"{base.fit.structure.base.name}: error {base.test_rms:.4g} {experiment.output_unit} on {experiment.test_data}"
    return state.next("choose the base", reason, experiment=experiment, base=base, path=[base])


def check_loops(state: DiagnosisState) -> DiagnosisState:
    """Check whether the force differs between loading and unloading: no law of position explains a loop."""
    step, result = "check loops", state.result
    experiment, model = result.experiment, result.model
    forward, backward = [], []
    for record in experiment.records:
        position = record["input"] - experiment.surface
        error = record["output"] - model.fit.simulate(Motion(np.arange(float(len(position))), position, 1.0))
        # A point belongs to the direction in which the table both reaches and leaves it.
        steps = np.sign(np.diff(position))
        direction = np.concatenate([[0.0], np.where(steps[:-1] == steps[1:], steps[1:], 0.0), [0.0]])
        forward += error[direction > 0].tolist()
        backward += error[direction < 0].tolist()
    width = abs(float(np.mean(forward) - np.mean(backward))) if min(len(forward), len(backward)) > 2 else 0.0
    scatter = np.std([*forward, *backward]) if width else 0.0
    if width <= scatter or scipy.stats.ttest_ind(forward, backward, equal_var=False).pvalue > LEVEL**2:
        return state.next(step, "the force does not differ between loading and unloading")
    unit, quantity = experiment.output_unit, experiment.output_quantity
    sentence = (
        f"The {quantity} differs by {width:.3g} {unit} between loading and unloading: the points form loops, which no law of "
        f"{experiment.input_quantity} explains. Give a clock: a column of times, or '--rate' of 'lumbar import'."
    )
    changes = {"status": Status.UNEXPLAINED, "refined_status": Status.UNEXPLAINED, "tied_with": []}
    return state.next(step, "loops: give a clock", Finding("loops", sentence, width, unit), **changes)


def check_curve(state: DiagnosisState) -> DiagnosisState:
    """Check whether errors of neighbouring points are correlated: the points then follow a curve that no tried law describes."""
    step, result = "check the curve", state.result
    # Neighbours are compared by J. von Neumann's ratio (Ann. Math. Stat. 12 (1941) 367-395).
    parts = [*result.experiment.training.records, *result.experiment.tests]
    order = np.argsort(np.concatenate([part.motion.position for part in parts]), kind="stable")
    errors = np.concatenate([result.model.fit.errors(part) for part in parts])[order]
    size, square = len(errors), float(np.sum(errors**2))
    ratio = float(np.sum(np.diff(errors) ** 2)) / square if square > 0 else 2.0
    if (2 - ratio) / (2 * np.sqrt((size - 2) / (size**2 - 1))) <= UNSEEN:
        return state.next(step, "errors of neighbouring points differ as noise does")
    status = result.status if result.selected else Status.UNEXPLAINED
    reason = "errors of neighbouring points are correlated: no law tried has this curve"
    return state.next(step, reason, status=status, refined_status=Status.UNEXPLAINED)


class StaticSelection(Selection):
    """A search with p-values of the F test, because the simulated null experiments have long records and all effects."""

    def p_value(self, before: Candidate, after: Candidate) -> float:
        """Return an upper bound (Bonferroni) of the probability of as large a gain by the best form if nothing is missing."""
        more = after.parameters - before.parameters
        left = self.experiment.training.size - after.parameters - 1
        gained = max(before.fit.squared_error / max(after.fit.squared_error, 1e-300) - 1, 0.0)
        return float(min(1.0, self.forms * scipy.special.fdtrc(more, left, gained * left / more)))


POINT_STEPS = (
    prepare_points,
    choose_spring,
    partial(select_effects, kind=StaticSelection),
    find_ties,
    check_loops,
    check_curve,
    report_zeros,
)


def _prepare_tables(records: Sequence[Record], settings: DiagnosisSettings) -> Experiment:
    """Return points as training and unseen data, both in the order of positions."""
    require_same_units(list(records))
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
        if len(record) < MIN_POINTS:
            raise InputError(
                f"{record.source or record.name}: {len(record)} points of a static test; at least {MIN_POINTS} are needed"
            )
    chosen, others = choose_training(records, settings.train)
    check_unseen(chosen, others)
    fitted, tests = [_sort_points(record) for record in chosen], [_sort_points(record) for record in others]
    if not tests:
        tests = [_sort_points(record, lambda number: number % _TEST_STRIDE == 1) for record in chosen]
        fitted = [_sort_points(record, lambda number: number % _TEST_STRIDE != 1) for record in chosen]
    return assemble_experiment(chosen[0], fitted, tests, None, records=tuple(records)).shift_to_rest()


def _sort_points(record: Record, is_used: Callable[[np.ndarray], np.ndarray] | None = None) -> FitData:
    """Return the points in the order of their positions; only points with places that meet `is_used`, if given."""
    order = np.argsort(record["input"], kind="stable")
    if is_used is not None:
        order = order[is_used(np.arange(len(order)))]
    number = np.arange(float(len(order)))
    return FitData(record.name, Motion(number, record["input"][order], 1.0), record["output"][order])
