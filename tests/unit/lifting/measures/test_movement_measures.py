"""Measures of whole lifts against the synthetic lifters' movement and force plates, moments in closed form; page and figures."""

from dataclasses import replace

import ezc3d
import numpy as np
import pandas as pd
import pytest
import sympy
from lifting_cases import ATHLETE, cut, lift_of, true_recording, without

from lumbar.base.files import write_csv, write_json
from lumbar.interface.movement import measure_movement
from lumbar.lifting.measures.back_load import Link, net_moment
from lumbar.lifting.measures.course import Lifter, course_of_lift
from lumbar.lifting.measures.lift_values import ALL, SAGITTAL, long_table, measures_page, write_measures
from lumbar.records.markers import read_markers
from lumbar.settings.lifting import LiftingSettings, SubjectSettings
from lumbar.settings.stability import MeasureSettings
from lumbar.tables.table import SYNTHETIC_TWIN
from study_settings import changed, subject_settings

G = 9.81


def synthetic(name):
    """A synthetic lift without noise, and the person."""
    return true_recording(name), subject_settings(name.split("_")[0])


@pytest.fixture(scope="module")
def lifts():
    found = {}
    for name in ("expert_23kg", "novice_23kg"):
        recording, subject = synthetic(name)
        found[name] = lift_of(recording, subject, 23.0)
    return found


@pytest.fixture(scope="module")
def found(lifts):
    return {name: measure_movement(item) for name, item in lifts.items()}


def value(found, measure, plane=ALL):
    rows = found.values.set_index(["measure", "plane"])
    return rows.loc[(measure, plane), "value"]


def test_the_lumbar_spine_bends_as_it_was_made_to(found):
    """Thorax 1, pelvis 0.45 of the flexion (`lumbar.twin.lifter`): 24° and 36° beyond the 4° of carrying."""
    for name, flexion in (("expert_23kg", 28), ("novice_23kg", 40)):
        bent = value(found[name], "lumbar_flexion_release", SAGITTAL)
        assert bent == pytest.approx(0.55 * flexion, abs=1.5)


def test_numbers_at_the_release_by_hand(lifts, found):
    """Static enough at the release: margin over the toes and moment from the masses' places alone, within a few per cent."""
    body, facts = lifts["expert_23kg"].body, lifts["expert_23kg"].facts
    course = found["expert_23kg"].instants
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
        mass * G * (place - point["L5S1"])[1] for mass, place in [*parts, *arms, (23, point["LOAD"])]
    )
    assert course.loc[at, "l5s1_extension_N_m"] == pytest.approx(static, rel=0.05)
    assert facts["no_deposit"] is None


def test_a_file_gives_what_memory_gives(lifts, found, tmp_path):
    lifted = lifts["expert_23kg"]
    write_csv(tmp_path / "body.csv", lifted.body)
    write_json(tmp_path / "pendulum.json", lifted.facts)
    read = measure_movement(tmp_path / "body.csv")
    pd.testing.assert_frame_equal(read.values, found["expert_23kg"].values, rtol=1e-9)


@pytest.mark.parametrize(
    ("gone", "measure", "said"),
    [
        ("WRIST", "l5s1_moment_peak", "no marker L_WRIST"),
        ("WRIST", "margin_of_stability", "no L_WRIST, R_WRIST"),
        ("ANKLE", "margin_of_stability", "no L_ANKLE"),
        ("BOX", "viability_margin", ""),
        ("R_TOE R_HEEL", "smallest_impulse", "no marker R_HEEL; no marker R_TOE"),
    ],
)
def test_what_lacks_markers_is_absent_with_its_reason(gone, measure, said):
    recording, subject = synthetic("expert_23kg")
    rows = measure_movement(lift_of(without(recording, *gone.split()), subject, 23.0)).values
    rows = rows[rows["measure"] == measure]
    if not said:  # the hands stand for the box
        assert (rows["reason"] == "").all()
        return
    assert rows["value"].isna().all()
    assert rows["reason"].str.contains(said).all()


def test_a_foot_without_a_toe_marker_has_the_length_of_its_stature(found):
    recording, subject = synthetic("expert_23kg")
    toeless = measure_movement(lift_of(without(recording, "TOE"), subject, 23.0))
    assert len(toeless.course.notes) == 2
    assert "L_TOE has no marker" in str(toeless)
    marked = value(found["expert_23kg"], "margin_of_stability")
    assert value(toeless, "margin_of_stability") == pytest.approx(marked, abs=0.01)


def test_without_a_deposit_there_is_what_the_lift_so_far_carried_and_a_hidden_heel_takes_only_what_needs_it():
    recording, subject = synthetic("expert_23kg")
    rows = measure_movement(lift_of(cut(recording, recording.time < 5.0), subject, 23.0)).values
    whole = rows["measure"].str.endswith("_carried")
    assert rows.loc[~whole, "value"].isna().all()
    assert rows.loc[~whole, "reason"].str.contains("the deposit is not known").all()
    complete = measure_movement(lift_of(recording, subject, 23.0)).values
    peaks = [found.loc[whole, "value"].dropna().to_numpy() for found in (rows, complete)]
    assert peaks[0] == pytest.approx(peaks[1], rel=0.02) and (peaks[0] > [150, 25]).all()
    hidden = dict(recording.positions)
    hidden["L_HEEL"] = np.where(
        (recording.time > 6.2)[:, None] & (recording.time < 6.7)[:, None], np.nan, hidden["L_HEEL"]
    )
    rows = measure_movement(lift_of(replace(recording, positions=hidden), subject, 23.0)).values.set_index(
        "measure"
    )
    assert not rows.loc["l5s1_moment_peak", "value"].isna().any()
    assert rows.loc["lumbar_flexion_peak", "reason"] == ""


def test_joint_angles_and_margin_of_an_athlete_who_stands_with_spread_arms(shared):
    path = shared / "real" / "lifting" / "athlete_static_full_spine" / "c3dfile1.c3d"
    settings = changed(LiftingSettings(), markers={"aliases": ATHLETE, "check_axes": False})
    weighed = SubjectSettings(name="x", sex="female", mass_kg=62.0, height_m=1.6, experience="unknown")
    item = lift_of(read_markers(path, settings.markers), weighed, settings=settings)
    balance = course_of_lift(Lifter(item.body, item.facts, MeasureSettings(), G)).frame
    assert (balance["l_knee_flexion_deg"] < 15).all()
    assert balance["r_shoulder_elevation_deg"].between(60, 110).all()
    assert balance["margin_of_stability_m"].between(0.03, 0.09).all()


def test_hips_and_knees_bend_as_plug_in_gait_says_but_for_their_zero(shared):
    """A walker whose file has the angles of another model: the same course within 1°, from joints of other regressions."""
    path = shared / "real" / "lifting" / "ktk_pig_com_oracle" / "gait.c3d"
    markers = {"unit": "m", "check_axes": False, "aliases": {
        "SACRUM": {"mean": ["L_PSIS", "R_PSIS"]}, "T12": {"between": ["T10", "SACRUM"], "share": 0.263},
        "L5": {"between": ["T12", "SACRUM"], "share": 0.65},
    }}  # fmt: skip
    settings = changed(LiftingSettings(), markers=markers)
    walker = SubjectSettings(name="x", sex="male", mass_kg=75.0, height_m=1.75, experience="unknown")
    course = measure_movement(
        lift_of(read_markers(path, settings.markers), walker, settings=settings)
    ).instants
    content = ezc3d.c3d(str(path))
    labels = content["parameters"]["POINT"]["LABELS"]["value"]
    for joint, limit in (("Hip", 35.0), ("Knee", 45.0)):
        for side in "LR":
            other = (
                1e3 * content["data"]["points"][0, labels.index(f"{side}{joint}Angles")]
            )  # stored as metres
            angle = course[f"{side}_{joint}_flexion_deg".lower()].to_numpy()
            assert np.std(angle - other) < 1.2 and np.ptp(angle) > limit
        sides = [course[f"{side}_{joint}_flexion_deg".lower()] for side in "lr"]
        assert course[f"{joint}_flexion_deg".lower()].equals(np.maximum(*sides))


RATE = 1000.0
TIME = np.arange(0, 2, 1 / RATE)


def test_a_body_at_rest_needs_its_weight_times_the_arm():
    joint = np.zeros((10, 3))
    trunk = Link(40.0, np.tile([0.0, 0.2, 0.3], (10, 1)), np.tile([0.0, 0.4, 0.6], (10, 1)), 0.1)
    box = Link(np.full(10, 15.0), np.tile([0.1, 0.5, 0.2], (10, 1)))
    moment = net_moment(joint, [trunk, box], 100.0, G)
    assert moment[:, 0] == pytest.approx(G * (40 * 0.2 + 15 * 0.5))  # extension, about the axis to the right
    assert moment[:, 1] == pytest.approx(-G * 15 * 0.1)  # the box at the right is held by bending left
    assert moment[:, 2] == pytest.approx(0, abs=1e-9)


def angles():
    """Inclinations of two links, radians from straight up, and their first two derivatives."""
    t = sympy.Symbol("t")
    expressions = 0.6 + 0.5 * sympy.sin(2.1 * t), 0.9 - 0.7 * sympy.cos(3.3 * t)
    return t, expressions


def test_two_links_agree_with_lagrange_s_equations():
    """Moment about the lower joint: d/dt ∂L/∂q̇ − ∂L/∂q of the chain turned as a whole, by symbolic differentiation."""
    t, inclinations = angles()
    turn = sympy.Function("turn")(t)
    lengths, centres, masses, gyrations = (0.45, 0.6), (0.25, 0.3), (30.0, 12.0), (0.12, 0.17)
    kinetic = potential = 0
    base = sympy.Matrix([0, 0])
    for q, length, centre, mass, k in zip(inclinations, lengths, centres, masses, gyrations, strict=True):
        along = sympy.Matrix([sympy.sin(q + turn), sympy.cos(q + turn)])
        place = base + centre * along
        speed = place.diff(t)
        kinetic += mass / 2 * (speed.dot(speed) + k**2 * sympy.diff(q + turn, t) ** 2)
        potential += mass * G * place[1]
        base = base + length * along
    lagrangian = kinetic - potential
    moment = sympy.diff(lagrangian.diff(turn.diff(t)), t) - lagrangian.diff(turn)
    expected = sympy.lambdify(t, -moment.subs(turn, 0).doit(), "numpy")(TIME)

    q = [sympy.lambdify(t, expression, "numpy")(TIME) for expression in inclinations]
    axes = [np.stack([0 * angle, np.sin(angle), np.cos(angle)], axis=1) for angle in q]
    second = lengths[0] * axes[0] + centres[1] * axes[1]
    links = [
        Link(masses[0], centres[0] * axes[0], axes[0], gyrations[0]),
        Link(masses[1], second, axes[1], gyrations[1]),
    ]
    found = net_moment(np.zeros((len(TIME), 3)), links, RATE, G)
    # An inclination grows forward, against the rotation about the axis to the right.
    assert found[5:-5, 0] == pytest.approx(expected[5:-5], rel=1e-4, abs=0.01)
    assert np.abs(found[:, 1:]).max() < 1e-9


def test_a_body_in_free_flight_needs_no_moment_about_its_own_centre():
    """Two masses on a slender rod that tumbles and falls: all angular momentum about the common centre is kept."""
    centre = np.stack([0.3 * TIME, 1.1 * TIME, 2 * TIME - 0.5 * G * TIME**2], axis=1)
    axis = np.stack([np.cos(3 * TIME), 0.6 * np.sin(3 * TIME), 0.8 * np.sin(3 * TIME)], axis=1)
    links = [Link(4.0, centre + 0.3 * axis, axis, 0.2), Link(6.0, centre - 0.2 * axis, axis, 0.1)]
    assert np.abs(net_moment(centre, links, RATE, G)[5:-5]).max() < 1e-3


@pytest.fixture(scope="module")
def measured():
    """Two measured lifts, the second without feet."""
    made = []
    for name, hidden in (("expert_23kg", ()), ("novice_23kg", ("TOE", "HEEL"))):
        recording = without(true_recording(name), *hidden)
        lift = lift_of(recording, subject_settings(name.split("_")[0]), 23.0, name=name)
        found = measure_movement(lift)
        events = {key: event.as_dict() for key, event in lift.analysed.events.items()}
        made.append({"course": found.instants, "facts": lift.facts, "events": events, "values": found.values})
    return made


@pytest.fixture(scope="module")
def table(measured):
    groups = {"expert": "expert", "novice": "novice"}
    return long_table(((lift["values"], lift["facts"]) for lift in measured), groups)


def test_the_page_has_the_mean_of_a_group_and_says_what_is_absent(table):
    page = measures_page(table, SYNTHETIC_TWIN)
    rows = page.frame.set_index(["measure", "plane"])
    again = table[(table["measure"] == "l5s1_moment_peak") & (table["plane"] == "all")].set_index("group")[
        "value"
    ]
    assert rows.loc[("l5s1_moment_peak", "all"), "expert 23 kg"] == again["expert"]
    assert np.isnan(rows.loc[("margin_of_stability", "all"), "novice 23 kg"])
    assert any(": no marker L_HEEL" in note for note in page.notes)
    doubled = measures_page(pd.concat([table, table.assign(lift="again", value=table["value"] + 2)]), "x")
    mean = doubled.frame.set_index(["measure", "plane"]).loc[("l5s1_moment_peak", "all"), "expert 23 kg"]
    assert mean == pytest.approx(again["expert"] + 1)


def test_the_long_table_is_the_csv_and_the_page_the_rest(table, tmp_path):
    write_measures(tmp_path / "movement_measures", table, SYNTHETIC_TWIN)
    read = pd.read_csv(tmp_path / "movement_measures.csv", keep_default_na=False, na_values=[""])
    assert len(read) == len(table)
    assert set(read["data"]) == {SYNTHETIC_TWIN}
    assert "Hof, Gazendam" in (tmp_path / "movement_measures.html").read_text(encoding="utf-8")
    assert r"\begin{tabular}" in (tmp_path / "movement_measures.tex").read_text(encoding="utf-8")
