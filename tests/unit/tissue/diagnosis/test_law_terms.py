"""Every term that a law may hold is dimensionally sound, finite, and the effect's file that it is written to can be read."""

import numpy as np
import pytest

from lumbar.base.errors import InputError
from lumbar.tissue.diagnosis.law.law_form import (
    FORCE,
    OF_SIGNALS,
    Dimension,
    dimension,
    distinct,
    form_of,
)
from lumbar.tissue.diagnosis.law.terms import library
from lumbar.tissue.effects.signature import standard_motion
from lumbar.tissue.models.expression import parse
from lumbar.tissue.models.form import Place


def term(name: str):
    return next(item for item in library() if item.name == name)


@pytest.mark.parametrize(
    "unit", ["{y}", "{y}/{x}", "{y} s/{x}", "{y} s^2/{x}", "{y}/{x}^1.5", "1", "s", "1/s"]
)
def test_unit_is_written_as_it_is_read(unit):
    assert Dimension.parse(unit).unit == unit


def test_dimension_of_a_force():
    known = {**OF_SIGNALS, "c": Dimension.parse("{y} s^2/{x}^2"), "d": Dimension.parse("{x}")}
    assert dimension(parse("c*v*abs(v)*exp(-z/d)"), known) == FORCE
    assert dimension(parse("where(z > d, 0, c*max(v, 0)**2)"), known) == FORCE


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("z + v", r"^z \+ v: .*\{x\}.*\{x\}/s\b"),
        ("tanh(v)", r"^tanh\(v\): v\b.*\bunit\b"),
        ("where(z > v, z, 0)", r"^z > v: .*\{x\}.*\{x\}/s\b"),
    ],
)
def test_different_dimensions_are_rejected(text, message):
    with pytest.raises(InputError, match=message):
        dimension(parse(text), OF_SIGNALS)


def known_dimensions(item):
    """Dimensions of the symbols of a term or form; states whose names begin with q, u or m are positions."""
    parameters = (*getattr(item, "linear", ()), *item.nonlinear, *item.constants)
    states = {name: Dimension(x=float(name[0] in "qum")) for name, _ in item.state}
    return {**OF_SIGNALS, **{one.symbol: Dimension.parse(one.unit) for one in parameters}, **states}


def check_dimensions(item):
    """Refuse a term of which a part or the rate of a state is dimensionally unsound."""
    known = known_dimensions(item)
    for part in item.parts:
        assert dimension(parse(part), known) == FORCE or item.place is not Place.OUTPUT, part
    for name, rate in item.state:
        assert dimension(parse(rate), known) in (None, known[name] * Dimension(s=-1)), (name, rate)


def test_every_term_is_dimensionally_valid_and_makes_a_form():
    for item in library():
        check_dimensions(item)
        form = form_of((item,))
        form.check()
        if form.place is Place.PARALLEL:
            assert dimension(parse(form.equation), known_dimensions(form)) == FORCE, item.name


def test_states_solved_term_by_term_are_those_of_the_whole_form():
    from dataclasses import replace

    form = form_of((term("branch"), term("stiffness_unloading")))
    motion, nonlinear = standard_motion(0.5), np.array([0.2, 0.3])
    together = replace(form, solution=None).columns(motion, nonlinear)
    for one, other in zip(form.columns(motion, nonlinear), together, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)


def test_symbols_of_terms_are_distinct_or_shared():
    terms = term("friction"), term("friction_z")
    assert form_of(terms).equation == "F_1*tanh(v/v_s) + k_2*z*tanh(v/v_s2)"
    assert form_of(terms, shared=True).equation == "F_1*tanh(v/v_s) + k_2*z*tanh(v/v_s)"
    assert [item.unit for item in form_of(terms).linear] == ["{y}", "{y}/{x}"]
    one, other = distinct((term("branch"), term("branch_z")))
    assert one.state == (("q", "v - q/tau"),)
    assert other.state == (("q2", "v - q2/tau_2"),)


def test_adhesion_pulls_until_it_tears():
    """The switching state against a walk through the samples."""
    motion = standard_motion(0.5)
    held, expected = False, []
    for z in motion.position:
        held = True if z > 0 else False if z < -0.4 else held
        expected.append(z if held and -0.4 <= z < 0 else 0.0)
    (result,) = form_of((term("adhesion"),)).columns(motion, np.array([0.4]))
    assert np.mean(np.abs(result - expected) > 0.02) < 0.01
    assert result.min() < -0.35
