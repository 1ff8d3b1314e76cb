"""Tissue experiments as a bench would bring them, with labels: the diagnosis gives the answer that README.md asks for."""

import pytest
from case_judging import NOT_YET, ask_case, judge, read_labels

from answers import RIGHT, SHARED, absent, surprise

FOLDER = SHARED / "hard_effects"
QUICK = ("c04", "g12")
"""Tried by every run of the tests."""
NIGHTLY = ("d00", "f01", "f11", "k18")
"""Tried by ``make test-statistical``; the others by ``make acceptance``."""


def cases() -> list:
    if not (FOLDER / "labels.json").is_file():
        return [pytest.param("all", marks=pytest.mark.skip(reason=absent(FOLDER, "hard_effects")))]
    return [parameter(case) for case in read_labels(FOLDER)]


def parameter(case: str):
    marks = [] if case in QUICK else [pytest.mark.nightly if case in NIGHTLY else pytest.mark.acceptance]
    if reason := NOT_YET.get(case):
        marks.append(pytest.mark.xfail(strict=True, raises=AssertionError, reason=reason))
    return pytest.param(case, marks=marks)


@pytest.mark.parametrize("case", cases())
def test_the_answer_is_the_right_one(case):
    label, answer = read_labels(FOLDER)[case], ask_case(FOLDER / case)
    judgement, why = judge(label, answer)
    if words := surprise(case, judgement, why, NOT_YET.get(case, "")):
        pytest.fail(words)
    assert judgement in RIGHT, f"{judgement}: {why}"
