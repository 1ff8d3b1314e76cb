"""Finished FMUs driven through fmpy, against a simulation written out in Python, and against their own description."""

import math
import struct

import numpy as np
import pytest
from c_programs import ON_LINUX
from driven_fmu import DrivenFmu, DrivenInstance, Motion, modes
from fmpy.fmi1 import FMICallException
from fmu_behaviour import problems_of
from runtime_models import (
    FORCE,
    FORCE_LIMIT,
    GAIN,
    POSITION,
    POSITION_OFFSET,
    device_models,
    export,
    get,
    set_variable,
    unzipped,
)

pytestmark = ON_LINUX


def written_out(model, fmu_positions):
    """C x[k] and D u[k] of every sample, by the difference equation and a moving average in plain Python."""
    inputs = [position - model.input.offset for position in fmu_positions]
    averaged = [
        sum(inputs[max(0, k - model.moving_average + 1) : k + 1]) / model.moving_average
        for k in range(len(inputs))
    ]
    outputs = []
    for k in range(len(inputs)):
        value = sum(b * averaged[k - j] for j, b in enumerate(model.dynamics.numerator) if k >= j)
        value -= sum(a * outputs[k - i] for i, a in enumerate(model.dynamics.denominator) if 0 < i <= k)
        outputs.append(value)
    through = [model.dynamics.numerator[0] * u for u in averaged]
    return np.array(outputs) - through, np.array(through)


@pytest.mark.parametrize("name", ["IL", "MW", "KB", "HO"])
def test_fmi2_client_reads_the_feedthrough_one_sample_late(name, fmu_models, fmu_instance, fmu_positions):
    model = next(model for model in fmu_models if model.name == name)
    state_part, through = written_out(model, fmu_positions)
    slave = fmu_instance(name, 2)
    set_variable(slave, POSITION, fmu_positions[0])
    slave.exitInitializationMode()
    forces = [get(slave)]
    for k in range(len(fmu_positions) - 1):
        set_variable(slave, POSITION, fmu_positions[k])
        slave.doStep(k * 0.01, 0.01)
        forces.append(get(slave))
    late = np.concatenate([through[:1], through[:-1]])
    np.testing.assert_allclose(forces, state_part + late + model.output.offset, atol=1e-12)


@pytest.mark.parametrize("name", ["IL", "MW", "KB", "HO"])
def test_fmi3_event_mode_has_no_delay(name, fmu_models, fmu_instance, fmu_positions):
    model = next(model for model in fmu_models if model.name == name)
    state_part, through = written_out(model, fmu_positions)
    slave = fmu_instance(name, 3, event_mode=True)
    slave.exitInitializationMode()
    forces = []
    for k, position in enumerate(fmu_positions):
        if k:
            event, _, early, _ = slave.doStep((k - 1) * 0.01, 0.01)
            assert event
            assert not early
            slave.enterEventMode()
        set_variable(slave, POSITION, position)
        before_update = get(slave)
        more, *_, defined, next_event = slave.updateDiscreteStates()
        assert (more, defined) == (False, True)
        assert next_event == pytest.approx((k + 1) * 0.01, abs=1e-12)
        after_update = get(slave)
        slave.enterStepMode()
        assert before_update == after_update == get(slave)
        forces.append(after_update)
    np.testing.assert_allclose(forces, state_part + through + model.output.offset, atol=1e-12)


def test_event_iteration_may_change_the_input(fmu_models, fmu_instance):
    slave = fmu_instance("KB", 3, event_mode=True)
    slave.exitInitializationMode()
    for position in (5.0, -3.0, 1.0):
        set_variable(slave, POSITION, position)
        slave.updateDiscreteStates()
        assert get(slave) == pytest.approx(1.9 * position / 3, rel=1e-15)
    slave.enterStepMode()
    set_variable(slave, POSITION, 100.0)
    assert get(slave) == pytest.approx(1.9 / 3, rel=1e-15)


def test_early_return_leads_to_every_sample(fmu_folder, tmp_path):
    slave = DrivenFmu(unzipped(fmu_folder / "KB_fmi3.fmu", tmp_path / "fmu")).slave
    slave.instantiate(eventModeUsed=True, earlyReturnAllowed=True, logMessage=lambda *_: None)
    slave.enterInitializationMode(startTime=0.0)
    slave.exitInitializationMode()
    slave.updateDiscreteStates()
    slave.enterStepMode()
    time, instants = 0.0, []
    while time < 0.095:
        event, _, early, time = slave.doStep(time, 0.095 - time)
        assert early == event == (time < 0.094)
        if event:
            instants.append(time)
            slave.enterEventMode()
            slave.updateDiscreteStates()
            slave.enterStepMode()
    np.testing.assert_allclose(instants, np.arange(1, 10) * 0.01, atol=1e-12)


def test_decayed_states_are_flushed_to_zero(fmu_instance):
    # 0.72 is such that rounding keeps an unflushed state at the smallest denormal number for ever.
    slave = fmu_instance("HO", 2)
    set_variable(slave, POSITION, 1.0)
    slave.exitInitializationMode()
    slave.doStep(0.0, 0.01)
    set_variable(slave, POSITION, -0.4)
    slave.doStep(0.01, 60.0)
    saved = slave.getFMUstate()
    content = slave.serializeFMUstate(saved)
    slave.freeFMUstate(saved)
    # Magic (8 bytes) and token (36) come before the states.
    assert struct.unpack_from("=2d", content, 44) == (0.0, 0.0)


@pytest.mark.parametrize("version", [2, 3])
def test_overflow_keeps_the_last_finite_force(version, fmu_instance):
    slave = fmu_instance("HO", version)
    set_variable(slave, POSITION, 1.0)
    slave.exitInitializationMode()
    slave.doStep(0.0, 0.01)
    for k in range(1, 50):
        set_variable(slave, POSITION, 1.7e308)
        slave.doStep(k * 0.01, 0.01)
        assert abs(get(slave)) <= 15.0
    for k in range(50, 4000):
        set_variable(slave, POSITION, -0.4)
        slave.doStep(k * 0.01, 0.01)
    assert get(slave) == pytest.approx(-0.3, abs=1e-9)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    ("reference", "value"),
    [(GAIN, -0.1), (FORCE_LIMIT, math.nan), (POSITION_OFFSET, math.inf), (FORCE, 1.0), (99, 1.0)],
)
def test_values_out_of_range_change_nothing(version, reference, value, fmu_instance):
    slave = fmu_instance("KB", version)
    set_variable(slave, POSITION, 1.0)
    before = [get(slave, known) for known in range(1, 7)]
    with pytest.raises(FMICallException):
        set_variable(slave, reference, value)
    assert [get(slave, known) for known in range(1, 7)] == before


def test_fmi2_warns_of_the_late_feedthrough(fmu_instance, capfd):
    """The warning is for models with feed-through only: MW has none."""
    for name, expected in (("KB", True), ("MW", False)):
        fmu_instance(name, 2).exitInitializationMode()
        assert ("u[k-1]" in capfd.readouterr().out) == expected


@pytest.mark.parametrize("version", [2, 3])
def test_derivatives_of_other_variables_are_rejected(version, fmu_instance):
    slave = fmu_instance("KB", version)
    with pytest.raises(FMICallException):
        slave.getDirectionalDerivative([GAIN], [POSITION], [1.0])
    with pytest.raises(FMICallException):
        slave.getDirectionalDerivative([FORCE], [FORCE], [1.0])


SAMPLES = 60
"""Longer than the longest moving average."""
SLOPE = 2.0**-20
"""Step as a share of the motion's span: small enough for a slope, large enough for its rounding."""
FREE = [f"{kind}-fmi{version}" for kind in ("KB", "KB+coulomb_friction") for version in (2, 3)]
"""Files with a force of gain · y + offset within its limit."""
GUARDED = ["guarded-fmi2", "guarded-fmi3"]
"""Files with a force that is also bounded by the forces before."""
GUARDS = {"device_damping": 2.75, "output_rate_limit": 300.0, "contact": True}


@pytest.fixture(scope="module")
def guarded_folder(tmp_path_factory):
    """Return a folder with the FMUs of a model with all guards."""
    folder = tmp_path_factory.mktemp("guarded")
    export(device_models("KB", start="offset", **GUARDS), folder)
    return folder


@pytest.fixture(scope="module", params=[*FREE, *GUARDED], ids=str)
def fmu(request, fmu_folder, guarded_folder, tmp_path_factory):
    """Return an unzipped FMU: of a linear model, of one with an effect, of one with guards."""
    kind, version = request.param.split("-fmi")
    path = fmu_folder / f"{kind}_fmi{version}.fmu"
    if kind == "guarded":
        path = guarded_folder / f"KB_fmi{version}.fmu"
    return DrivenFmu(unzipped(path, tmp_path_factory.mktemp("unzipped") / path.stem))


def run_fmu(fmu, event_mode, positions, **parameters) -> list[float]:
    instance = DrivenInstance(fmu, event_mode)
    for name, value in parameters.items():
        instance.set(name, value)
    return instance.play(positions)


def parameters_of(fmu) -> dict[str, float]:
    """The tunable parameters with other values than at the start."""
    start = fmu.numbered("start")
    return {name: 0.75 * start[name] + 0.0625 for name in fmu.settable if name != fmu.ports[0]}


def test_library_agrees_with_description_and_reference(fmu):
    assert problems_of(fmu) == []


def test_force_keeps_its_limit_at_any_position(fmu):
    motion, limit = Motion(fmu), f"{fmu.ports[1]}_limit"
    highest = fmu.numbered("max")[fmu.ports[1]]
    far = [motion.rest + 1e6 * (item - motion.rest) for item in motion.random(SAMPLES, 1)]
    for event_mode in modes(fmu):
        assert max(map(abs, run_fmu(fmu, event_mode, far))) <= highest
        assert max(map(abs, run_fmu(fmu, event_mode, far, **{limit: highest / 4}))) <= highest / 4


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_position_that_is_not_a_number_is_ignored(fmu, value):
    positions, instance, valid = Motion(fmu).random(5, 2), DrivenInstance(fmu), DrivenInstance(fmu)
    assert instance.play(positions) == valid.play(positions)
    assert instance.play(20 * [value]) == valid.play(20 * positions[-1:])
    assert instance.get(fmu.ports[0]) == positions[-1]


@pytest.mark.parametrize("fmu", FREE, indirect=True)
def test_gain_and_offsets_act_on_the_force(fmu):
    (position, force), motion, start, event_mode = (
        fmu.ports,
        Motion(fmu),
        fmu.numbered("start"),
        modes(fmu)[-1],
    )
    offset, shift, moved = f"{force}_offset", f"{position}_offset", motion.span / 4
    push = motion.push[: len(motion.push) // 4]
    plain = run_fmu(fmu, event_mode, push)
    halved = run_fmu(fmu, event_mode, push, gain=start["gain"] / 2)
    assert halved == pytest.approx([start[offset] + (value - start[offset]) / 2 for value in plain])
    added = run_fmu(fmu, event_mode, push, **{offset: start[offset] + 0.5})
    assert added == pytest.approx([value + 0.5 for value in plain])
    shifted = run_fmu(fmu, event_mode, [item + moved for item in push], **{shift: start[shift] + moved})
    assert shifted == pytest.approx(plain, abs=1e-9)
    instance = DrivenInstance(fmu)
    instance.play(push)
    assert instance.derivative(force, "gain") == pytest.approx(
        (instance.get(force) - start[offset]) / start["gain"]
    )
    assert instance.derivative(force, offset) == 1.0
    instance.set(f"{force}_limit", 1e-9)
    assert instance.derivative(force, position) == instance.derivative(force, offset) == 0.0


def test_derivative_by_the_position_is_the_slope_of_the_force(fmu):
    """At most samples: forces have kinks."""
    (position, force), motion, event_mode = fmu.ports, Motion(fmu), modes(fmu)[-1]
    positions, small, pairs = motion.random(SAMPLES, 15, scale=0.2), SLOPE * motion.span, []
    for k in range(3, len(positions), 4):
        instance = DrivenInstance(fmu, event_mode)
        instance.play(positions[:k])
        instance.reach_sample()
        forces = []
        for moved in (small, -small, 0.0):
            instance.set(position, positions[k] + moved)
            forces.append(instance.get(force))
        pairs.append((instance.derivative(force, position), (forces[0] - forces[1]) / (2 * small)))
    largest = max(abs(value) for pair in pairs for value in pair) or 1.0
    assert 2 * sum(abs(derivative - slope) > 1e-3 * largest for derivative, slope in pairs) <= len(pairs)


def test_reset_restores_the_start(fmu):
    start, positions = fmu.numbered("start"), Motion(fmu).random(SAMPLES, 5)
    for event_mode in modes(fmu):
        instance = DrivenInstance(fmu, event_mode)
        first = instance.play(positions)
        for name, value in parameters_of(fmu).items():
            instance.accepts(name, value)
        instance.play(positions)
        instance.reset()
        assert {name: instance.get(name) for name in fmu.settable} == {
            name: start[name] for name in fmu.settable
        }
        assert instance.play(positions) == first


def test_saved_state_continues_in_any_instance(fmu):
    motion, start = Motion(fmu), fmu.numbered("start")
    positions, more = motion.random(SAMPLES, 6), motion.random(SAMPLES, 7)
    for event_mode in modes(fmu):
        instance, fresh = DrivenInstance(fmu, event_mode), DrivenInstance(fmu, event_mode)
        values = {name: value for name, value in parameters_of(fmu).items() if instance.accepts(name, value)}
        instance.play(positions)
        saved = instance.save()
        content = instance.serialized(saved)
        expected = instance.play(more)
        for name in values:
            instance.accepts(name, start[name])
        instance.restore(saved)
        fresh.play(positions[:1])
        fresh.restore(fresh.deserialized(content))
        for other in (instance, fresh):
            assert {name: other.get(name) for name in values} == values
            assert other.play(more) == expected


@pytest.mark.parametrize(("parts", "start"), [(2, 0.0), (7, 0.0), (1, 1000.0)])
def test_forces_do_not_depend_on_step_size_or_start_time(fmu, parts, start):
    positions = Motion(fmu).random(SAMPLES, 12)
    assert DrivenInstance(fmu, start=start, parts=parts).play(positions) == DrivenInstance(fmu).play(
        positions
    )
