"""The judges of the acceptance suites: what is right, what is honest, and what is confidently wrong."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from answers import Answer
from hidden_effects_cases import diagnosis

TESTS = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(TESTS / "hard_effects"))

import case_judging as cases  # noqa: E402

FRICTION = cases.Label("a", "", "single", ("coulomb_friction",), "", (), (8.0,), 0.1, "")
LINEAR = replace(FRICTION, family="k", kind="none", hidden=(), residual_over_noise=())


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
