"""Measures of whole lifts against the synthetic lifters' movement and another model's angles."""

from dataclasses import replace

import ezc3d
import numpy as np
import pandas as pd
import pytest
from lifting_cases import ANN, ATHLETE, cut, hide_markers, trial_of, true_recording

import lumbar
from study_settings import changed, subject_settings

LIFTING = lumbar.load_settings().lifting


def lift_of(recording, subject="expert", settings=None):
    """The lift of a box of 23 kg."""
    return lumbar.lift(recording, subject_settings(subject), trial=trial_of(23.0), settings=settings)


def measured(recording):
    return lumbar.measure_movement(lift_of(recording))


@pytest.fixture(scope="module")
def expert():
    """A synthetic lift without noise."""
    return true_recording("expert_23kg")


@pytest.fixture(scope="module")
def lifts(expert):
    return {"expert_23kg": lift_of(expert), "novice_23kg": lift_of(true_recording("novice_23kg"), "novice")}


@pytest.fixture(scope="module")
def actual(lifts):
    return {name: lumbar.measure_movement(item) for name, item in lifts.items()}


def value(actual, measure, plane="all"):
    rows = actual.values.set_index(["measure", "plane"])
    return rows.loc[(measure, plane), "value"]


def test_lumbar_flexion_equals_that_of_the_made_motion(actual):
    """Thorax 1, pelvis 0.45 of the flexion (`lumbar.twin.lifter`): 24° and 36° beyond the 4° of carrying."""
    for name, flexion in (("expert_23kg", 28), ("novice_23kg", 40)):
        bent = value(actual[name], "lumbar_flexion_release", "flexion_extension")
        assert bent == pytest.approx(0.55 * flexion, abs=1.5)


def test_numbers_at_the_release_by_hand(lifts, actual):
    """Static enough at the release: margin over the toes and moment from the masses' places alone, within a few per cent."""
    body, facts = lifts["expert_23kg"].body, lifts["expert_23kg"].facts
    course = actual["expert_23kg"].instants
    at = course.index[course["phase"] == "deposit"][-1]
    point = {name: body.loc[at, [f"{name}_{axis}_m" for axis in "xyz"]].to_numpy(float) for name in (
        "WHOLE_BODY", "LOAD", "L5S1", "HEAD", "THORAX_COM", "ABDOMEN_COM", "L_TOE", "L_HEEL",
        "L_SHOULDER", "R_SHOULDER", "L_WRIST", "R_WRIST",
    )}  # fmt: skip
    centre = (78 * point["WHOLE_BODY"] + 23 * point["LOAD"]) / 101
    assert course.loc[at, "com_y_m"] == pytest.approx(centre[1], abs=1e-6)
    edge = point["L_HEEL"][1] + 0.8 * max(0.152 * 1.75, point["L_TOE"][1] - point["L_HEEL"][1])
    assert course.loc[at, "margin_forward_m"] == pytest.approx(edge - course.loc[at, "xcom_y_m"], abs=1e-3)
    arms = [
        (0.05 * 78, point[f"{side}_SHOULDER"] + 0.53 * (point[f"{side}_WRIST"] - point[f"{side}_SHOULDER"]))
        for side in "LR"
    ]
    parts = [
        (0.216 * 78, point["THORAX_COM"]),
        (0.139 * 78, point["ABDOMEN_COM"]),
        (0.081 * 78, point["HEAD"]),
    ]
    static = sum(
        mass * 9.81 * (place - point["L5S1"])[1] for mass, place in [*parts, *arms, (23, point["LOAD"])]
    )
    assert course.loc[at, "l5s1_extension_N_m"] == pytest.approx(static, rel=0.05)
    assert facts["no_deposit"] is None


def test_saved_lift_gives_the_same_measures(lifts, actual, tmp_path):
    lifts["expert_23kg"].save(tmp_path)
    read = lumbar.measure_movement(tmp_path / "body.csv")
    pd.testing.assert_frame_equal(read.values, actual["expert_23kg"].values, rtol=1e-9)


@pytest.mark.parametrize(
    ("gone", "measure", "reason"),
    [
        ("WRIST", "l5s1_moment_peak", "L_WRIST"),
        ("WRIST", "margin_of_stability", "L_WRIST, R_WRIST"),
        ("ANKLE", "margin_of_stability", "L_ANKLE"),
        ("T12", "margin_of_stability", "thorax, abdomen"),
        ("BOX", "viability_margin", None),  # the hands replace the box
        ("R_TOE R_HEEL", "smallest_impulse", "R_HEEL.*R_TOE"),
    ],
)
def test_measure_without_its_markers_has_a_reason(expert, gone, measure, reason):
    rows = measured(hide_markers(expert, *gone.split())).values
    rows = rows[rows["measure"] == measure]
    assert rows["value"].isna().all() if reason else (rows["reason"] == "").all()
    assert rows["reason"].str.contains(reason or "").all()


def test_foot_without_a_toe_marker_has_the_length_of_its_stature(expert, actual):
    toeless = measured(hide_markers(expert, "TOE"))
    assert len(toeless.course.notes) == 2
    assert all("TOE" in note for note in toeless.course.notes) and "L_TOE" in str(toeless)
    marked = value(actual["expert_23kg"], "margin_of_stability")
    assert value(toeless, "margin_of_stability") == pytest.approx(marked, abs=0.01)


def test_missing_deposit_keeps_carry_measures(expert, actual):
    rows, complete = measured(cut(expert, expert.time < 5.0)).values, actual["expert_23kg"].values
    whole = rows["measure"].str.endswith("_carried")
    assert rows.loc[~whole, "value"].isna().all()
    assert rows.loc[~whole, "reason"].str.contains("deposit_start: .*release: ").all()
    peaks = [frame.loc[whole, "value"].dropna().to_numpy() for frame in (rows, complete)]
    assert peaks[0] == pytest.approx(peaks[1], rel=0.02) and (peaks[0] > [150, 25]).all()


def test_hidden_heel_drops_only_dependent_measures(expert):
    is_hidden = (expert.time > 6.2) & (expert.time < 6.7)
    heel = np.where(is_hidden[:, None], np.nan, expert["L_HEEL"])
    rows = measured(replace(expert, positions={**expert.positions, "L_HEEL": heel})).values.set_index(
        "measure"
    )
    assert not rows.loc["l5s1_moment_peak", "value"].isna().any()
    assert rows.loc["lumbar_flexion_peak", "reason"] == ""


def test_joint_angles_and_margin_of_a_standing_athlete(shared):
    path = shared / "real" / "lifting" / "athlete_static_full_spine" / "c3dfile1.c3d"
    settings = changed(LIFTING, markers={"aliases": ATHLETE, "check_axes": False})
    athlete = ANN.model_copy(update={"sex": "female", "mass_kg": 62.0, "height_m": 1.6})
    item = lumbar.lift(lumbar.read(path, layout=settings.markers), athlete, 0.0, settings=settings)
    balance = lumbar.measure_movement(item).instants
    assert (balance["l_knee_flexion_deg"] < 15).all()
    assert balance["r_shoulder_elevation_deg"].between(60, 110).all()
    assert balance["margin_of_stability_m"].between(0.03, 0.09).all()


def test_hips_and_knees_bend_as_in_plug_in_gait_but_for_their_zero(shared):
    """A walker with a file that has the angles of another model: the course is the same within 1°, by other regressions."""
    path = shared / "real" / "lifting" / "ktk_pig_com_oracle" / "gait.c3d"
    markers = {"unit": "m", "check_axes": False, "aliases": {
        "SACRUM": {"mean": ["L_PSIS", "R_PSIS"]}, "T12": {"between": ["T10", "SACRUM"], "share": 0.263},
        "L5": {"between": ["T12", "SACRUM"], "share": 0.65},
    }}  # fmt: skip
    settings = changed(LIFTING, markers=markers)
    walker = ANN.model_copy(update={"sex": "male", "mass_kg": 75.0})
    walk = lumbar.lift(lumbar.read(path, layout=settings.markers), walker, 0.0, settings=settings)
    course = lumbar.measure_movement(walk).instants
    content = ezc3d.c3d(str(path))
    labels = content["parameters"]["POINT"]["LABELS"]["value"]
    for joint, limit in (("Hip", 35.0), ("Knee", 45.0)):
        for side in "LR":
            # Angles are stored as metres.
            other = 1e3 * content["data"]["points"][0, labels.index(f"{side}{joint}Angles")]
            angle = course[f"{side}_{joint}_flexion_deg".lower()].to_numpy()
            assert np.std(angle - other) < 1.2 and np.ptp(angle) > limit
        sides = [course[f"{side}_{joint}_flexion_deg".lower()] for side in "lr"]
        assert course[f"{joint}_flexion_deg".lower()].equals(np.maximum(*sides))
