"""Public records of which it is known what linear models miss: the diagnosis names it, with an error as published."""

from functools import partial

import pytest
from data_sets import READERS
from record_judging import expectations, judge

from answers import RIGHT, absent, ask, surprise

EXPECTATIONS = expectations()
QUICK = ("coupled_drives_1",)
"""Tried by every run of the tests, as the friction damper is nightly by its study; the others by ``make acceptance``."""


def parameter(name: str):
    marks = [] if name in QUICK else [pytest.mark.acceptance]
    if reason := EXPECTATIONS[name].not_yet:
        marks.append(pytest.mark.xfail(strict=True, raises=AssertionError, reason=reason))
    return pytest.param(name, marks=marks)


def test_every_entry_has_a_reader():
    assert EXPECTATIONS.keys() == READERS.keys()


@pytest.mark.parametrize("name", map(parameter, EXPECTATIONS))
def test_what_is_known_is_found(shared, name):
    folder = shared / "real"
    if words := absent(folder / name_of_folder(name), "real_records"):
        pytest.skip(words)
    expected, answer = EXPECTATIONS[name], ask(partial(READERS[name], folder))
    best = expected.published("best", READERS[name](folder)[0])
    judgement, why = judge(expected, best, answer)
    if words := surprise(name, judgement, why, expected.not_yet):
        pytest.fail(words)
    assert judgement in RIGHT, f"{judgement}: {why}"


def name_of_folder(name: str) -> str:
    """An entry's name is that of its folder, and what is done with it."""
    return next(item for item in ("coupled_drives", "bouc_wen", name) if name.startswith(item))
