"""The examples in the docstrings of the Python interface run and give what they show."""

import doctest
import inspect
import sys

import pytest

import lumbar

PUBLIC = {name: getattr(lumbar, name) for name in lumbar.__all__}
FUNCTIONS = {name: value for name, value in PUBLIC.items() if inspect.isfunction(value)}
MODULES = sorted({value.__module__ for value in FUNCTIONS.values()} | {"lumbar.interface.result"})
SLOW = {"lumbar.interface.device"}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.nightly] * (name in SLOW)) for name in MODULES]
)
def test_examples_print_what_they_show(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    __import__(name)
    result = doctest.testmod(sys.modules[name])
    assert result.attempted and not result.failed


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_function_has_an_example(name):
    assert ">>> " in FUNCTIONS[name].__doc__
