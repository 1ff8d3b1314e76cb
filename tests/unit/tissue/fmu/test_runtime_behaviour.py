"""What the library in an FMU does, whatever the model: one file of each kind, in both versions of FMI.

`lumbar check` holds a library to the sources beside it; that those sources do what FMI and the description say is tried here.
"""

import math
import zipfile

import pytest
from c_programs import ON_LINUX
from runtime_models import SETTINGS, TARGET, models_json, selected

from lumbar.tissue.fmu.build.package import export_fmus
from lumbar.tissue.fmu.check.behaviour import problems_of
from lumbar.tissue.fmu.check.instance import Instance, Motion, UnzippedFmu, modes
from study_settings import changed

pytestmark = ON_LINUX
SAMPLES = 60
"""Longer than the longest moving average."""
SLOPE = 2.0**-20
"""Of the motion's span: small enough for a slope, large enough for its rounding."""
FREE = [f"{kind}-fmi{version}" for kind in ("KB", "KB+coulomb_friction") for version in (2, 3)]
"""Files whose force is gain · y + offset within its limit."""
GUARDED = ["guarded-fmi2", "guarded-fmi3"]
"""Files whose force is also bounded by the forces before."""
GUARDS = {"device_damping": 2.75, "output_rate_limit": 300.0, "contact": True}


@pytest.fixture(scope="module")
def guarded_folder(tmp_path_factory, zig_cache):
    """Return a folder with the FMUs of a model with all guards."""
    folder = tmp_path_factory.mktemp("guarded")
    settings = changed(SETTINGS, models=["KB"], rate_Hz=1000.0, moving_average_ms=3.0, **GUARDS)
    export_fmus(selected(models_json(), settings), folder, "test", TARGET, zig_cache)
    return folder


@pytest.fixture(scope="module", params=[*FREE, *GUARDED], ids=str)
def fmu(request, fmu_folder, guarded_folder, tmp_path_factory):
    """Return an unzipped FMU: of a linear model, of one with an effect, of one with guards."""
    kind, version = request.param.split("-fmi")
    name = "KB" if kind == "guarded" else kind
    folder = tmp_path_factory.mktemp("unzipped")
    with zipfile.ZipFile(
        (guarded_folder if kind == "guarded" else fmu_folder) / f"{name}_fmi{version}.fmu"
    ) as archive:
        archive.extractall(folder)
    return UnzippedFmu(folder)


def played(fmu, event_mode, positions, **parameters) -> list[float]:
    instance = Instance(fmu, event_mode)
    for name, value in parameters.items():
        instance.set(name, value)
    return instance.play(positions)


def parameters_of(fmu) -> dict[str, float]:
    """The tunable parameters with other values than at the start."""
    start = fmu.numbered("start")
    return {name: 0.75 * start[name] + 0.0625 for name in fmu.settable if name != fmu.ports[0]}


def test_it_does_what_description_and_reference_say(fmu):
    assert problems_of(fmu) == []


def test_however_far_the_position_goes_the_force_keeps_its_limit(fmu):
    motion, limit = Motion(fmu), f"{fmu.ports[1]}_limit"
    highest = fmu.numbered("max")[fmu.ports[1]]
    far = [motion.rest + 1e6 * (item - motion.rest) for item in motion.random(SAMPLES, 1)]
    for event_mode in modes(fmu):
        assert max(map(abs, played(fmu, event_mode, far))) <= highest
        assert max(map(abs, played(fmu, event_mode, far, **{limit: highest / 4}))) <= highest / 4


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_of_a_position_that_is_no_number_nothing_stays(fmu, value):
    positions, instance, sound = Motion(fmu).random(5, 2), Instance(fmu), Instance(fmu)
    assert instance.play(positions) == sound.play(positions)
    assert instance.play(20 * [value]) == sound.play(20 * positions[-1:])
    assert instance.get(fmu.ports[0]) == positions[-1]


@pytest.mark.parametrize("fmu", FREE, indirect=True)
def test_gain_and_offsets_do_what_their_names_say(fmu):
    (position, force), motion, start, event_mode = (
        fmu.ports,
        Motion(fmu),
        fmu.numbered("start"),
        modes(fmu)[-1],
    )
    offset, shift, moved = f"{force}_offset", f"{position}_offset", motion.span / 4
    push = motion.push[: len(motion.push) // 4]
    plain = played(fmu, event_mode, push)
    halved = played(fmu, event_mode, push, gain=start["gain"] / 2)
    assert halved == pytest.approx([start[offset] + (value - start[offset]) / 2 for value in plain])
    added = played(fmu, event_mode, push, **{offset: start[offset] + 0.5})
    assert added == pytest.approx([value + 0.5 for value in plain])
    shifted = played(fmu, event_mode, [item + moved for item in push], **{shift: start[shift] + moved})
    assert shifted == pytest.approx(plain, abs=1e-9)
    instance = Instance(fmu)
    instance.play(push)
    assert instance.derivative(force, "gain") == pytest.approx(
        (instance.get(force) - start[offset]) / start["gain"]
    )
    assert instance.derivative(force, offset) == 1.0
    instance.set(f"{force}_limit", 1e-9)
    assert instance.derivative(force, position) == instance.derivative(force, offset) == 0.0


def test_the_derivative_by_the_position_is_the_slope_of_the_force(fmu):
    """At most samples: forces have kinks."""
    (position, force), motion, event_mode = fmu.ports, Motion(fmu), modes(fmu)[-1]
    positions, small, pairs = motion.random(SAMPLES, 15, scale=0.2), SLOPE * motion.span, []
    for k in range(3, len(positions), 4):
        instance = Instance(fmu, event_mode)
        instance.play(positions[:k])
        instance.reach_sample()
        forces = []
        for moved in (small, -small, 0.0):
            instance.set(position, positions[k] + moved)
            forces.append(instance.get(force))
        pairs.append((instance.derivative(force, position), (forces[0] - forces[1]) / (2 * small)))
    largest = max(abs(value) for pair in pairs for value in pair) or 1.0
    assert 2 * sum(abs(told - found) > 1e-3 * largest for told, found in pairs) <= len(pairs)


def test_a_reset_makes_it_as_new(fmu):
    start, positions = fmu.numbered("start"), Motion(fmu).random(SAMPLES, 5)
    for event_mode in modes(fmu):
        instance = Instance(fmu, event_mode)
        first = instance.play(positions)
        for name, value in parameters_of(fmu).items():
            instance.accepts(name, value)
        instance.play(positions)
        instance.reset()
        assert {name: instance.get(name) for name in fmu.settable} == {
            name: start[name] for name in fmu.settable
        }
        assert instance.play(positions) == first


def test_a_saved_state_continues_in_the_same_instance_and_from_bytes_in_another(fmu):
    motion, start = Motion(fmu), fmu.numbered("start")
    positions, more = motion.random(SAMPLES, 6), motion.random(SAMPLES, 7)
    for event_mode in modes(fmu):
        instance, fresh = Instance(fmu, event_mode), Instance(fmu, event_mode)
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
def test_forces_hang_neither_on_the_division_of_time_nor_on_its_beginning(fmu, parts, start):
    positions = Motion(fmu).random(SAMPLES, 12)
    assert Instance(fmu, start=start, parts=parts).play(positions) == Instance(fmu).play(positions)
