"""The judges of the acceptance suites: what is right, what is honest, and what is confidently wrong."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from answers import Answer
from hidden_effects_cases import diagnosis

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / "hard_effects"), str(TESTS / "real_records")]

import case_judging as cases  # noqa: E402
import record_judging as records  # noqa: E402

FRICTION = cases.Label("a", "", "single", ("coulomb_friction",), "", (), (8.0,), 0.1, "")
LINEAR = replace(FRICTION, family="k", kind="none", hidden=(), residual_over_noise=())
TOOL = records.Expectation(
    "tool", "", ("hysteresis",), "N", "Dahl", allowed=("backlash",), parameters={"mass": 2.0}
)


def answer(*words, settled=False, findings=(), **keys) -> Answer:
    kinds = [{"kind": kind} for kind in findings]
    return Answer({**diagnosis(*words, **keys), "settled": settled, "findings": kinds, "ranking": []})


INCOMPLETE = {"complete": False, "after": "unexplained"}


HELD, LATE = replace(FRICTION, fault="hold"), replace(FRICTION, fault="lag", allowed=("delay",))
WEAK = replace(FRICTION, residual_over_noise=(0.2,))
PAIR = replace(FRICTION, hidden=("coulomb_friction", "drift"))
OUTSIDE = replace(FRICTION, family="i")
TIE = replace(FRICTION, kind="tie")
ORDER = replace(LINEAR, family="f", allowed=("second_relaxation",))


def named(*effects, **more) -> Answer:
    return answer("named", effects, **more)


def tied(**more) -> Answer:
    return answer("tied", ["hysteresis"], ["coulomb_friction"], **more)


@pytest.mark.parametrize(
    ("label", "given", "judgement"),
    [
        (FRICTION, named("coulomb_friction"), "right"),
        (FRICTION, named("hysteresis"), "WRONG"),
        (FRICTION, named("coulomb_friction", "drift", **INCOMPLETE), "WRONG"),
        (FRICTION, tied(), "tied"),
        (FRICTION, answer("adequate"), "WRONG"),
        (WEAK, answer("adequate"), "flagged"),
        (FRICTION, answer("unexplained", ["drift"]), "flagged"),
        (FRICTION, Answer(refusal="clipped"), "refused"),
        (FRICTION, Answer(crash="ZeroDivisionError"), "crash"),
        (HELD, named("coulomb_friction"), "part"),
        (HELD, named("coulomb_friction", findings=["held_samples"]), "right"),
        (LATE, named("coulomb_friction", "delay"), "right"),
        (PAIR, named("drift"), "WRONG"),
        (PAIR, named("drift", **INCOMPLETE), "flagged"),
        (replace(PAIR, family="b"), named("drift", **INCOMPLETE), "right"),
        (OUTSIDE, named("coulomb_friction"), "WRONG"),
        (OUTSIDE, answer("unexplained", **INCOMPLETE), "part"),
        (OUTSIDE, answer("unexplained", findings=["proposed_law"], **INCOMPLETE), "right"),
        (TIE, tied(settled=True), "right"),
        (TIE, tied(), "part"),
        (TIE, named("hysteresis"), "WRONG"),
        (LINEAR, answer("adequate"), "right"),
        (LINEAR, answer("unexplained"), "flagged"),
        (LINEAR, named("drift"), "WRONG"),
        (replace(LINEAR, tag="palpation"), named("contact_loss"), "right"),
        (ORDER, answer("adequate"), "WRONG"),
        (ORDER, answer("unexplained", findings=["higher_order_linear"]), "right"),
    ],
)
def test_labelled_cases_are_judged_by_their_table(label, given, judgement):
    assert cases.judge(label, given)[0] == judgement


def with_mass(low: float, high: float) -> Answer:
    given = answer("named", ["hysteresis"])
    mass = {"value": (low + high) / 2, "low": low, "high": high}
    return replace(given, document={**given.document, "ranking": [{"parameters": {"mass": mass}}]})


@pytest.mark.parametrize(
    ("given", "judgement"),
    [
        (answer("named", ["hysteresis"]), "right"),
        (answer("named", ["hysteresis", "backlash"]), "right"),
        (answer("named", ["hysteresis", "drift"]), "WRONG"),
        (answer("named", ["backlash"]), "WRONG"),
        (answer("named", ["backlash"], **INCOMPLETE), "flagged"),
        (answer("tied", ["backlash"], ["hysteresis"]), "tied"),
        (answer("adequate"), "WRONG"),
        (answer("unexplained"), "flagged"),
        (answer("named", ["hysteresis"], test_rms=1.3), "part"),
        (with_mass(1.9, 2.1), "right"),
        (with_mass(1.5, 1.9), "part"),
    ],
)
def test_real_records_are_judged_by_names_error_and_parameters(given, judgement):
    assert records.judge(TOOL, 1.0, given)[0] == judgement
