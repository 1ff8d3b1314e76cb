"""Mishaps of a laboratory in a real recording of a box set on a shelf: what is said of each is true of it."""

from dataclasses import replace

import numpy as np
import pytest

import lumbar
from lumbar.base.errors import InputError
from lumbar.records.markers import read_markers
from lumbar.settings.layout import MarkerLayout
from lumbar.settings.subject import TrialSettings
from lumbar.twin.lifting_recordings import write_markers
from study_settings import changed, study_settings, subject_settings

RATE = 100.0
PELVIS = ("PSISl", "PSISr", "ASISl", "ASISr")


@pytest.fixture(scope="module")
def points(shared):
    path = shared / "real" / "lifting" / "s2m_box_transfer" / "Vicon.c3d"
    return read_markers(path, MarkerLayout(check_axes=False)).positions


@pytest.fixture
def lift_of(tmp_path):
    settings, person = study_settings("studies/box_transfer.yaml").lifting, subject_settings("box_transfer")

    def lifted(markers, static=None, **changes):
        write_markers(tmp_path / "trial.c3d", markers, RATE, "ann")
        if static is not None:
            write_markers(tmp_path / "static.c3d", static, RATE, "ann")
        named = None if static is None else "static.c3d"
        person_ = replace(person, trials=(TrialSettings(6.0, "trial.c3d"),), static=named)
        return lumbar.lift(tmp_path / "trial.c3d", person_, settings=changed(settings, **changes))

    return lifted


def hidden(points, labels, frames):
    seen = {label: values.copy() for label, values in points.items()}
    for label in labels:
        seen[label][frames] = np.nan
    return seen


@pytest.mark.parametrize(("larger", "same_person"), [(1.0, True), (1.15, False)])
def test_the_shape_of_another_person_s_static_trial_fills_no_gap(points, lift_of, larger, same_person):
    gappy = hidden(points, ["PSISl"], slice(250, 350))
    noise = np.random.default_rng(1).normal(0, 2e-4, (60, 3))
    static = {label: larger * np.nanmean(values[:50], axis=0) + noise for label, values in points.items()}
    found = lift_of(gappy, static)
    methods = [gap.method for gap in found.analysed.gaps if gap.marker == "PSISl" and gap.filled]
    assert methods and all(("shape from the static trial" in method) == same_person for method in methods)
    said = [finding for finding in found.quality.findings if finding.kind == "static"]
    assert len(said) == (not same_person)
    assert all("the pelvis of the static trial and of this recording differ by 2" in str(one) for one in said)


def test_samples_that_are_held_are_no_jitter(points, lift_of):
    """Written at twice the cameras' rate: cameras that see badly would be another cause, and a false one."""
    held = {label: np.repeat(values[::2], 2, axis=0)[: len(values)] for label, values in points.items()}
    (finding,) = lift_of(held).quality.findings
    assert (finding.kind, finding.markers) == ("held", ())
    assert "recorded at 50 Hz and written at 100 Hz" in finding.cause
    (finding,) = lift_of({**points, "STER": held["STER"]}).quality.findings
    assert (finding.kind, finding.markers) == ("held", ("STER",))


@pytest.mark.parametrize(
    ("labels", "frames", "told", "not_told"),
    [
        (
            ["T10"],
            slice(300, 350),
            "C7, T12: raise lifting.gaps.maximum_s (a spline over 0.5 s is a guess)",
            "pivot",
        ),
        (["T10"], slice(250, 370), "C7, T12: fill them in the capture software", "maximum_s"),
        (
            PELVIS,
            slice(300, 350),
            "T12: raise lifting.gaps.maximum_s (a spline over 0.5 s is a guess)",
            "skin",
        ),
    ],
)
def test_advice_against_gaps_is_one_that_helps(points, lift_of, labels, frames, told, not_told):
    """Another pivot, or ends on the skin, bring back nothing where a segment lacks a marker that they need too."""
    reason = lift_of(hidden(points, labels, frames)).analysed.missing["thorax"]
    advice = reason.split("not seen in the file: ")[1]
    assert advice.endswith(told)
    assert not_told not in advice.removesuffix(told)


def test_a_gap_that_stays_ends_the_lift_where_that_is_asked_for(points, lift_of):
    with pytest.raises(InputError, match=r"C7: not seen for 0\.5 s from 3\.000 s"):
        lift_of(hidden(points, ["T10"], slice(300, 350)), gaps={"longer": "error"})
