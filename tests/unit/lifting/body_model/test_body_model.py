"""The body model on the synthetic lifter and on recordings with markers taken away; its linear algebra against dense matrices."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from lifting_cases import cut

from lumbar.base.errors import InputError, NumericalError
from lumbar.interface.body_model import body_model
from lumbar.lifting.body_model import anatomy
from lumbar.lifting.body_model.build import at_nodes, build, measured_markers
from lumbar.lifting.body_model.fit import fit, model_points
from lumbar.lifting.body_model.information import Information, Noise, factorise
from lumbar.lifting.body_model.pendulums import Conditions, basin_intervals, explained_share, model_pendulums
from lumbar.lifting.body_model.structure import fast_noise
from lumbar.lifting.movement.centre_of_mass import WINTER, segment_centres
from lumbar.lifting.movement.cleaning import filter_markers
from lumbar.lifting.movement.events import Event
from lumbar.lifting.movement.gaps import fill_gaps
from lumbar.lifting.movement.joint_centres import trunk_points
from lumbar.lifting.movement.lift import analyse_lift
from lumbar.lifting.movement.pendulum_states import pendulum_states
from lumbar.records.markers import MarkerRecording, read_markers
from lumbar.settings.layout import MarkerLayout
from lumbar.settings.lifting import BodyModelSettings, BoxSettings, LiftingSettings
from lumbar.settings.stability import StabilitySettings
from lumbar.twin.lifting_recordings import true_movement
from predicted_markers import predicted_marker
from study_settings import study_settings, subject_settings

RATE = 25.0


@pytest.fixture(scope="module")
def movement():
    return true_movement(study_settings().twin.lifting, "expert_23kg")


@pytest.fixture(scope="module")
def events():
    return study_settings().twin.lifting.lifts["expert_23kg"].events_s


@pytest.fixture(scope="module")
def deposit(movement, events):
    """Two seconds about the deposit: markers with noise, C7 and T12 exchanged for 0.4 s, and the sternum hidden for one."""
    rng = np.random.default_rng(2)
    kept = (movement.time > events.deposit_start - 1.0) & (movement.time < events.release + 0.6)
    time = movement.time[kept]
    positions = {
        name: points[kept] + rng.normal(0, 1e-3, (len(time), 3)) for name, points in movement.markers.items()
    }
    swapped = (time > events.deposit_start + 0.3) & (time < events.deposit_start + 0.7)
    c7, t12 = positions["C7"].copy(), positions["T12"].copy()
    positions["C7"][swapped], positions["T12"][swapped] = t12[swapped], c7[swapped]
    positions["MANUBRIUM"][(time > events.deposit_start) & (time < events.deposit_start + 1.0)] = np.nan
    return MarkerRecording("deposit", time, 100.0, positions), swapped


@pytest.fixture(scope="module")
def fitted(deposit):
    time, nodes = at_nodes(deposit[0], RATE)
    return fit(build(time, nodes, 1.75, "male", np.ones(len(time), dtype=bool)))


def at_instants(fit_, time, values):
    return np.stack([np.interp(fit_.model.time, time, axis) for axis in values.T], axis=1)


@pytest.mark.parametrize("frames", [40, 150, 600])
def test_the_noise_of_a_marker_is_told_from_what_is_faster_than_people(frames):
    time, rng = np.arange(frames) / 50.0, np.random.default_rng(5)
    moving = np.stack(
        [0.3 * np.sin(np.pi * time), 0.1 * np.cos(4 * np.pi * time), 0.02 * np.sin(16 * np.pi * time)], axis=1
    )
    hum = 0.002 * np.sin(2 * np.pi * 20.0 * time)[:, None]  # a line, as of a lamp
    for sd in (0.0003, 0.001, 0.003):
        found = [fast_noise(moving + hum + rng.normal(0, sd, moving.shape)) for _ in range(50)]
        assert np.mean(found) == pytest.approx(sd, rel=0.25 if frames == 40 else 0.1)


@pytest.mark.statistical
def test_a_noisy_pivot_does_not_make_the_pendulum_fast(movement, events):
    """With noise of 3 mm the angular velocity stays nearer to the truth than the rules', the ankles being the pivot."""
    rng = np.random.default_rng(6)
    noisy = {name: points + rng.normal(0, 3e-3, points.shape) for name, points in movement.markers.items()}
    recording = MarkerRecording("noisy", movement.time, 100.0, noisy)
    time, nodes = at_nodes(recording, 2 * RATE)
    found = fit(build(time, nodes, 1.75, "male", np.ones(len(time), dtype=bool)))
    for side in "LR":  # means of two frames
        assert found.noise[f"{side}_ANKLE"].sd == pytest.approx(3e-3 / np.sqrt(2), rel=0.2)
    inside = (time >= events.deposit_start) & (time <= events.release)

    def speed(points, pivot, times):
        relative = segment_centres(points, WINTER)["abdomen"] - pivot
        return np.interp(time, times, np.gradient(np.arctan2(relative[:, 1], relative[:, 2]), times))[inside]

    def middle(positions):
        return (positions["L_ANKLE"] + positions["R_ANKLE"]) / 2

    smooth = filter_markers(recording)
    rules = trunk_points(smooth, "inner", "harrington", "male")
    exact = trunk_points(
        MarkerRecording("true", movement.time, 100.0, movement.markers), "inner", "harrington", "male"
    )
    truth = speed(exact, middle(movement.markers), movement.time)
    errors = [
        np.sqrt(np.mean((each - truth) ** 2))
        for each in (
            speed(model_points(found, found.best), middle(found.best.points), time),
            speed(rules, middle(smooth.positions), movement.time),
        )
    ]
    assert errors[0] < 0.7 * errors[1]


def test_derivatives_of_every_prediction_are_those_of_differences(fitted):
    structure, best = fitted.model.structure, fitted.best
    rng = np.random.default_rng(1)
    size = 1e-6
    states = size * rng.standard_normal((len(fitted.model.time), structure.size))
    constants = size * rng.standard_normal(structure.constants)
    ahead, behind = best.advance(structure, states, constants), best.advance(structure, -states, -constants)
    for measurement in fitted.model.measurements:
        _, prediction = measurement.residual(structure, best)
        expected = sum(np.einsum("nij,nj->ni", slope, states[:, where]) for where, slope in prediction.states)
        expected += sum(slope @ constants[where] for where, slope in prediction.constants)
        change = measurement.residual(structure, behind)[0] - measurement.residual(structure, ahead)[0]
        seen = np.isfinite(change).all(axis=1)
        np.testing.assert_allclose(change[seen] / 2, expected[seen], atol=2e-9, err_msg=measurement.name)


def test_exchanged_markers_are_left_out_and_pull_nothing(fitted, deposit, movement):
    recording, swapped = deposit
    inside = np.interp(fitted.model.time, recording.time, swapped) == 1.0
    for marker in ("C7", "T12"):
        assert not fitted.kept[marker][inside].any()
        truth = at_instants(fitted, movement.time, movement.markers[marker])[inside]
        off = np.linalg.norm(predicted_marker(fitted, marker)[inside] - truth, axis=1)
        assert off.max() < 0.012  # exchanged they are 0.29 m off
    others = [name for name in fitted.noise if name not in ("C7", "T12") and name in recording]
    assert all(fitted.kept[name][np.isfinite(fitted.residuals[name]).all(axis=1)].all() for name in others)


def test_centres_of_mass_lie_within_their_interval(fitted, movement):
    best = segment_centres(model_points(fitted, fitted.best), WINTER)
    drawn = [segment_centres(model_points(fitted, draw), WINTER) for draw in fitted.draws(60, 1)]
    for com, truth in movement.centres_of_mass.items():
        off = best[com] - at_instants(fitted, movement.time, truth)
        sd = np.std([centres[com] for centres in drawn], axis=0)
        assert np.linalg.norm(off, axis=1).max() < 0.03
        assert (np.abs(off) < 2.6 * sd).all()
        assert 0.004 < sd.mean() < 0.02


def test_basin_areas_have_an_interval_that_holds_the_true_one(fitted, movement, events):
    times = {"lift_off": events.lift_off, "deposit_start": events.deposit_start, "release": events.release}
    found = {name: Event(time, "declared", "of the twin") for name, time in times.items()}
    box = BoxSettings(share="by_mass", in_position=False)
    lifting = LiftingSettings(pivot="mid_ankle", points=60, box=box)
    conditions = Conditions(WINTER, 78.0, 23.0, 0.0, found, lifting, event_sd=0.03)
    pendulums = model_pendulums(fitted, conditions, fitted.draws(10, 1))
    seen = {name: replace(event, method="detected") for name, event in found.items()}
    apart = model_pendulums(fitted, replace(conditions, events=seen), fitted.draws(10, 1))
    # Of ten draws, start and release scatter by a standard deviation known to a quarter; detected ones move apart alone.
    ends = [[next(iter(draw.values())).time[[0, -1]] for draw in each.draws] for each in (pendulums, apart)]
    declared, detected = np.array(ends) - list(times.values())[1:]
    assert ((declared.std(axis=0) > 0.012) & (declared.std(axis=0) < 0.05)).all()
    np.testing.assert_allclose(detected, np.abs(declared) * (-1, 1), atol=1e-9)
    pivot = (movement.markers["L_ANKLE"] + movement.markers["R_ANKLE"]) / 2
    true = {}
    for com, centre in movement.centres_of_mass.items():
        span = events.deposit_start, events.release
        for plane, states in pendulum_states(movement.time, centre - pivot, *span, 60, com).items():
            true[com, plane] = states
    settings = replace(StabilitySettings(), knots=50)
    table = basin_intervals(pendulums, settings, "inverted", "mid_ankle")
    truth = basin_intervals(replace(pendulums, states=true, draws=[]), settings, "inverted", "mid_ankle")
    assert len(table) == 6
    spread = table.mean_area_sd / table.mean_area
    assert spread.between(0.005, 0.2).all()
    assert (np.abs(table.mean_area - truth.mean_area) < 3 * table.mean_area_sd).all()
    assert truth.mean_area_low.isna().all() and table.lasting_share.isna().all()
    other, *causes = np.random.default_rng(1).standard_normal((21, 400))
    assert explained_share(3 * causes[0] + other, np.transpose(causes)) == pytest.approx(0.9, abs=0.03)
    assert explained_share(other, np.transpose(causes)) < 0.06
    # A centre of mass at its pivot is no pendulum: three of ten draws, and then the most probable one.
    key = ("abdomen", "flexion_extension")
    short = {key: replace(pendulums.states[key], length=0 * pendulums.states[key].length + 1e-3)}
    some = [draw | short if number < 3 else draw for number, draw in enumerate(pendulums.draws)]
    for best, known in ((pendulums.states, True), (pendulums.states | short, False)):
        rows = basin_intervals(replace(pendulums, states=best, draws=some), settings, "inverted", "mid_ankle")
        row = rows.set_index(["com", "plane"]).loc[key]
        assert row.no_basin_share == pytest.approx(0.3) and row.draws_without_basin == 3
        interval = row[["mean_area", "mean_area_low", "mean_area_high"]].to_numpy(float)
        assert np.isfinite(interval).all() == known


def test_too_few_markers_of_a_part_are_refused(deposit):
    time, nodes = at_nodes(deposit[0], RATE)
    gone = ("L_ASIS", "R_ASIS", "L_HIP", "R_HIP", "L5", "SACRUM")
    few = {name: points for name, points in nodes.items() if name not in gone}
    with pytest.raises(InputError, match=r"three markers of the pelvis .* there are L_PSIS, R_PSIS"):
        build(time, few, 1.75)


def named(shared, path, **layout):
    """Landmarks of trunk and pelvis of a real recording."""
    file = shared / "real" / "lifting" / path
    recording = measured_markers(
        read_markers(file, MarkerLayout(forward="+x", check_axes=False, **layout)), {}
    )
    known = {*anatomy.THORAX, *anatomy.PELVIS} - {"L_HIP", "R_HIP"}
    positions = {name: points for name, points in recording.positions.items() if name in known}
    return replace(recording, positions=positions)


def test_t12_of_a_person_standing_is_estimated_without_its_marker(shared):
    """Measured: 14 mm off, standard deviation 33 mm in space."""
    recording = named(shared, "athlete_static_full_spine/c3dfile1.c3d")
    recording = cut(recording, recording.time < 1.0)
    truth = recording.positions.pop("T12").mean(axis=0)
    time, nodes = at_nodes(recording, RATE)
    found = fit(build(time, nodes, 1.60, "female"))
    place = found.best.place(found.model.structure, "thorax", "T12").mean(axis=0)
    assert np.linalg.norm(place - truth) < 0.03


def test_c7_hidden_while_rising_from_a_bend_is_predicted_better_than_by_a_spline(shared):
    """The real marker moves by most of a metre while it is hidden; no other marker is on the upper back."""
    recording = named(shared, "athlete_floor_pickup_squats/squat.c3d", up="+y")
    recording = cut(recording, recording.time < 3.6)
    truth = recording["C7"].copy()
    recording["C7"][(recording.time > 1.6) & (recording.time < 2.6)] = np.nan
    time, nodes = at_nodes(recording, RATE)
    hidden = (time > 1.65) & (time < 2.55)
    found = fit(build(time, nodes, 1.72))
    spline = fill_gaps(recording, 1.1)[0]["C7"]
    expected = at_instants(found, recording.time, truth)
    errors = [predicted_marker(found, "C7") - expected, at_instants(found, recording.time, spline) - expected]
    model, interpolated = (np.sqrt(np.mean(np.sum(error[hidden] ** 2, axis=1))) for error in errors)
    assert model < 0.03
    assert interpolated > 4 * model


def test_a_recorded_lift_is_saved_with_deviations_and_intervals(shared, tmp_path):
    """Of the box transfer, whose left arm, C7, T12 and L5 have no markers; the rules guess the latter from others."""
    study, subject = study_settings("studies/box_transfer.yaml").lifting, subject_settings("box_transfer")
    path = shared / "real" / "lifting" / "s2m_box_transfer" / "Vicon.c3d"
    trial = subject.trials[0]
    lift = analyse_lift(read_markers(path, study.markers), "box", subject, trial, study)
    settings = replace(study_settings("studies/box_transfer.yaml").stability, knots=50)
    few = replace(study, body_model=BodyModelSettings(draws=3, rate_Hz=RATE))
    model = body_model(lift, subject, trial, few, "recorded", settings)
    model.save(tmp_path)
    assert "not used, rides on no part: " in str(model)
    states = pd.read_csv(tmp_path / "body_model_pendulum.csv")
    assert (states.angle_sd_rad > 0.005).all()
    assert len(pd.read_csv(tmp_path / "body_model_areas.csv")) == 6
    markers = pd.read_csv(tmp_path / "body_model_markers.csv").set_index("marker")
    assert markers.part[["L_ASIS", "T10", "BOX_1"]].tolist() == ["pelvis", "thorax", "box"]
    for (com, plane), rules in lift.states.items():
        rows = states[(states.com == com) & (states.plane == plane)]
        assert (np.abs(rows.angle_rad.to_numpy() - rules.angle) < 4 * rows.angle_sd_rad.to_numpy()).all()


N, SIZE, CONSTANTS = 8, 3, 2


def dense(information: Information) -> np.ndarray:
    """The whole matrix of the normal equations."""
    n, size = information.states.shape
    matrix = np.zeros((n * size + CONSTANTS, n * size + CONSTANTS))
    blocks = matrix[: n * size, : n * size].reshape(n, size, n, size)
    for t in range(n):
        blocks[t, :, t] = information.same[t]
        if t + 1 < n:
            blocks[t + 1, :, t], blocks[t, :, t + 1] = information.next[t], information.next[t].T
        if t + 2 < n:
            blocks[t + 2, :, t] = blocks[t, :, t + 2] = np.diag(information.second[t])
    border = information.border.reshape(n * size, -1)
    matrix[: n * size, n * size :], matrix[n * size :, : n * size] = border, border.T
    matrix[n * size :, n * size :] = information.corner
    return matrix


@pytest.fixture
def gathered():
    """Return information of a measurement with a gap, correlated in time, and its independent counterpart."""
    rng = np.random.default_rng(3)
    slope, fixed, residual = rng.normal(size=(N, 2, 2)), rng.normal(size=(N, 2, 1)), rng.normal(size=(N, 2))
    weight = np.array([1.0, 1, 1, 0, 0, 1, 1, 1])
    information = Information(N, SIZE, CONSTANTS)
    information.add(residual, [(slice(1, 3), slope)], [(slice(1, 2), fixed)], Noise(0.5, 0.8), weight)
    whole = np.zeros((N, 2, N * SIZE + CONSTANTS))
    for t in range(N):
        whole[t, :, t * SIZE + 1 : t * SIZE + 3], whole[t, :, N * SIZE + 1] = slope[t], fixed[t, :, 0]
    matrix, right = 0.0, 0.0
    for stretch in (slice(0, 3), slice(5, 8)):
        lag = np.abs(np.subtract.outer(np.arange(3), np.arange(3)))
        inverse = np.linalg.inv(0.25 * 0.8**lag)
        for axis in range(2):
            part = whole[stretch, axis]
            matrix = matrix + part.T @ inverse @ part
            right = right + part.T @ inverse @ residual[stretch, axis]
    return information, matrix, right


def test_a_gauss_markov_residual_has_the_information_of_its_covariance_matrix(gathered):
    information, matrix, right = gathered
    np.testing.assert_allclose(dense(information), matrix, atol=1e-10)
    found = np.concatenate([information.states.ravel(), information.constants])
    np.testing.assert_allclose(found, right, atol=1e-10)


@pytest.fixture
def definite(gathered):
    """Return information that tells all unknowns."""
    information = gathered[0]
    bend = np.random.default_rng(4).normal(size=(N - 2, SIZE))
    information.add_smoothness(slice(0, SIZE), bend, 2.0)
    information.same += 0.3 * np.eye(SIZE)
    information.add_prior(np.arange(CONSTANTS), np.array([[1.0, 0.4], [0.0, 0.7]]), np.array([0.3, -0.2]))
    return information


def test_smoothness_is_that_of_second_differences():
    information = Information(N, SIZE, CONSTANTS)
    bend = np.random.default_rng(5).normal(size=(N - 2, SIZE))
    information.add_smoothness(slice(0, SIZE), bend, 2.0)
    difference = np.diff(np.eye(N), 2, axis=0)
    expected = np.kron(2.0 * difference.T @ difference, np.eye(SIZE))
    np.testing.assert_allclose(dense(information)[: N * SIZE, : N * SIZE], expected, atol=1e-12)
    np.testing.assert_allclose(information.states, -2.0 * difference.T @ bend, atol=1e-12)


def test_the_factor_solves_and_draws_as_the_dense_matrix(definite):
    matrix = dense(definite)
    states, constants = definite.factor().solve(definite.states.ravel(), definite.constants)
    right = np.concatenate([definite.states.ravel(), definite.constants])
    np.testing.assert_allclose(np.concatenate([states, constants]), np.linalg.solve(matrix, right), atol=1e-9)
    drawn = np.concatenate(definite.factor().draws(40000, np.random.default_rng(1)))
    covariance = np.linalg.inv(matrix)
    scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    # The standard error of a correlation from 40,000 draws is at most 0.007.
    np.testing.assert_allclose(np.cov(drawn) / scale, covariance / scale, atol=0.035)


def test_what_nothing_tells_is_an_error():
    empty = np.zeros((1, 2, 2))
    with pytest.raises(NumericalError, match="not positive definite"):
        factorise(empty, np.zeros((0, 2, 2)), np.zeros((2, 1)), np.eye(1))
