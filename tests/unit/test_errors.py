"""Collecting problems into one message."""

from __future__ import annotations

import pytest

from lumbar.errors import InputError, LumbarError, NumericalError, Problems


def test_nothing_is_raised_without_problems():
    Problems("file").raise_if_any()


def test_all_problems_stand_in_one_message():
    problems = Problems("trial.csv")
    problems.add("line 4", "force is 'abc'", "a number is needed")
    problems.add("", "no end")
    other = Problems("other.yaml")
    other.add("key", "wrong")
    problems.extend(other)
    with pytest.raises(InputError) as caught:
        problems.raise_if_any()
    assert str(caught.value).splitlines() == [
        "trial.csv: 3 problems",
        "  - line 4: force is 'abc'; a number is needed",
        "  - no end",
        "  - other.yaml: key: wrong",
    ]


def test_every_error_for_users_has_one_base():
    assert issubclass(InputError, LumbarError)
    assert issubclass(NumericalError, LumbarError)
