"""The synthetic hip moments: the pendulum of head, arms and trunk, and its hidden effects."""

import numpy as np
import pandas as pd
import pytest

import lumbar
from lumbar.settings.lifting import PendulumSettings, StabilitySettings
from lumbar.settings.study_settings import StudySettings
from lumbar.twin.lifting_recordings import write_lift, write_trials
from pendulum_experiments import records_of
from study_settings import changed, study_settings


@pytest.fixture(scope="module")
def twin(project):
    return study_settings().twin.lifting


def regressed(record, more):
    """Least squares on finite differences: inertia, damping, gravity and further columns."""
    angle, step = record["angle_rad"].to_numpy(), record["time_s"].iloc[1]
    rate = np.gradient(angle, step)
    acceleration = np.gradient(rate, step)
    columns = np.stack([acceleration, rate, np.sin(angle), *more(acceleration, angle)], axis=1)[5:-5]
    return np.linalg.lstsq(columns, record["moment_Nm"].to_numpy()[5:-5], rcond=None)[0]


def trunk_of(person):
    """Inertia about the hip and gravity's moment of head, arms and trunk: Winter (2009), Table 4.1."""
    mass, segment = 0.678 * person.mass_kg, 0.288 * person.height_m
    return mass * segment**2 * (0.626**2 + 0.496**2), 9.81 * mass * 0.626 * segment


def test_trials_repeat_the_lift_at_their_pace(twin, tmp_path):
    names = list(twin.hip_moment.trials)
    paths = [tmp_path / f"{name}.csv" for name in names]
    write_trials(twin, names, paths, [1])
    for name, path in zip(names, paths, strict=True):
        record, trial = pd.read_csv(path), twin.hip_moment.trials[name]
        cycle = twin.duration_s / trial.pace
        assert len(record) == round(cycle * trial.repetitions * twin.rate_Hz)
        assert record["box_held"].max() == float(trial.with_box)
        peaks = record["angle_rad"].groupby((record["time_s"] // cycle).astype(int)).max()
        assert (peaks.std() > 1e-9) == (trial.variation > 0)
    for seed in (1, 2):
        write_trials(twin, names[1:2], [tmp_path / "again.csv"], [seed])
        assert ((tmp_path / "again.csv").read_bytes() == paths[1].read_bytes()) == (seed == 1)


def test_other_effects_can_be_hidden(twin, tmp_path):
    hidden = {"hand_distance_m": 0.0, "stiffening_N_m": 5.0, "stiffening_angle_rad": 0.4}
    settings = changed(twin, hip_moment={"hidden": hidden, "noise_N_m": 0.0})
    write_trials(settings, ["slow"], [tmp_path / "slow.csv"], [1])
    record = pd.read_csv(tmp_path / "slow.csv")
    found = regressed(record, lambda acceleration, angle: [np.expm1(angle / 0.4)])
    inertia, gravity = trunk_of(settings.people["expert"])
    assert found == pytest.approx([inertia, 8.0, -gravity, 5.0], rel=0.02)


def trials_of(twin, names, folder, *gravity):
    """Records of trials with the seed of the default study."""
    tables = {}
    for name in names:
        write_trials(twin, [name], [folder / f"{name}.csv"], [45, 3], *gravity)
        table = pd.read_csv(folder / f"{name}.csv")
        tables[name] = {key: table[key].to_numpy() for key in table}
    return records_of(tables)


def test_default_study_weighs_box(twin, tmp_path):
    records = trials_of(twin, twin.hip_moment.trials, tmp_path)
    settings = StudySettings(improvement=lumbar.ImprovementSettings(propose_law=False))
    result = lumbar.diagnose(records, base="pendulum", settings=settings).result
    assert (result.status, result.selected, result.complete) == ("named", ("hand_load",), True)
    assert result.experiment.training.name == "paced"
    assert result.experiment.floor.rms == pytest.approx(twin.hip_moment.noise_N_m, rel=0.1)
    estimates = {item.name: item for item in result.ranking[0].estimates}
    inertia, gravity = trunk_of(twin.people["expert"])
    truth = {"inertia": inertia, "damping": twin.hip_moment.damping_N_m_s, "gravity_moment": -gravity}
    truth |= {"box_mass": 23.0, "hand_distance": twin.hip_moment.hidden.hand_distance_m}
    for name, value in truth.items():
        spread = (estimates[name].high - estimates[name].low) / 2
        assert abs(estimates[name].value - value) < 2 * spread, name
        assert spread < 0.1 * abs(value), name


def test_study_weighs_box_by_its_gravity(twin, tmp_path):
    """On Mars: the effects, and the model before and after its file, have the study's gravity."""
    mars = 3.71
    records = trials_of(twin, ["paced", "fast"], tmp_path, mars)
    there = StudySettings(stability=StabilitySettings(pendulum=PendulumSettings(gravity_m_s2=mars)))
    refined = lumbar.refine(records, ["hand_load"], base="pendulum", train="paced", settings=there)
    box = refined.model["hand_load.box_mass"]
    assert box.low < 23.0 < box.high
    assert box.high - box.low < 23.0 / 2
    _, gravity = trunk_of(twin.people["expert"])
    assert refined.model["gravity_moment"].value == pytest.approx(-gravity * mars / 9.81, rel=0.02)
    refined.save(tmp_path)
    read = lumbar.load_models(tmp_path / "refined.json")[-1]
    assert read == refined.model
    np.testing.assert_array_equal(read.simulate(records[1]), refined.model.simulate(records[1]))
    here = lumbar.refine(records, ["hand_load"], base="pendulum", train="paced").model["hand_load.box_mass"]
    assert here.high < 23.0


def test_person_at_rest_is_recorded_at_rest(twin, tmp_path):
    """Rounding errors of the spline, which differ between processors, are not recorded as motion."""
    write_lift(twin, "expert_23kg", [4], tmp_path / "lift.c3d", tmp_path / "moment.csv")
    record = pd.read_csv(tmp_path / "moment.csv")
    for name, decimals in (("angle_rad", 9), ("moment_Nm", 3)):
        np.testing.assert_array_equal(record[name], np.round(record[name], decimals))
    angle = record["angle_rad"].to_numpy()
    start = int(np.argmax(np.abs(angle) > 1e-6))
    assert start > 10 and (angle[: start - 5] == 0).all() and not np.signbit(angle[: start - 5]).any()
