"""``lumbar inspect``, and what silent corruption does to a trial: stopped with one sentence, or gone on without the stretch."""

import json

import numpy as np
import pandas as pd
import pytest
from lifting_cases import example_lift, write_recording
from quality_corruptions import changed, exchanged

import lumbar
from column_files import write_columns
from refusing import has_tokens
from study_settings import study_settings, subject_settings

RATE = 100.0


@pytest.fixture(scope="module")
def lift_file(twin_lift):
    return twin_lift("expert_23kg")


@pytest.fixture(scope="module")
def points(lift_file):
    """Markers of the expert's lift, as the file holds them."""
    recording = lumbar.read(lift_file, layout=lumbar.MarkerLayout(check_axes=False))
    assert recording.rate == RATE
    return recording.positions


def test_gaps_are_those_of_the_file(lift_file, points):
    actual = lumbar.inspect(lift_file)
    missing = {label: np.isnan(positions[:, 0]).mean() for label, positions in points.items()}
    assert {gap.marker: gap.missing_share for gap in actual.sheet.gaps} == {
        label: share for label, share in missing.items() if share
    }
    assert actual.sheet.missing_share == pytest.approx(np.mean(list(missing.values())))


def test_error_of_the_pipeline_does_not_stop_inspection(points, tmp_path):
    write_recording(
        tmp_path / "tenfold.c3d", {label: 0.1 * p for label, p in points.items()}, subject="expert"
    )
    actual = lumbar.inspect(tmp_path / "tenfold.c3d", height_m=1.75)
    assert [finding.kind for finding in actual.sheet.findings] == ["unit"]
    is_analysed, reason = actual.pipeline
    assert not is_analysed and has_tokens(reason, "markers.scale…10")


def test_command_prints_draws_and_reports_unreadable_files(points, tmp_path, run):
    frozen = tmp_path / "frozen.c3d"
    write_recording(frozen, changed(points, "C7", slice(300, 400), points["C7"][300]), subject="expert")
    status, out, err = run("inspect", frozen, "--height", "1.75", "--picture", tmp_path / "frozen.svg")
    assert (status, err) == (0, "")
    assert has_tokens(out, "frozen: C7…3.00 to 4.00 s")
    assert "<svg" in (tmp_path / "frozen.svg").read_text(encoding="utf-8")
    assert not (tmp_path / "frozen.pdf").exists()
    (tmp_path / "broken.c3d").write_bytes(b"nothing")
    status, out, err = run("inspect", frozen, tmp_path / "broken.c3d", "--json")
    assert status == 1
    assert "broken.c3d" in err
    (entry,) = json.loads(out)
    assert [finding["kind"] for finding in entry["findings"]] == ["frozen"]


def test_record_of_force_and_position_is_rejected(tmp_path):
    n = np.arange(300)
    write_columns(tmp_path / "record.csv", time_s=n / 100, position_mm=np.sin(n / 9), force_N=np.cos(n / 7))
    with pytest.raises(lumbar.InputError, match=r"record\.csv: .*lumbar diagnose "):
        lumbar.inspect(tmp_path / "record.csv")


def test_unchecked_properties_are_listed(lift_file, points, tmp_path):
    renamed = {f"Q{index}": positions for index, positions in enumerate(points.values())}
    write_recording(tmp_path / "renamed.c3d", renamed, subject="expert")
    renamed = lumbar.inspect(tmp_path / "renamed.c3d", height_m=1.75)
    text, sheet = str(renamed), renamed.sheet
    assert not sheet.findings and {"stature", "unit", "left and right"} <= sheet.unchecked.keys()
    assert all(f"{name} (" in text for name in sheet.unchecked)
    assert list(lumbar.inspect(lift_file, height_m=1.75).sheet.unchecked) == []
    assert list(lumbar.inspect(lift_file).sheet.unchecked) == ["stature"]


def test_other_picture_format_is_rejected_before_reading(tmp_path, run):
    err = run.refused("inspect", tmp_path / "absent.c3d", "--picture", tmp_path / "x.png")
    assert has_tokens(err, ".svg….pdf")
    assert "absent.c3d" not in err


def test_motionless_marker_does_not_affect_axes(shared, tmp_path):
    """C7 left behind at the first frame: it is left out, and up and forward follow from the others."""
    path = shared / "real" / "lifting" / "ktk_pig_com_oracle" / "gait.c3d"
    points = lumbar.read(path, layout=lumbar.MarkerLayout(check_axes=False)).positions
    points["C7"] = np.tile(points["C7"][0], (len(points["C7"]), 1))
    write_recording(tmp_path / "walk.c3d", points, subject="ann")
    actual = lumbar.inspect(tmp_path / "walk.c3d")
    assert actual.axes.startswith("up +z, forward +y (")
    assert [(finding.kind, finding.markers) for finding in actual.sheet.findings] == [("frozen", ("C7",))]


@pytest.fixture
def lift_of(tmp_path):
    """Write markers and analyse them as the expert's lift."""

    def analyse(markers, **layout):
        path = tmp_path / "expert_23kg.c3d"
        write_recording(path, markers, subject="expert")
        settings = study_settings().lifting
        settings = settings.model_copy(update={"markers": settings.markers.model_copy(update=layout)})
        return lumbar.lift(path, subject_settings("expert"), 23, settings=settings)

    return analyse


def test_wrong_unit_stops_the_trial_and_the_named_key_corrects_it(points, lift_of):
    tenfold = {label: 10 * positions for label, positions in points.items()}
    problem = r"expert_23kg\.c3d: unit: .* 18\.\d m.* 1\.75.*markers\.scale to 0\.1"
    with pytest.raises(lumbar.InputError, match=problem):
        lift_of(tenfold)
    corrected, untouched = lift_of(tenfold, scale=0.1), lift_of(points)
    assert corrected.quality.findings == untouched.quality.findings == ()
    np.testing.assert_allclose(corrected.states["length_m"], untouched.states["length_m"], rtol=1e-5)


def test_a_short_freeze_becomes_a_gap_that_is_filled_and_reported(points, lift_of, tmp_path):
    start = int(0.3 * len(points["C7"]))
    frames = slice(start, start + 16)
    actual = lift_of(changed(points, "C7", frames, points["C7"][start]))
    (finding,) = actual.quality.findings
    assert (finding.kind, finding.markers, finding.frames) == ("frozen", ("C7",), frames)
    assert [
        gap.outcome for gap in actual.analysed.gaps if (gap.marker, gap.first_frame) == ("C7", start)
    ] == ["filled"]
    assert {gap.marker for gap in actual.analysed.gaps if gap.first_frame == start} == {"C7"}
    assert "frozen: C7, " in str(actual)
    actual.save(tmp_path / "out")
    sheet = json.loads((tmp_path / "out" / "quality.json").read_text())
    assert [(entry["kind"], entry["markers"]) for entry in sheet["findings"]] == [("frozen", ["C7"])]
    assert (sheet["n_frames"], sheet["rate_Hz"], len(sheet["markers"])) == (950, 100.0, len(points))


def test_exchanged_labels_are_proposed_and_an_alias_corrects_them(points, lift_of):
    swapped = exchanged(points, "L_SHOULDER", "R_SHOULDER", slice(None))
    uncorrected = lift_of(swapped)
    (finding,) = uncorrected.quality.findings
    assert (finding.outcome, set(finding.markers)) == ("proposed", {"L_SHOULDER", "R_SHOULDER"})
    proposed = uncorrected.analysed.recording["L_SHOULDER"]
    np.testing.assert_allclose(
        np.nanmedian(proposed, axis=0), np.nanmedian(points["R_SHOULDER"], axis=0), atol=0.01
    )
    aliases = study_settings().lifting.markers.aliases
    corrected = lift_of(swapped, aliases=aliases | {"L_SHOULDER": "R_SHOULDER", "R_SHOULDER": "L_SHOULDER"})
    assert corrected.quality.findings == ()
    assert corrected.states.equals(lift_of(points).states)


def test_frames_left_out_of_the_deposit_are_not_reported_as_gaps(points, lift_of):
    """C7 and T12 change places for 0.35 s: the reason names that and its remedy; gaps of the file have another."""
    frames = slice(630, 665)
    actual = lift_of(exchanged(points, "C7", "T12", frames))
    (finding,) = actual.quality.findings
    assert (finding.outcome, set(finding.concerns)) == ("left out", {"C7", "T12"})
    reason = actual.analysed.missing["thorax"]
    assert has_tokens(reason, "6.30 to 6.65 s (exchanged")
    assert "maximum_s" not in reason

    hidden = changed(points, "MANUBRIUM", slice(700, 740), np.nan)
    gap = lift_of(hidden).analysed.missing["thorax"]
    assert has_tokens(gap, "MANUBRIUM: …lifting.gaps.maximum_s")
    assert "exchanged" not in gap
    both = lift_of(exchanged(hidden, "C7", "T12", frames)).analysed.missing["thorax"]
    assert "(exchanged)" in both and has_tokens(both, "MANUBRIUM: …lifting.gaps.maximum_s")


def test_finding_concerns_markers_derived_by_a_rule(points, lift_of):
    rules = lumbar.MarkerLayout.model_validate(
        {"aliases": {"L5": {"between": ["T12", "SACRUM"], "share": 0.7}}}
    ).aliases
    frozen = changed(points, "T12", slice(300, 340), points["T12"][300])
    (finding,) = lift_of(frozen, aliases=study_settings().lifting.markers.aliases | rules).quality.findings
    assert set(finding.concerns) == {"T12", "L5"}


RENAMED = (
    (
        "C7 L_Shoulder R_Shoulder L_calc R_calc L_toe R_toe",
        "C7 L_SHOULDER R_SHOULDER L_HEEL R_HEEL L_TOE R_TOE",
        7,
    ),
    ("1~-~L_Hip 2~-~R_Hip 3~-~C7 4~-~L_Wrist", "L_HIP R_HIP C7 L_WRIST", 4),
    ("spot1 spot2 spot3 spot4", "C7 T12 L_HIP R_HIP", 0),
)


@pytest.mark.parametrize(("labels", "names", "count"), RENAMED)
def test_last_line_counts_landmarks_and_names_the_next_step(points, tmp_path, labels, names, count):
    chosen = {
        label.replace("~", " "): points[name]
        for label, name in zip(labels.split(), names.split(), strict=True)
    }
    write_recording(tmp_path / "own.c3d", chosen, subject="ann")
    report = lumbar.inspect(tmp_path / "own.c3d")
    assert set(report.recognised) == set(names.split() * bool(count))
    assert has_tokens(report.lines()[-1], f"{count} of 27…`lumbar new-study FOLDER`")


def test_findings_of_one_kind_are_one_line_unless_details_are_asked_for(points, tmp_path):
    spoilt = points
    for label, start in (("C7", 200), ("T12", 300), ("L_SHOULDER", 400)):
        spoilt = changed(spoilt, label, slice(start, start + 60), points[label][start])
    write_recording(tmp_path / "frozen.c3d", spoilt, subject="expert")
    report = lumbar.inspect(tmp_path / "frozen.c3d")
    (counted,) = [line for line in report.lines() if line.startswith("left out: frozen")]
    assert has_tokens(counted, "frozen × 3: C7, T12, L_SHOULDER…2.00 to 4.60 s")
    assert sum(line.startswith("left out: frozen: ") for line in report.lines(details=True)) == 3


def test_lift_without_settings_knows_labels_and_axes_of_other_laboratories(tmp_path):
    subject = example_lift(tmp_path / "lift.c3d")
    known = lumbar.lift(tmp_path / "lift.c3d", subject)
    points = lumbar.read(tmp_path / "lift.c3d").positions
    others = {
        "MANUBRIUM": "SJN",
        "XIPHOID": "SXS",
        "SACRUM": "SACR",
        "C7": "CV7",
        "T8": "TV8",
        "T12": "TV12",
        "L5": "LV5",
    }
    of_sides = {
        "ANKLE": "FAL",
        "ASIS": "IAS",
        "HEEL": "FCC",
        "HIP": "FTC",
        "PSIS": "IPS",
        "SHOULDER": "SAJ",
        "TOE": "FM2",
    }
    others |= {f"{side}_{name}": f"{side}_{label}" for name, label in of_sides.items() for side in "LR"}
    to_y_up = [0, 2, 1]
    turned = {others.get(name, name): places[:, to_y_up] * [1, 1, -1] for name, places in points.items()}
    write_recording(tmp_path / "turned.c3d", turned)
    recognised = lumbar.lift(tmp_path / "turned.c3d", subject, 15, trial=subject.trials[0])
    pd.testing.assert_frame_equal(recognised.states, known.states, rtol=1e-3, atol=1e-5)


def test_lift_without_settings_refuses_unknown_axes(tmp_path):
    subject = example_lift(tmp_path / "lift.c3d")
    points = lumbar.read(tmp_path / "lift.c3d").positions
    write_recording(
        tmp_path / "numbered.c3d", {f"M{number}": places for number, places in enumerate(points.values())}
    )
    with pytest.raises(lumbar.InputError, match=r"numbered\.c3d: .*markers\.forward.*--config"):
        lumbar.lift(tmp_path / "numbered.c3d", subject, 15, trial=subject.trials[0])
