"""Creep and recovery under dead weights: closed forms of the compliance, forces without noise."""

import numpy as np
import pytest
from force_driven import FORCE_IN
from scipy.signal import cont2discrete, dlsim

import lumbar
from lumbar.records.record import Channel, Record
from lumbar.records.sampling import check_clipping
from lumbar.tissue.diagnosis.linear.direction import creeps_at_constant_force

STEP_S, NOISE_MM, ZERO_MM = 0.1, 0.004, 0.3
SPRING, BRANCH, TIME_S, DASHPOT = 0.8, 1.2, 2.5, 40.0
"""N/mm, N/mm, s, N s/mm: Kelvin-Boltzmann, and a free dashpot in series."""


def ramped_creep(time: np.ndarray) -> np.ndarray:
    """Return the motion in mm of the Kelvin-Boltzmann model under a force that rises by 1 N/s since 0 s."""
    time = np.maximum(time, 0.0)
    retardation = TIME_S * (SPRING + BRANCH) / SPRING
    gain = BRANCH / (SPRING * (SPRING + BRANCH))
    return time / SPRING - gain * retardation * -np.expm1(-time / retardation)


def creep_record(name: str, load: float, flows: bool = False, noise: float = NOISE_MM) -> Record:
    """Return a test with 3 s at rest, a load that rises in 0.5 s, and recovery from 30 s."""
    time, rise = STEP_S * np.arange(500), 0.5
    corners = ((3.0, 1), (3.0 + rise, -1), (30.0, -1), (30.0 + rise, 1))
    force = load / rise * sum(sign * np.maximum(time - start, 0.0) for start, sign in corners)
    force = np.where(np.abs(force - load) < 1e-9, load, np.where(np.abs(force) < 1e-9, 0.0, force))
    position = load / rise * sum(sign * ramped_creep(time - start) for start, sign in corners)
    if flows:
        steps = np.append(0.0, np.cumsum((force[1:] + force[:-1]) / 2)) * STEP_S
        position = position + steps / DASHPOT
    position = position + ZERO_MM + noise * np.random.default_rng(round(10 * load)).standard_normal(len(time))
    channels = {"input": Channel(position, "position", "mm"), "output": Channel(force, "force", "N")}
    return Record(name, time, channels, source=name)


def pair(flows: bool = False, noise: float = NOISE_MM) -> list[Record]:
    return [creep_record("one", 1.0, flows, noise), creep_record("two", 1.7, flows, noise)]


@pytest.mark.parametrize("noise", [NOISE_MM, pytest.param(1e-6, marks=pytest.mark.statistical)])
def test_dead_weight_gives_the_parameters(noise):
    diagnosis = lumbar.diagnose(pair(noise=noise), settings=FORCE_IN)
    assert (diagnosis.status, diagnosis.selected, diagnosis.model.base) == ("adequate", (), "KB")
    expected = {"spring_stiffness": SPRING, "branch_stiffness": BRANCH, "relaxation_time": TIME_S}
    for name, value in expected.items():
        assert diagnosis.model[name].value == pytest.approx(value, rel=0.03)
    assert diagnosis.model.output.offset == pytest.approx(ZERO_MM, abs=0.003)
    assert diagnosis.result.model.fit.converged
    assert {item.unit for item in diagnosis.model.parameters if item.derived} == {"N/mm", "N·s/mm", "s"}


@pytest.mark.nightly
def test_free_dashpot_is_the_base_of_burgers(tmp_path):
    records = pair(flows=True)
    diagnosis = lumbar.diagnose(records, settings=FORCE_IN)
    assert (diagnosis.status, diagnosis.selected, diagnosis.model.base) == ("adequate", (), "Burgers")
    # Slow flow: the dashpots of both branches are parallel.
    branches = [
        (diagnosis.model[f"branch_stiffness_{n}"].value, diagnosis.model[f"relaxation_time_{n}"].value)
        for n in (1, 2)
    ]
    assert sum(stiffness * time for stiffness, time in branches) == pytest.approx(DASHPOT, rel=0.05)
    assert sum(stiffness for stiffness, _ in branches) == pytest.approx(SPRING + BRANCH, rel=0.03)
    diagnosis.save(tmp_path, pictures=False)
    loaded = lumbar.load_models(tmp_path / "refined.json")[-1]
    assert loaded.structure.force_between == diagnosis.model.structure.force_between
    assert diagnosis.model.output.offset == pytest.approx(ZERO_MM, abs=0.005)


@pytest.mark.parametrize(
    ("between", "method"), [("held", "zoh"), pytest.param("straight", "foh", marks=pytest.mark.statistical)]
)
def test_course_between_samples_is_chosen_by_the_data(between, method):
    mass, damping, stiffness, step = 0.002, 0.0064, 0.08, 0.02
    matrices = ([[0, 1], [-stiffness / mass, -damping / mass]], [[0], [1 / mass]], [[1, 0]], [[0]])
    system = cont2discrete([np.array(item, dtype=float) for item in matrices], step, method)
    records = []
    for name, load in (("one", 3.0), ("two", 2.0)):
        force = load * np.repeat([0.0, 1.0, 0.0], (50, 200, 150))
        position = dlsim((*system[:4], step), force)[1][:, 0]
        position += 0.05 * np.random.default_rng(int(load)).standard_normal(len(force))
        channels = {"input": Channel(force, "force", "N"), "output": Channel(position, "position", "mm")}
        records.append(Record(name, step * np.arange(len(force)), channels, source=name))
    diagnosis = lumbar.diagnose(records, settings=FORCE_IN)
    assert (diagnosis.status, diagnosis.model.base) == ("adequate", "KV-mass")
    assert diagnosis.model.structure.force_between == between
    assert diagnosis.model["mass"].value == pytest.approx(mass, rel=0.01)


def test_forgotten_option_is_suggested_first():
    diagnosis = lumbar.diagnose(pair())
    first = diagnosis.result.findings[0]
    assert first.kind == "direction" and "--forward" in first.sentence
    assert diagnosis.selected == ()


def test_relaxation_is_not_mistaken_for_creep():
    for record in pair():
        assert creeps_at_constant_force(record["input"], record["output"])
        assert not creeps_at_constant_force(record["output"], record["input"])


def test_load_that_drives_the_test_is_not_clipped():
    record = creep_record("one", 1.0)
    tops = np.minimum(np.sin(np.arange(500) / 15.0), 0.8)
    moved = record.with_values(output=tops, input=record["input"] + np.sin(np.arange(500) / 40.0))
    with pytest.raises(lumbar.InputError, match=r"\boutput: clipped\b"):
        check_clipping(moved)
    check_clipping(moved, load_drives=True)
