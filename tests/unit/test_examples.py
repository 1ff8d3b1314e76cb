"""The examples in the docstrings of the Python interface run and give what they show."""

import doctest
import sys

import pytest

import lumbar

VERBS = {name: getattr(lumbar, name) for name in lumbar.__all__}
MODULES = sorted({verb.__module__ for verb in VERBS.values()} | {"lumbar.interface.result"})


SLOW = {"lumbar.interface.device"}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.nightly] * (name in SLOW)) for name in MODULES]
)
def test_examples_give_what_they_show(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    __import__(name)
    found = doctest.testmod(sys.modules[name])
    assert found.attempted and not found.failed


@pytest.mark.parametrize("name", VERBS)
def test_every_verb_has_an_example(name):
    assert ">>> " in VERBS[name].__doc__
