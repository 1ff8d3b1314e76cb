"""Hidden effects in three axes are told for what they are, whatever the tissue's symmetry and the sensor's axes."""

import pytest
from ask_cases import CASES, ask, held, is_right

FAST = "hardening"
"""The case that is asked with the fast tests."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name == FAST else pytest.mark.nightly) for name in CASES]
)
def test_a_case_is_told_right(name):
    answer, truth = ask(name, 1)
    assert is_right(CASES[name]["expected"], answer), answer.words
    outside = [key for key, inside in held(answer, truth) if not inside]
    # Parameters of one fit are wide of the truth together, of a frame and a tissue in it most.
    assert len(outside) <= 4, outside
