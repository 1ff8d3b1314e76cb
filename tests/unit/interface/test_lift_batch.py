"""Which trial a file is the recording of, and several lifts at once: one that fails keeps no other from its result."""

import gzip
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import lumbar
from lumbar.base.errors import InputError
from lumbar.interface.lift import trial_of
from lumbar.interface.lift_batch import lift_all, planned_lifts
from lumbar.interface.new_study import new_study
from lumbar.lifting.movement.lift_tables import gaps_frame
from lumbar.settings.lifting import LiftingSettings
from lumbar.settings.subject import DeclaredEvents, SubjectSettings, TrialSettings
from lumbar.twin.lifting_recordings import true_movement, write_markers
from refusing import refusal
from study_settings import study_settings

LATE = DeclaredEvents(deposit_start_s=6.3, reason="test")


def person(*trials, **more):
    return SubjectSettings("ann", "female", 61.0, 1.68, "novice", trials, **more)


@pytest.fixture(scope="module")
def recording(tmp_path_factory, twin_lift):
    """A lift of the synthetic twin."""
    path = tmp_path_factory.mktemp("lift") / "day1" / "a.c3d"
    path.parent.mkdir()
    return shutil.copy(twin_lift("expert_23kg"), path)


def test_a_trial_is_that_of_its_own_file_whatever_the_box():
    """The first trial with the same box is another lift: its events are not this one's."""
    ann = person(TrialSettings(23, "day1/a.c3d", events=LATE), TrialSettings(23, "day1/b.c3d"))
    name, trial = trial_of(ann, Path("/data/day1/b.c3d"), 23)
    assert (name, trial.events) == ("ann_23kg_2", None)
    assert trial_of(ann, Path("/data/day1/a.c3d"), None)[1].events == LATE


def test_a_file_that_no_trial_names_is_refused_with_the_candidates():
    ann = person(TrialSettings(23, "day1/a.c3d", events=LATE), TrialSettings(15, "day1/b.c3d"))
    said = refusal(trial_of, ann, Path("c.c3d"), 23)
    assert "c.c3d: no trial of ann names this file" in said
    assert "'lumbar new-study FOLDER' writes settings" in said
    assert "- ann_23kg: day1/a.c3d, box of 23 kg\n  - ann_15kg: day1/b.c3d, box of 15 kg" in said
    with pytest.raises(InputError, match="ann_23kg had no box of 15 kg"):
        trial_of(ann, Path("day1/a.c3d"), 15)
    assert trial_of(ann, Path("c.c3d"), None, "ann_15kg")[1].markers == "day1/b.c3d"


def test_equal_names_in_two_folders_are_told_by_the_folder():
    ann = person(TrialSettings(23, "day1/a.c3d"), TrialSettings(23, "day2/a.c3d"))
    assert trial_of(ann, Path("/data/day2/a.c3d"), None)[0] == "ann_23kg_2"
    with pytest.raises(InputError, match=r"several trials of ann name this file \(ann_23kg, ann_23kg_2\)"):
        trial_of(ann, Path("/elsewhere/a.c3d"), None)


def test_a_person_without_trials_needs_the_mass_of_the_box():
    assert trial_of(person(), Path("c.c3d"), 12)[1] == TrialSettings(12, "c.c3d")
    with pytest.raises(InputError, match=r"ann has no trials: give the mass of the box.*--box-mass"):
        trial_of(person(), Path("c.c3d"), None)


def test_a_folder_of_lifts_is_analysed_whatever_one_of_them_is(recording, tmp_path):
    folder = tmp_path / "recordings" / "day1"
    folder.mkdir(parents=True)
    for name in ("a", "b"):
        shutil.copy(recording, folder / f"{name}.c3d")
    (folder / "broken.c3d").write_bytes(b"no recording")
    ann = person(
        TrialSettings(23, "day1/a.c3d"),
        TrialSettings(23, "day1/broken.c3d"),
        TrialSettings(15, "day1/b.c3d", window_s=(0.0, 5.0)),
        TrialSettings(10, "day1/lost.c3d"),
    )
    lifts = planned_lifts([tmp_path / "recordings"], ann)
    assert [item.name for item in lifts] == ["ann_23kg", "ann_23kg_2", "ann_15kg", "ann_10kg"]
    table, failed = lift_all(lifts, ann, None, LiftingSettings(), tmp_path / "out")
    assert failed == ["ann_23kg_2", "ann_10kg"]
    rows = table.set_index("lift")
    assert rows["pendulums"].tolist() == [6, 0, 0, 0]
    assert rows.loc["ann_23kg", ["lift_off_method", "toe_off_method", "release_method"]].tolist() == [
        *("box", "toes", "box")
    ]
    times = rows.loc["ann_23kg", [f"deposit_start_{part}" for part in ("earliest_s", "s", "latest_s")]]
    assert times.is_monotonic_increasing and times.nunique() == 3
    assert rows.at["ann_15kg", "release_method"] == "absent"
    assert rows.at["ann_10kg", "remark"] == "day1/lost.c3d is not in the folder"
    assert "still moves at the last frame looked at" in rows.at["ann_15kg", "remark"]
    written = pd.read_csv(tmp_path / "out" / "lifts.csv")
    assert written["lift"].tolist() == table["lift"].tolist()
    measured = pd.read_csv(tmp_path / "out" / "movement_measures.csv").set_index("lift")
    assert set(measured.index) == {"ann_23kg", "ann_15kg"}
    lacking = measured.loc["ann_23kg"].query("value.isna()")
    assert len(lacking) == 4 and lacking["reason"].str.contains("no marker|no force plates").all()
    of_the_deposit = measured.loc["ann_15kg"].query("not measure.str.endswith('_carried')")
    assert of_the_deposit["reason"].str.contains("the deposit is not known").all()
    assert (tmp_path / "out" / "ann_15kg" / "com.csv").is_file()
    assert not (tmp_path / "out" / "ann_10kg").exists()


def test_a_window_cuts_after_filtering(recording):
    """Its ends are no ends of the filter: what lies inside is as in the whole recording."""
    whole = lumbar.lift(recording, person(), 23)
    release = whole.analysed.events["release"].time_s
    trial = TrialSettings(23, "a.c3d", window_s=(1.0, release + 0.2))
    part = lumbar.lift(recording, person(trial))
    inside = (whole.analysed.recording.time >= 1.0) & (whole.analysed.recording.time <= release + 0.2)
    assert (part.analysed.recording["C7"] == whole.analysed.recording["C7"][inside]).all()
    for name, event in whole.analysed.events.items():
        assert part.analysed.events[name].time_s == pytest.approx(event.time_s, abs=0.011), name
    said = refusal(lumbar.lift, recording, person(replace(trial, window_s=(90.0, 91.0))))
    assert "window_s 90 to 91 s holds 0 frames of the recording, which runs from 0" in said


def lifted(folder, **files):
    """Write the twin's lift into a folder, each file with its own choice and movement of the markers; return them all."""
    twin = study_settings().twin.lifting
    markers = true_movement(twin, "expert_23kg").markers
    for name, change in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        write_markers(folder / f"{name}.c3d", change(markers), twin.rate_Hz, "ann")
    return markers


def without(*labels):
    return lambda markers: {name: points for name, points in markers.items() if name not in labels}


def standing(markers):
    return {name: points[:50] for name, points in markers.items()}


def test_the_static_trial_of_a_person_tells_where_a_marker_that_is_never_seen_with_the_others_is(tmp_path):
    """The right PSIS is hidden from the first frame to the last but for a moment in which the left one is hidden."""

    def hidden(markers):
        found = {name: points.copy() for name, points in markers.items()}
        found["R_PSIS"][30:] = found["L_PSIS"][:30] = np.nan
        return found

    markers = lifted(tmp_path, **{"day1/standing": standing, "day1/a": hidden})
    ann = person(TrialSettings(23, "day1/a.c3d"), static="day1/standing.c3d")
    lift = lumbar.lift(tmp_path / "day1" / "a.c3d", ann)
    gaps = gaps_frame(lift.analysed)
    row = gaps[gaps["marker"] == "R_PSIS"].iloc[0]
    assert row["outcome"] == "filled"
    assert row["method"].startswith("rigid body: pelvis, shape from the static trial")
    assert row["frames"] == len(markers["R_PSIS"]) - 30
    error = np.linalg.norm(lift.analysed.complete["R_PSIS"] - markers["R_PSIS"], axis=1)
    assert error.max() < 1e-4, "metres; single precision in the file"
    with pytest.raises(InputError, match=r"subject.static of ann is lost.c3d, and there is no file"):
        lumbar.lift(tmp_path / "day1" / "a.c3d", replace(ann, static="lost.c3d"))


def study_text(folder) -> str:
    return next(iter(new_study(folder, "s").files.values()))


def test_a_folder_below_is_a_person_and_what_stands_still_is_the_static_trial(tmp_path):
    lifted(tmp_path / "lab", **{"ann/lift": without(), "bob/lift": without(), "ann/cal": standing})
    study = new_study(tmp_path / "lab")
    assert list(study.files) == [
        "config/studies/lab.yaml",
        "config/subjects/lab_ann.yaml",
        "config/subjects/lab_bob.yaml",
    ]
    texts = list(study.files.values())
    assert "subjects: [lab_ann, lab_bob]" in texts[0]
    assert "groups: [FILL_IN, FILL_IN]" in texts[0]
    assert "  static: ann/cal.c3d  # 100 Hz, 0.5 s" in texts[1]
    assert "markers: ann/lift.c3d}" in texts[1] and "markers: ann/cal.c3d}" not in texts[1]
    assert "static:" not in texts[2]


def test_a_trial_may_face_another_way_and_no_other_may_stand(tmp_path):
    def turned(markers):
        return {name: points * [-1, -1, 1] for name, points in markers.items()}

    def lying(markers):
        return {name: points[:, [0, 2, 1]] for name, points in markers.items()}

    lifted(tmp_path, a=without(), b=without(), c=turned)
    text = list(new_study(tmp_path).files.values())[1]
    assert [line for line in text.splitlines() if "forward:" in line] == [
        '    - {box_mass_kg: FILL_IN, markers: c.c3d, forward: "-y"}'
    ]
    trials = (TrialSettings(23, "b.c3d"), TrialSettings(23, "c.c3d", forward="-y"))
    lifts = [lumbar.lift(tmp_path / trial.markers, person(trial)).analysed for trial in trials]
    angles = [lift.states["thorax", "flexion_extension"].angle for lift in lifts]
    np.testing.assert_allclose(*angles, atol=1e-6)
    lifted(tmp_path, d=lying)
    assert "- up +y: d.c3d\n  - up +z: a.c3d, b.c3d, c.c3d" in refusal(new_study, tmp_path)


def test_a_measured_marker_stands_before_a_guess_whichever_file_was_read_first(tmp_path):
    def guessed(markers):
        return {"T10": markers["T12"] + [0, 0, 0.06], **without("T12")(markers)}

    lifted(tmp_path, a=guessed, b=without())
    said = "      T12: [T12, {between: [T10, SACRUM], share: 0.263}]  # where not measured: "
    assert said in study_text(tmp_path)


def test_the_pivot_is_one_that_every_moving_recording_has(tmp_path):
    ankles = ("L_ANKLE", "R_ANKLE")
    lifted(tmp_path, a_static=standing, b=without(*ankles))
    text = study_text(tmp_path)
    assert "      L_ANKLE: L_ANKLE" in text
    assert "  pivot: hip  # no markers on both ankles are recognised\n" in text
    assert (
        "\nstability:\n  regulator:\n    control_weight: 2.0  #" in text
    )  # that for the ankles gives no basin about hips
    lifted(tmp_path, c=without())
    assert "are recognised in b.c3d\n" in study_text(tmp_path)
    hips = [f"{side}_{part}" for side in "LR" for part in ("HIP", "ASIS")]
    lifted(tmp_path, b=without(*ankles, *hips), c=without(*ankles, *hips))
    assert "  pivot: L5  #" in study_text(tmp_path)
    lifted(tmp_path, b=without())
    (tmp_path / "c.c3d").unlink()
    assert "\n  pivot:" not in study_text(tmp_path)


def test_a_still_file_of_other_markers_is_no_static_trial(tmp_path):
    def calibration(markers):
        return {f"corner {number}": points[:50] for number, points in enumerate(list(markers.values())[:6])}

    lifted(tmp_path, a_cal=calibration, b=without())
    assert "static:" not in new_study(tmp_path, "s").files["config/subjects/s.yaml"]
    lifted(tmp_path, c=standing)
    text = new_study(tmp_path, "s").files["config/subjects/s.yaml"]
    assert "  static: c.c3d  #" in text
    assert "6 markers; nothing moves\n    - {box_mass_kg: FILL_IN, markers: a_cal.c3d}" in text


def test_the_xiphoid_is_the_label_that_says_so(tmp_path):
    """STRN is the xiphoid in Plug-in Gait and the manubrium elsewhere: XIPH is meant where both are there."""

    def renamed(**names):
        return lambda markers: {names.get(name, name): points for name, points in markers.items()}

    lifted(tmp_path, a=renamed(XIPHOID="STRN"))
    assert "  XIPHOID: STRN  # STRN is the xiphoid in Plug-in Gait" in study_text(tmp_path)
    lifted(tmp_path, b=renamed(XIPHOID="XIPH", MANUBRIUM="STRN"))
    assert "  XIPHOID: [XIPH, STRN]  #" in study_text(tmp_path)
    found = lumbar.inspect(tmp_path / "b.c3d")
    assert found.meant["XIPHOID"] == "XIPH"


def test_a_lift_without_pendulum_ends_with_why(recording, tmp_path, run):
    (tmp_path / "ann.yaml").write_text(
        "subject: {name: ann, sex: female, mass_kg: 61, height_m: 1.7, experience: novice, "
        "trials: [{box_mass_kg: 23, markers: a.c3d, window_s: [0, 5]}]}",
        encoding="utf-8",
    )
    out = run.done("lift", recording, "--subject", tmp_path / "ann.yaml", "--output", tmp_path / "out")
    basins = lumbar.basins(tmp_path / "out" / "pendulum.csv")
    assert basins.areas.empty
    assert (
        basins.failures()["reason"].str.contains("the box still moves at the last frame").tolist()
        == [True] * 6
    )
    closing = out[out.index("no pendulum: pendulum.csv in") :]
    assert "no pendulum of thorax, abdomen, pelvis: " in closing
    assert "pendulum.json are in" not in out
    out = run.done("lift", recording.parent, "--subject", tmp_path / "ann.yaml", "--output", tmp_path / "all")
    assert "no pendulum at all: ann_23kg; why stands above and in lifts.csv" in out


def test_events_say_what_they_were_found_in_and_hands_that_nothing_is_known_of_what_they_hold(tmp_path):
    lifted(tmp_path, box=without(), hands=without(*(f"BOX_{number}" for number in range(1, 9))))
    said = {}
    for name in ("box", "hands"):
        found = lumbar.lift(tmp_path / f"{name}.c3d", person(), 23)
        said[name] = str(found).splitlines()
        deposit = found.analysed.events["deposit_start"]
        assert (
            f"deposit_start: {deposit.time_s:.3f} s ({name}; {deposit.earliest_s:.2f} to {deposit.latest_s:.2f})"
            in said[name]
        )
    doubt = "the hands stand for the box, which has no markers; whether they hold anything is not known"
    assert said["hands"].count(doubt) == 1
    assert doubt not in said["box"]
    trial = TrialSettings(23, "box.c3d", events=LATE)
    assert "deposit_start: 6.300 s (set by hand)" in str(lumbar.lift(tmp_path / "box.c3d", person(trial)))


def test_forces_of_the_same_name_packed_files_and_tables_become_trials(tmp_path):
    """A TRC with its .mot, a packed C3D and a CSV file without a unit; a table of something else is no recording."""
    lifted(tmp_path, lift=lambda markers: {name: points[::4] for name, points in markers.items()})
    (tmp_path / "packed.c3d.gz").write_bytes(gzip.compress((tmp_path / "lift.c3d").read_bytes()))
    points = lumbar.read(tmp_path / "lift.c3d").positions
    table = np.hstack([1000 * values for values in points.values()])
    names = [f"{name}_{axis}" for name in points for axis in "xyz"]
    rows = np.column_stack([np.arange(len(table)) / 100, table])
    np.savetxt(tmp_path / "table.csv", rows, "%.8g", ",", header=",".join(["time_s", *names]), comments="")
    (tmp_path / "moment.csv").write_text("time_s,angle_rad\n0,1\n1,2\n2,3\n")
    columns = "\t".join(f"ground_force_v{axis}" for axis in "xyz")
    for name in ("lift_grf.mot", "other.mot"):
        (tmp_path / name).write_text(f"GRF\nendheader\ntime\t{columns}\n0\t1\t2\t3\n")
    (tmp_path / "packed.mot").write_text("angles\nendheader\ntime\tknee\n0\t1\n")
    study, subject = new_study(tmp_path, "s").files.values()
    assert "    unit: mm  # by the body's size: some files state none" in study
    assert "which no trial names: other.mot, packed.mot" in study
    assert "markers: lift.c3d, forces: lift_grf.mot}" in subject
    assert "markers: packed.c3d.gz}" in subject and "markers: table.csv}" in subject
    assert "moment.csv" not in study + subject
    own = person(TrialSettings(23, "table.csv", forces="lift_grf.mot"))
    [planned] = planned_lifts([tmp_path], own)
    assert planned.markers == tmp_path / "table.csv"
    with pytest.raises(InputError, match=r"forces of a trial of ann is lost\.mot, and there is no file"):
        lumbar.lift(tmp_path / "lift.c3d", person(TrialSettings(23, "lift.c3d", forces="lost.mot")))
    found = lumbar.lift(tmp_path / "lift.c3d", person(TrialSettings(23, "lift.c3d", forces="lift_grf.mot")))
    assert "lift_grf.mot: time does not increase" in found.plates.findings[0]


def test_missing_shoulders_are_told_once_with_what_helps(tmp_path, run):
    lifted(tmp_path, a=without("L_SHOULDER", "R_SHOULDER"))
    measures = str(lumbar.measure_movement(lumbar.lift(tmp_path / "a.c3d", person(), 23))).splitlines()
    assert "margin_of_stability, smallest_impulse: none (no L_SHOULDER, R_SHOULDER)" in measures
    assert (
        "where the file has L_SHOULDER, R_SHOULDER, name their labels in lifting.markers.aliases" in measures
    )
    assert "new-study" not in str(lumbar.inspect(tmp_path / "a.c3d"))
