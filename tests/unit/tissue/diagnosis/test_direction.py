"""Which way round records are: simulated and public ones, as they are, with the sign turned, with the roles exchanged."""

from __future__ import annotations

import gzip
from dataclasses import replace

import numpy as np
import pytest
import yaml
from periodic_records import noise
from scipy.io import loadmat
from scipy.signal import lsim

from lumbar.records.columns import read_record
from lumbar.settings.layout import ColumnLayout, ColumnSettings
from lumbar.settings.tissue import TissueSettings
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.linear.direction import direction_or_sign
from lumbar.tissue.models.motion import Motion

STEP = 0.01
TIME = np.arange(0, 60, STEP)


def found(*pairs, layout=None):
    """Finding in records, each (position, force) or (position, force, step)."""
    records = []
    for position, force, *step in pairs:
        step = step[0] if step else STEP
        records.append(FitData("record", Motion(np.arange(len(position)) * step, position, step), force))
    return direction_or_sign(Experiment(records[0], records[1:], None, "mm", "N", "record"), layout)


def kind(*pairs) -> str | None:
    finding = found(*pairs)
    return None if finding is None else finding.kind


def flipped(pairs):
    return [(position, -force, *step) for position, force, *step in pairs]


def exchanged(pairs):
    return [(force, position, *step) for position, force, *step in pairs]


def assert_recognised(pairs):
    assert (kind(*pairs), kind(*flipped(pairs)), kind(*exchanged(pairs))) == (None, "sign", "direction")


def drive(seed: int = 0) -> np.ndarray:
    random = np.random.default_rng(seed)
    frequency, phase = random.uniform(0.1, 5.0, 40), random.uniform(0, 2 * np.pi, 40)
    return 0.5 * np.cos(2 * np.pi * np.outer(TIME, frequency) + phase).sum(axis=1)


COMPLIANCES = {
    "kelvin_voigt": ([1.0], [0.08, 0.6]),
    "kelvin_boltzmann": ([0.15, 1.0], [0.15 * 1.5, 0.6]),
    "mass_spring_damper": ([1.0], [0.004, 0.05, 0.6]),
    "mass_damper": ([1.0], [0.05, 0.4, 1e-3]),
}
"""Position over force in s."""


@pytest.mark.parametrize("name", COMPLIANCES)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_materials_driven_by_a_force(name, seed):
    force = drive(seed)
    position = lsim(COMPLIANCES[name], force, TIME)[1]
    assert_recognised([(position + 0.002 * np.std(position) * noise(len(TIME), seed), force)])


def test_a_damper_with_hysteresis():
    """Bouc and Wen's, as of a magnetorheological damper: hardly any stiffness."""
    position = drive(4)
    steps = np.diff(position, prepend=position[0])
    state = np.zeros(len(position))
    for index in range(1, len(position)):
        last = state[index - 1]
        state[index] = last + 2 * steps[index] - 2 * abs(steps[index]) * last
    force = 0.5 * np.gradient(position, STEP) + 5 * state + 0.05 * noise(len(position), 1)
    assert_recognised([(position, force)])


def test_a_spring_of_the_other_sign_is_told_from_a_mass():
    position = drive(5)
    acceleration = np.gradient(np.gradient(position, STEP), STEP)
    assert kind((position, -0.7 * position)) == "sign"
    assert kind((position, 0.7 * position)) is None
    assert kind((position, 0.01 * acceleration + 0.01 * np.gradient(position, STEP))) is None


def test_a_force_that_comes_late_is_no_sign():
    """A spring behind 20 ms gives energy, as far as the record shows."""
    position = drive(6)
    assert kind((position[2:], 0.7 * position[:-2])) is None


def test_a_command_of_two_levels_is_no_position():
    command = np.repeat(np.sign(np.random.default_rng(0).standard_normal(len(TIME) // 20)), 20)
    speed = np.abs(lsim(([1.0], [0.02, 0.2, 1.0]), command, TIME)[1])
    finding = found((command, speed))
    assert finding.kind == "direction"
    assert "jumps between levels" in finding.sentence
    assert kind((command, 0.8 * command)) is None, "a stiff tissue that is stepped jumps with its position"


RIGHT = ColumnLayout(
    columns={
        "time": ColumnSettings("t [s]", "s", "time"),
        "input": ColumnSettings(3, "mm", "position", offset=-2.0),
        "output": ColumnSettings("u: force", "N", "force", scale=0.5),
    }
)


def with_columns(layout, **columns):
    return replace(layout, columns={**layout.columns, **columns})


@pytest.mark.parametrize(
    "wrong",
    [
        with_columns(RIGHT, input=RIGHT.columns["output"], output=RIGHT.columns["input"]),
        with_columns(RIGHT, output=replace(RIGHT.columns["output"], scale=-0.5)),
    ],
    ids=["direction", "sign"],
)
def test_the_lines_of_yaml_turn_the_records_round(tmp_path, wrong):
    force = drive(7)
    position = lsim(COMPLIANCES["kelvin_voigt"], force, TIME)[1]
    file = tmp_path / "record.csv"
    table = np.stack([TIME, 2 * force, position + 2], axis=1)
    np.savetxt(file, table, delimiter=",", header="t [s],u: force,z", comments="")
    record = read_record(file, wrong)
    told = found((record["input"], record["output"]), layout=wrong).sentence
    lines = yaml.safe_load(told[told.index("\ntissue:") :])["tissue"]["layout"]["columns"]
    columns = {role: ColumnSettings(**column) for role, column in lines.items()}
    turned = read_record(file, with_columns(wrong, **columns))
    np.testing.assert_allclose(turned["input"], position, atol=1e-12)
    np.testing.assert_allclose(turned["output"], force, atol=1e-12)


def test_without_a_layout_the_lines_are_those_of_the_reference():
    force = drive(8)
    position = lsim(COMPLIANCES["kelvin_voigt"], force, TIME)[1]
    told = found((position, -force)).sentence
    column = yaml.safe_load(told[told.index("\ntissue:") :])["tissue"]["layout"]["columns"]["output"]
    assert ColumnSettings(**column) == replace(TissueSettings().layout.columns["output"], scale=-1.0)


def test_no_finding_in_any_labelled_experiment(shared):
    for folder in sorted(
        [*(shared / "hidden_effects").glob("case_*"), *(shared / "hard_effects").glob("*/records")]
    ):
        pairs = []
        for file in sorted(folder.glob("*.csv")):
            time, position, force = np.loadtxt(file, delimiter=",", skiprows=1).T
            pairs.append((position, force, float(time[1] - time[0])))
        assert kind(*pairs) is None, folder


def positioning_axis(real):
    pairs = []
    for name in ("DATA_EMPS", "DATA_EMPS_PULSES"):
        data = loadmat(real / "positioning_axis" / f"{name}.mat")
        pairs.append((data["qm"].ravel(), float(np.ravel(data["gtau"])[0]) * data["vir"].ravel(), 1e-3))
    return pairs


def bouc_wen(real):
    signals = []
    for name in ("yval_multisine", "uval_multisine"):
        data = loadmat(real / "bouc_wen" / f"{name}.mat")
        signals.append(np.tile(data[name].ravel(), 3))
    return [(*signals, 1 / 750)]


def davinci(real):
    pairs = []
    for name in ("03", "23", "43"):
        with gzip.open(real / "davinci_tool_friction" / f"Tool_4_Maryland_L_4_{name}.TXT.gz") as stream:
            table = np.loadtxt(stream, delimiter=",", comments="%", usecols=(1, 2))
        pairs.append((table[::5, 0] * 7.67e-4, -3.9811e-5 * table[::5, 1], 5e-3))
    return pairs


@pytest.mark.parametrize("read", [positioning_axis, bouc_wen, davinci])
def test_public_records(shared, read):
    assert_recognised(read(shared / "real"))


def test_drives_that_a_voltage_of_two_levels_moves(shared):
    data = loadmat(shared / "real" / "coupled_drives" / "drive.mat")
    pairs = [
        (data[f"u{i}"].ravel().astype(float), data[f"z{i}"].ravel().astype(float), 0.02) for i in (1, 2, 3)
    ]
    assert kind(*pairs) == "direction"
    assert kind(*exchanged(pairs)) is None
