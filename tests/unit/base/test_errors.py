"""Collecting problems into one message."""

import errno

import numpy as np
import pytest

from lumbar.base.errors import InputError, Problems, user_message
from refusing import refusal


def test_problems_are_joined_in_one_message():
    problems = Problems("trial.csv")
    problems.add("line 4", "force is 'abc'", "a number is needed")
    problems.add("", "no end")
    other = Problems("other.yaml")
    other.add("key", "wrong")
    problems.extend(other)
    assert refusal(problems.raise_if_any).splitlines() == [
        "trial.csv: 3 problems",
        "  - line 4: force is 'abc'; a number is needed",
        "  - no end",
        "  - other.yaml: key: wrong",
    ]


def raised(action):
    with pytest.raises(Exception) as caught:
        action()
    return caught.value


def test_user_errors_are_explained(tmp_path):
    assert user_message(InputError("a.csv: empty")) == "a.csv: empty"
    absent = tmp_path / "absent.csv"
    assert user_message(raised(absent.read_text)) == f"{absent}: No such file or directory"
    assert "No space left on device" in user_message(OSError(errno.ENOSPC, "No space left on device"))


def test_arithmetic_out_of_range_names_its_place():
    from lumbar.tissue.diagnosis.fitting.joint_fit import solve_linear

    for error in (
        raised(lambda: 10.0**400),
        raised(lambda: solve_linear(np.full((9, 2), np.nan), np.ones(9), (1, 1))),
    ):
        assert str(error) in user_message(error)
    assert "joint_fit.py, line " in user_message(error)
