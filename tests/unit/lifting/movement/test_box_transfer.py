"""A real recording of a box set on a shelf: its study's rules and its run, and mishaps of a laboratory."""

import ezc3d
import numpy as np
import pytest
from lifting_cases import hide, trial_of, write_recording

import lumbar
from study_settings import changed, study_settings, subject_settings


@pytest.fixture(scope="module")
def study(project):
    return study_settings("studies/box_transfer.yaml").lifting, subject_settings("box_transfer")


def raw(path):
    """Mean of every marker in metres, read by ezc3d directly."""
    file = ezc3d.c3d(str(path))
    labels = file["parameters"]["POINT"]["LABELS"]["value"]
    return dict(zip(labels, file["data"]["points"][:3].transpose(1, 2, 0) / 1000, strict=True))


def share_along(start, end, point):
    """Share of the way from `start` to `end` at which `point` lies, in the mean over time."""
    line, offset = end - start, point - start
    return float(np.nanmean(np.sum(line * offset, axis=1) / np.sum(line**2, axis=1)))


def test_t12_agrees_with_a_static_trial_of_the_whole_spine(study, shared):
    points = raw(shared / "real" / "lifting" / "athlete_static_full_spine" / "c3dfile1.c3d")
    sacrum = (points["LPSI"] + points["RPSI"]) / 2
    t10 = points["T12"] + (points["T6"] - points["T12"]) / 3
    rule = study[0].markers.aliases["T12"]
    assert rule.between == ("T10", "SACRUM")
    assert rule.share == pytest.approx(share_along(t10, sacrum, points["T12"]), abs=0.005)


def test_pendulums_of_the_recording_list_their_assumptions(study, shared):
    settings, subject = study
    file = shared / "real" / "lifting" / "s2m_box_transfer" / "Vicon.c3d"
    lift = lumbar.lift(lumbar.read(file, layout=settings.markers), subject, settings=settings)
    assumptions = " ".join(lift.facts["assumptions"])
    for assumed in ("mass_kg = 60", "box_mass_kg = 6", "C7", "T12", "L5", "L_HIP", "R_HIP"):
        assert assumed in assumptions
    assert lift.facts["pivot"] == "hip"
    # The line of the two ASIS, seen from above, is the person's own lateral axis.
    points = raw(file)
    across = np.nanmean(points["Daphnee:ASISr"] - points["Daphnee:ASISl"], axis=0)
    standing = np.arctan2(across[0], across[1])
    assert abs(lift.facts["heading_rad"]) == pytest.approx(abs(standing), abs=0.2)
    for (com, plane), states in lift.states.groupby(["com", "plane"]):
        assert 0.1 < states["length_m"].mean() < 0.6, (com, plane)
        assert states["angle_rad"].abs().max() < 1.0
        assert states["angular_velocity_rad_s"].abs().max() < 1.5


@pytest.fixture(scope="module")
def points(shared):
    path = shared / "real" / "lifting" / "s2m_box_transfer" / "Vicon.c3d"
    return lumbar.read(path, layout=lumbar.MarkerLayout(check_axes=False)).positions


@pytest.fixture
def lift_of(tmp_path):
    settings, person = study_settings("studies/box_transfer.yaml").lifting, subject_settings("box_transfer")

    def lifted(markers, static=None, **changes):
        file, static_file = write_recording(tmp_path / "trial.c3d", markers), tmp_path / "static.c3d"
        subject = {"trials": (trial_of(6.0, markers="trial.c3d"),)}
        if static is not None:
            subject["static"] = write_recording(static_file, static).name
        return lumbar.lift(file, person.model_copy(update=subject), settings=changed(settings, **changes))

    return lifted


@pytest.mark.parametrize(("larger", "same_person"), [(1.0, True), (1.15, False)])
def test_static_trial_of_another_person_fills_no_gap(points, lift_of, larger, same_person):
    gappy = hide(points, slice(250, 350), "PSISl")
    noise = np.random.default_rng(1).normal(0, 2e-4, (60, 3))
    static = {label: larger * np.nanmean(values[:50], axis=0) + noise for label, values in points.items()}
    actual = lift_of(gappy, static)
    methods = [gap.method for gap in actual.analysed.gaps if gap.marker == "PSISl" and gap.filled]
    assert methods and all(("static trial" in method) == same_person for method in methods)
    findings = [finding for finding in actual.quality.findings if finding.kind == "static"]
    assert len(findings) == (not same_person)


def test_repeated_samples_are_not_reported_as_jitter(points, lift_of):
    """Written at twice the cameras' rate: cameras that see badly would be another cause, and a false one."""
    held = {label: np.repeat(values[::2], 2, axis=0)[: len(values)] for label, values in points.items()}
    (finding,) = lift_of(held).quality.findings
    assert (finding.kind, finding.markers) == ("held", ())
    (finding,) = lift_of({**points, "STER": held["STER"]}).quality.findings
    assert (finding.kind, finding.markers) == ("held", ("STER",))


def test_open_gap_stops_the_lift_if_selected(points, lift_of):
    with pytest.raises(lumbar.InputError, match=r"trial\.c3d: .*\n.*\bC7: .*0\.5 s .*3\.000 s"):
        lift_of(hide(points, slice(300, 350), "T10"), gaps={"longer": "error"})
