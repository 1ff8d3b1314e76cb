"""A folder of real recordings becomes a study: nothing runs before it is filled in, and the lifting chapter runs after."""

import json
import re
import shutil

import pytest

import lumbar
from running import copy_project, snakemake

FILLED = {
    "sex": "unknown",
    "mass_kg": "60",
    "height_m": "1.65",
    "experience": "unknown",
    "box_mass_kg": "6",
}


def fill_in(path) -> None:
    text = path.read_text(encoding="utf-8")
    for key, value in FILLED.items():
        text = re.sub(rf"(\b{key}: )FILL_IN", rf"\g<1>{value}", text)
    path.write_text(text, encoding="utf-8")


@pytest.fixture(scope="module")
def laboratory(shared, tmp_path_factory):
    """A folder with a lift and a file that is none; and a project."""
    folder = tmp_path_factory.mktemp("laboratory") / "my lab"
    folder.mkdir()
    shutil.copy(shared / "real" / "lifting" / "s2m_box_transfer" / "Vicon.c3d", folder / "shelf 1.c3d")
    (folder / "broken.trc").write_text("no markers", encoding="utf-8")
    project = copy_project(tmp_path_factory.mktemp("project"))
    found = lumbar.new_study(folder)
    return project, found, found.save(project)


def test_new_study_contains_recognised_markers(laboratory):
    _, found, (study, subject) = laboratory
    assert (study.name, subject.name) == ("my_lab.yaml", "my_lab.yaml")
    text = study.read_text(encoding="utf-8")
    assert "#   broken.trc: " in text
    assert "BOX_8: arriere_gauche" in text
    assert "pivot: hip" in text
    assert any(
        line.startswith("# labels without a landmark: ") and "LASTC" in line
        for line in map(str.strip, text.splitlines())
    )
    assert sum(path.read_text(encoding="utf-8").count(": FILL_IN") for path in (study, subject)) == 5
    with pytest.raises(lumbar.InputError, match=r"my_lab\.yaml: "):
        found.save(laboratory[0])


@pytest.mark.nightly
def test_new_study_runs_only_after_it_is_filled_in(laboratory):
    project, _, paths = laboratory
    planned = ("--cores", "1", "lifting", "--configfile", "config/studies/my_lab.yaml")
    unfilled = snakemake(project, "--dry-run", *planned)
    assert unfilled.status != 0
    assert "configuration: 5 problems" in unfilled.text
    for key in FILLED:
        assert f"{key}: FILL_IN" in unfilled.text, key
    for path in paths:
        fill_in(path)
    assert snakemake(project, "--dry-run", *planned).jobs["lift"] == 1
    snakemake(project, *planned).whole()
    facts = project / "results" / "my_lab" / "lifting" / "my_lab_6kg" / "pendulum.json"
    assert json.loads(facts.read_text(encoding="utf-8"))["missing"] == {}
    # The same recording under the same rules, with the study that was written by hand.
    events = json.loads((facts.parent / "events.json").read_text(encoding="utf-8"))["events"]
    assert events["lift_off"]["time_s"] == pytest.approx(2.02, abs=0.05)
    assert events["release"]["time_s"] == pytest.approx(3.73, abs=0.08)


REAL = (
    ("athlete_floor_pickup_squats/squat.c3d", "+y", "+z"),
    ("athlete_static_full_spine/c3dfile1.c3d", "+z", "-x"),
    ("ktk_pig_com_oracle/gait.c3d", "+z", "+y"),
    ("ktk_pig_com_oracle/static.c3d", "+z", "-y"),
    ("qualisys_ior_gait/Qualisys.c3d", "+z", "+x"),
    ("s2m_box_transfer/Vicon.c3d", "+z", "-x"),
    ("weird_squat_trc/markers_Squat2.trc", "+y", "-x"),
    ("sts_trunk_flexion_trc/sts_perturbed_1.trc", "+y", "+x"),
)


@pytest.mark.parametrize(("name", "up", "forward"), REAL)
def test_marker_sets_and_axes_of_real_recordings_are_recognised(shared, tmp_path, name, up, forward):
    """Axes as their READMEs and the studies of the project state them, or the walking direction."""
    shutil.copy(shared / "real" / "lifting" / name, tmp_path)
    found = lumbar.new_study(tmp_path).recordings[0].set
    assert (found.axes.up, found.axes.forward) == (up, forward)
    if "sts" not in name:
        assert {"C7", "T12", "L5", "SACRUM", "R_WRIST"} <= set(found.aliases)
    # Traps: markers on the thigh that are called hips.
    assert "LHIP" not in found.aliases.values()


@pytest.mark.parametrize("name", [REAL[index][0] for index in (0, 4, 5, 7)])
def test_new_study_analyses_its_real_recording(shared, tmp_path, name):
    """Lifts give pendulums, other movements the reasons why there are none; what no spine is seen in is refused by name."""
    folder = tmp_path / "one"
    folder.mkdir()
    shutil.copy(shared / "real" / "lifting" / name, folder)
    study, _ = lumbar.new_study(folder).save(tmp_path)
    fill_in(study)
    settings = lumbar.load_settings(study).lifting
    ann = lumbar.SubjectSettings(name="ann", sex="female", mass_kg=61.0, height_m=1.68, experience="novice")
    file = next(folder.iterdir())
    if "sts" in name:
        with pytest.raises(lumbar.InputError, match=r"\bevent\b.*\bcentre of mass\b"):
            lumbar.lift(file, ann, 6.0, settings=settings)
        return
    lift = lumbar.lift(file, ann, 6.0, settings=settings)
    lift.save(tmp_path / "out")
    assert set(lift.analysed.centres) == {"thorax", "abdomen", "pelvis"}
    assert bool(lift.analysed.states) == ("Vicon" in name)
    if "squat.c3d" in name:
        # The ASIS are hidden while the person bends to the floor; the events are there all the same.
        assert lift.analysed.events["deposit_start"].time_s == pytest.approx(18.55, abs=0.2)
        assert "deposit" in lift.analysed.missing["thorax"]
