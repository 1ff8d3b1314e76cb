"""Values, states, errors, instances and the order of calls of finished FMUs, driven through fmpy."""

import math

import pytest
from c_programs import ON_LINUX
from effect_entries import BASE_NUMBERS, FORM_NUMBERS
from fmpy.fmi1 import FMICallException
from runtime_models import (
    FORCE,
    FORCE_LIMIT,
    FORCE_OFFSET,
    GAIN,
    POSITION,
    POSITION_OFFSET,
    get,
    put,
)

pytestmark = ON_LINUX


@pytest.mark.parametrize("version", [2, 3])
def test_overflow_keeps_the_last_finite_force(version, fmu_instance):
    slave = fmu_instance("HO", version)
    put(slave, POSITION, 1.0)
    slave.exitInitializationMode()
    slave.doStep(0.0, 0.01)
    for k in range(1, 50):
        put(slave, POSITION, 1.7e308)
        slave.doStep(k * 0.01, 0.01)
        assert abs(get(slave)) <= 15.0
    for k in range(50, 4000):
        put(slave, POSITION, -0.4)
        slave.doStep(k * 0.01, 0.01)
    assert get(slave) == pytest.approx(-0.3, abs=1e-9)


@pytest.mark.parametrize("version", [2, 3])
def test_limit_gain_and_offsets(version, fmu_instance):
    slave = fmu_instance("KB", version)
    put(slave, POSITION, 1.0)
    plain = 1.9 / 3
    assert get(slave) == pytest.approx(plain)
    put(slave, GAIN, 2.0)
    put(slave, FORCE_OFFSET, -0.5)
    assert get(slave) == pytest.approx(2 * plain - 0.5)
    put(slave, FORCE_LIMIT, 0.6)
    assert get(slave) == 0.6
    put(slave, POSITION, -1.0)
    assert get(slave) == -0.6
    put(slave, POSITION_OFFSET, -1.0)
    assert get(slave) == -0.5
    put(slave, POSITION, 1e300)
    assert get(slave) == 0.6


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    ("reference", "value"),
    [
        (GAIN, -0.1),
        (GAIN, 10.1),
        (GAIN, math.nan),
        (FORCE_LIMIT, 15.1),
        (FORCE_LIMIT, -1.0),
        (FORCE_LIMIT, math.nan),
        (FORCE_OFFSET, 15.1),
        (POSITION_OFFSET, math.inf),
        (FORCE, 1.0),
        (99, 1.0),
    ],
)
def test_values_out_of_range_are_errors_and_change_nothing(version, reference, value, fmu_instance):
    slave = fmu_instance("KB", version)
    put(slave, POSITION, 1.0)
    before = [get(slave, known) for known in range(1, 7)]
    with pytest.raises(FMICallException):
        put(slave, reference, value)
    assert [get(slave, known) for known in range(1, 7)] == before


def test_fmi2_warns_of_the_late_feedthrough(fmu_instance, capfd):
    """The warning is for models with feed-through only: MW has none."""
    for name, expected in (("KB", True), ("MW", False)):
        fmu_instance(name, 2).exitInitializationMode()
        assert ("one sample late" in capfd.readouterr().out) == expected


def derivative(slave, known: int) -> float:
    """Derivative of the force by one variable."""
    return slave.getDirectionalDerivative([FORCE], [known], [1.0])[0]


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("limited", [False, True])
def test_directional_derivatives_are_difference_quotients(limited, version, fmu_instance):
    """At a pending sample, by central differences; the force is linear in each variable alone."""
    slave = fmu_instance("KB", version, event_mode=version == 3)
    put(slave, POSITION, 40.0 if limited else 1.5)
    values = {
        POSITION: 40.0 if limited else 1.5,
        POSITION_OFFSET: 0.0,
        GAIN: 1.0,
        FORCE_OFFSET: 0.0,
        FORCE_LIMIT: 14.0,
    }
    put(slave, FORCE_LIMIT, 14.0)
    for reference, value in values.items():
        quotient = 0.0
        for sign in (1, -1):
            put(slave, reference, value + sign * 1e-3)
            quotient += sign * get(slave) / 2e-3
        put(slave, reference, value)
        assert derivative(slave, reference) == pytest.approx(quotient, abs=1e-9), reference
    assert derivative(slave, POSITION) == pytest.approx(0.0 if limited else 1.9 / 3)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("position", [0.4, -1.3])
def test_directional_derivatives_with_effects_are_those_of_the_formula(position, version, fmu_instance):
    """KB with F_c tanh(v/v_s) after a step from rest, by hand: spring, branch, friction, backward difference."""
    slave = fmu_instance("KB+coulomb_friction", version, event_mode=version == 3)
    slave.exitInitializationMode()
    if version == 3:
        slave.enterStepMode()
    slave.doStep(0.0, 0.01)
    if version == 3:
        slave.enterEventMode()
    moved = position * 0.01
    put(slave, POSITION, moved)
    (spring, branch), (tau,) = BASE_NUMBERS["KB"]
    (friction,), (smoothing,) = FORM_NUMBERS["coulomb_friction/coulomb"]
    relaxed = tau / 0.01 * -math.expm1(-0.01 / tau)
    sliding = friction / (smoothing * 0.01) / math.cosh(moved / 0.01 / smoothing) ** 2
    assert derivative(slave, POSITION) == pytest.approx(spring + branch * relaxed + sliding, rel=1e-6)
    assert derivative(slave, POSITION_OFFSET) == -derivative(slave, POSITION)


@pytest.mark.parametrize("version", [2, 3])
def test_derivatives_of_other_variables_are_refused(version, fmu_instance):
    slave = fmu_instance("KB", version)
    with pytest.raises(FMICallException):
        slave.getDirectionalDerivative([GAIN], [POSITION], [1.0])
    with pytest.raises(FMICallException):
        slave.getDirectionalDerivative([FORCE], [FORCE], [1.0])
