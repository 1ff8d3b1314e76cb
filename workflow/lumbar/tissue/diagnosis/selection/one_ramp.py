"""Records that cannot distinguish effects: the position rests throughout, or moves once in one direction at one speed."""

import numpy as np

from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.selection.candidate import Candidate, drop_effect, fit_base
from lumbar.tissue.diagnosis.selection.diagnosis_result import UNUSABLE, DiagnosisState, Status
from lumbar.tissue.diagnosis.selection.forward_selection import extend
from lumbar.tissue.diagnosis.selection.sentences import effects_text
from lumbar.tissue.models.bases import BASES, CHOSEN_BY_DATA, Base

_IMAGES = (
    (("drift", "softening", "second_relaxation", "relaxation_spectrum"), "hold a second, different depth"),
    (("coulomb_friction", "viscous_damping", "quadratic_damping"), "repeat the ramp ten times as slowly"),
    (("strain_softening", "hysteresis"), "return along the same path"),
)
"""Effects that give one ramp and its hold equal forces, since time, path and position follow from each other, and the
experiment that separates them."""
_MAX_SPEED_RATIO = 2.0
"""Largest ratio of the speeds of ramps that count as one speed."""
_MAX_RETURN_SHARE = 0.02
"""Largest motion back during a ramp and its hold, as a share of the range."""
_MAX_PAUSE_RATIO = 4.0
"""Largest ratio of the time for a tenth of a ramp to the median time: a longer one is a pause between two ramps."""
_MAX_ERROR_RATIO = 1.5
"""Largest ratio of a rival's errors to those of the model."""
_MIN_MEMORY = 0.5
"""Smallest correlation of neighbouring positions that move; counts of an encoder at rest are independent."""
_MIN_RESPONSE_CORRELATION = 0.3
"""Smallest correlation of position and force that shows a motion of independent positions."""


def check_motion(state: DiagnosisState) -> DiagnosisState:
    """Stop if the position rests in the training record: its force shows neither stiffness nor damping."""
    step, settings, experiment = "check the motion", state.settings, state.result.experiment
    data = experiment.training
    if not all(_rests(data.drop_history(one.motion.position), one.force) for one in data.records):
        return state.next(step, "the position moves in training")
    # Nothing distinguishes bases: a spring is the simplest.
    name = "LE" if settings.base == CHOSEN_BY_DATA else settings.base
    base = fit_base(name if isinstance(name, Base) else BASES[name], experiment)
    sentence = (
        f"The {experiment.input_quantity} does not move in {data.name}: its force shows neither stiffness nor damping, and any "
        "change of it may be relaxation, creep or drift. Include the ramp before the hold, or train on a record that moves."
    )
    finding = Finding("position_rests", sentence, 0.0, experiment.input_unit, data.name)
    changes = {**UNUSABLE, "base": base, "path": [base]}
    return state.next(step, "the position rests: nothing can be identified", finding, **changes)


def _rests(position: np.ndarray, force: np.ndarray) -> bool:
    """Return whether a position is constant, or the noise of an encoder at rest."""
    if np.ptp(position) == 0:
        return True
    if np.ptp(position[1:]) == 0 or np.ptp(position[:-1]) == 0:  # one step, at an end
        return False
    if np.corrcoef(position[1:], position[:-1])[0, 1] >= _MIN_MEMORY or np.ptp(force) == 0:
        return False
    return abs(np.corrcoef(position, force[-len(position) :])[0, 1]) < _MIN_RESPONSE_CORRELATION


def ramp_speed(position: np.ndarray, sampling_time: float) -> float | None:
    """Return the speed of a record that moves once in one direction, before or after holds; None for any other motion."""
    span = float(np.ptp(position))
    rise = (position - position[0]) * np.sign(position[-1] - position[0])
    returned = float(np.max(np.maximum.accumulate(rise) - rise))
    if span == 0 or max(returned, span - rise[-1]) > _MAX_RETURN_SHARE * span:
        return None
    passed = np.searchsorted(np.maximum.accumulate(rise), span * np.linspace(0.1, 0.9, 9))
    pauses = np.diff(passed)
    if pauses.max() > max(_MAX_PAUSE_RATIO * np.median(pauses), 2):
        return None
    return 0.8 * span / (max(passed[-1] - passed[0], 1) * sampling_time)


def check_one_ramp(state: DiagnosisState) -> DiagnosisState:
    """Tie effects that ramps of one speed cannot distinguish."""
    step, result, effects = "check one ramp", state.result, state.effects
    experiment = result.experiment
    speeds = [ramp_speed(record["input"], record.sampling_time) for record in experiment.records]
    if None in speeds or max(speeds) > _MAX_SPEED_RATIO * min(speeds):
        return state.next(step, "not needed: the records move in more than one direction, step or speed")
    named = [(name, *image) for name in result.selected for image in _IMAGES if name in image[0]]
    if result.status not in (Status.NAMED, Status.TIED) or not named:
        return state.next(step, "not needed: no effect is named that one ramp cannot show")
    known = {frozenset(item.effects) for item in result.tied_with}
    rivals: list[Candidate] = []
    for name, others, _ in named:
        start = drop_effect(result.model, name, experiment)
        allowed = {
            other: effects[other] for other in others if other in effects and other not in result.selected
        }
        fitted = extend(start, allowed, experiment)
        best = {item.effects[-1]: item for item in reversed(fitted)}.values()
        near = [item for item in best if _is_near(item, result.model)] or fitted[:1]
        rivals += [item for item in near if frozenset(item.effects) not in known]
    tied = [*result.tied_with, *rivals]
    names = effects_text([name for name, _, _ in named])
    experiments = " and ".join(dict.fromkeys(text for _, _, text in named))
    sentence = (
        f"The records move once, in one direction and at one speed, so time, path and position follow from each other and "
        f"{names} cannot be distinguished from the effects tied with it. To separate them, {experiments}."
    )
    finding = Finding("one_ramp", sentence, max(speeds), f"{experiment.input_unit}/s")
    reason = f"one ramp cannot distinguish {names} from {len(rivals)} further rivals"
    return state.next(step, reason, finding, status=Status.TIED if tied else result.status, tied_with=tied)


def _is_near(rival: Candidate, model: Candidate) -> bool:
    """Return whether the errors of a rival are similar to those of the model."""
    pairs = (rival.train_rms, model.train_rms), (rival.test_rms, model.test_rms)
    return all(other <= _MAX_ERROR_RATIO * own for other, own in pairs)
