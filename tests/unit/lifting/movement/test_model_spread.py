"""Other choices beside the result: what each moves, against the result of a lift analysed with that choice."""

from dataclasses import replace

import numpy as np
import pytest
from lifting_cases import without

from lumbar.lifting.movement.centre_of_mass import trunk_centre
from lumbar.lifting.movement.lift import analyse_lift
from lumbar.lifting.movement.model_spread import model_spread, spread_lines, spread_table
from lumbar.records.markers import read_markers
from study_settings import changed, study_settings, subject_settings


@pytest.fixture(scope="module")
def study(project):
    return study_settings().lifting, subject_settings("expert")


@pytest.fixture(scope="module")
def recording(study, twin_lift):
    return read_markers(twin_lift("expert_23kg"), study[0].markers)


def analysed(study, recording, **changes):
    settings = changed(study[0], **changes)
    return analyse_lift(recording, "x", study[1], study[1].trials[0], settings), settings


@pytest.fixture(scope="module")
def spread(study, recording):
    lift, settings = analysed(study, recording)
    return model_spread(lift, study[1], settings).set_index("choice")


def test_every_choice_stands_there_and_the_result_s_own_moves_nothing(spread):
    assert list(spread.index) == [
        *("winter, inner", "de_leva_male, inner", "dumas_male, inner", "winter, skin"),
        *("hips harrington", "hips hara", "hips reed", "cut-off 4 Hz", "cut-off 6 Hz", "cut-off 8 Hz"),
    ]
    for own in ("winter, inner", "hips harrington", "cut-off 6 Hz"):
        assert np.abs(spread.loc[own].drop("note").to_numpy(float)).max() < 1e-9


@pytest.mark.parametrize(
    ("choice", "changes"),
    [
        ("winter, skin", {"segment_ends": "skin"}),
        ("dumas_male, inner", {"segments": "dumas"}),
        ("cut-off 4 Hz", {"filter": {"cutoff_Hz": 4.0}}),
    ],
)
def test_a_row_is_the_difference_of_two_results(study, recording, spread, choice, changes):
    (own, _), (other, _) = analysed(study, recording), analysed(study, recording, **changes)
    time = own.recording.time
    start, stop = (own.events[name].time_s for name in ("deposit_start", "release"))
    inside = (time >= start) & (time <= stop)
    centres = [
        trunk_centre({name: centre.position for name, centre in lift.centres.items()}, lift.table)[inside]
        for lift in (own, other)
    ]
    moved = 1e3 * (centres[1] - centres[0])
    row = spread.loc[choice]
    # The person faces y.
    assert row["forward_mm"] == pytest.approx(moved[:, 1].mean(), abs=0.3)
    assert row["up_mm"] == pytest.approx(moved[:, 2].mean(), abs=0.1)
    assert row["distance_mm"] == pytest.approx(np.linalg.norm(moved, axis=1).mean(), abs=0.1)
    angles = [np.arctan2(*(centre - own.pivot[inside])[:, [1, 2]].T) for centre in centres]
    assert row["angle_rad"] == pytest.approx((angles[1] - angles[0]).mean(), abs=3e-4)


def test_another_cut_off_leaves_out_what_is_too_short_for_it_alone(study, recording):
    """Seen for 0.2 s between two gaps before the deposit: long enough for 6 Hz, too short for 4 Hz."""
    points = recording["C7"].copy()
    points[10:60] = points[80:130] = np.nan
    lift, settings = analysed(study, replace(recording, positions={**recording.positions, "C7": points}))
    spread = model_spread(lift, study[1], settings).set_index("choice")
    assert 0 < spread.loc["cut-off 4 Hz", "distance_mm"] < 5


def test_a_choice_that_is_never_known_with_the_result_says_so_and_warns_of_nothing(study, recording, recwarn):
    """The result is known in the first half of the deposit alone, the skin's centre in the second alone."""
    positions = {name: points.copy() for name, points in recording.positions.items()}
    positions["MANUBRIUM"][650:] = np.nan
    for name in ("L_HIP", "R_HIP"):
        positions[name][500:660] = np.nan
    lift, settings = analysed(study, replace(recording, positions=positions))
    assert lift.events["deposit_start"].time_s < 6.4 and lift.events["release"].time_s > 6.8
    spread = model_spread(lift, study[1], settings)
    row = spread.set_index("choice").loc["winter, skin"]
    assert row["note"] == "it and the result are known at no common instant"
    assert row.drop("note").isna().all()
    assert "winter, skin: not possible (it and the result are known at no common instant)" in spread_lines(
        spread
    )
    assert not any("nan" in line for line in spread_lines(spread))
    assert not [warning for warning in recwarn if issubclass(warning.category, RuntimeWarning)]


def test_numbers_that_are_not_known_are_empty_with_their_reason(study, recording, recwarn):
    """Both ASIS are hidden all through the deposit: nobody can say which way is forward of the skin's centre."""
    positions = {name: points.copy() for name, points in recording.positions.items()}
    for name in ("L_ASIS", "R_ASIS"):
        positions[name][500:800] = np.nan
    lift, settings = analysed(study, replace(recording, positions=positions), segment_ends="skin")
    spread = model_spread(lift, study[1], settings)
    row = spread.set_index("choice").loc["cut-off 4 Hz"]
    assert np.isnan(row["forward_mm"]) and np.isfinite(row["up_mm"])
    assert row["note"] == "the person's right is not seen: no forward"
    assert any(line.startswith("cut-off 4 Hz: centre ? mm forward") for line in spread_lines(spread))
    assert not [warning for warning in recwarn if issubclass(warning.category, RuntimeWarning)]


def test_the_reference_is_named_once_and_only_other_choices_follow(spread):
    lines = spread_lines(spread.reset_index())
    assert lines[0] == "other choices against winter, inner; hips harrington; cut-off 6 Hz:"
    assert [line.split(": ")[0] for line in lines[1:]] == [
        *("de_leva_male, inner", "dumas_male, inner", "winter, skin", "hips hara", "hips reed"),
        *("cut-off 4 Hz", "cut-off 8 Hz"),
    ]


def test_a_choice_without_its_markers_says_why(study, recording):
    lift, settings = analysed(study, without(recording, "XIPHOID"))
    rows = model_spread(lift, study[1], settings).set_index("choice")
    assert "no centre of mass of thorax, abdomen" in rows.loc["de_leva_male, inner", "note"]
    assert any("de_leva_male, inner: not possible" in line for line in spread_lines(rows.reset_index()))


def test_the_table_of_all_lifts_says_which_ends_are_on_the_skin(spread):
    facts = {
        "lift": "x_15kg",
        "segments": {
            "points": {"C7T1": "C7T1 is the marker C7 on the skin, about 75 mm from the joint's centre"}
        },
    }
    table = spread_table([spread.reset_index()], [facts], "test")
    assert list(table.frame.columns) == ["lift", "choice", *spread.columns]
    assert table.notes[0].startswith("x_15kg: C7T1 is the marker C7 on the skin")
