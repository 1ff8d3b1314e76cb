"""A trial with a silent corruption is stopped with one sentence, or goes on without the stretch and says so."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from quality_corruptions import changed, exchanged

import lumbar
from lumbar.base.errors import InputError
from lumbar.lifting.quality.screening import Screening
from lumbar.records.markers import read_markers
from lumbar.settings.layout import MarkerLayout
from lumbar.settings.plain import from_plain
from lumbar.twin.lifting_recordings import write_markers
from study_settings import study_settings, subject_settings

RATE = 100.0


@pytest.fixture(scope="module")
def points(twin_lift):
    """Markers of the expert's lift, as the file holds them."""
    recording = read_markers(twin_lift("expert_23kg"), MarkerLayout(check_axes=False))
    assert recording.rate == RATE
    return recording.positions


@pytest.fixture
def lift_of(tmp_path):
    """Write markers and analyse them as the expert's lift."""

    def analyse(markers, rate=RATE, **layout):
        path = tmp_path / "expert_23kg.c3d"
        write_markers(path, markers, rate, subject="expert")
        settings = study_settings().lifting
        settings = replace(settings, markers=replace(settings.markers, **layout))
        return lumbar.lift(path, subject_settings("expert"), 23, settings=settings)

    return analyse


def test_a_wrong_unit_stops_the_trial_and_the_key_named_mends_it(points, lift_of):
    tenfold = {label: 10 * positions for label, positions in points.items()}
    said = r"expert_23kg\.c3d: unit: .* 18\.\d m tall; height_m is 1\.75.*markers\.scale to 0\.1"
    with pytest.raises(InputError, match=said):
        lift_of(tenfold)
    mended, untouched = lift_of(tenfold, scale=0.1), lift_of(points)
    assert mended.quality.findings == untouched.quality.findings == ()
    np.testing.assert_allclose(mended.states["length_m"], untouched.states["length_m"], rtol=1e-5)


def test_a_wrong_rate_is_told_and_the_key_named_mends_it(points, lift_of):
    with pytest.raises(InputError, match=r"rate: .*1000 Hz may be wrong.*markers\.rate_Hz"):
        lift_of(points, rate=1000)
    mended, untouched = lift_of(points, rate=1000, rate_Hz=RATE), lift_of(points)
    np.testing.assert_allclose(mended.states["time_s"], untouched.states["time_s"], atol=1e-9)


def test_a_short_freeze_becomes_a_gap_that_is_filled_and_reported(points, lift_of, tmp_path):
    start = int(0.3 * len(points["C7"]))
    frames = slice(start, start + 16)
    found = lift_of(changed(points, "C7", frames, points["C7"][start]))
    (finding,) = found.quality.findings
    assert (finding.kind, finding.markers, finding.frames) == ("frozen", ("C7",), frames)
    assert [gap.outcome for gap in found.analysed.gaps if (gap.marker, gap.first_frame) == ("C7", start)] == [
        "filled"
    ]
    assert {gap.marker for gap in found.analysed.gaps if gap.first_frame == start} == {"C7"}
    assert "left out: frozen: C7, " in str(found)
    found.save(tmp_path / "out")
    sheet = json.loads((tmp_path / "out" / "quality.json").read_text())
    assert [(entry["kind"], entry["markers"]) for entry in sheet["findings"]] == [("frozen", ["C7"])]
    assert (sheet["n_frames"], sheet["rate_Hz"], len(sheet["markers"])) == (950, 100.0, len(points))


def test_labels_exchanged_throughout_are_proposed_and_an_alias_mends_them(points, lift_of):
    swapped = exchanged(points, "C7", "T12", slice(None))
    unmended = lift_of(swapped)
    (finding,) = unmended.quality.findings
    assert (finding.outcome, set(finding.markers)) == ("proposed", {"C7", "T12"})
    assert "change places in markers.aliases; until then both are left out of all frames" in finding.cause
    assert set(unmended.analysed.missing) == {"thorax", "abdomen"}
    aliases = study_settings().lifting.markers.aliases
    mended = lift_of(swapped, aliases=aliases | {"C7": "T12", "T12": "C7"})
    assert mended.quality.findings == ()
    assert mended.states.equals(lift_of(points).states)


def test_an_exchange_inside_rules_is_mended_through_the_reader(shared):
    """The study's own aliases with T1 and T10 in each other's place fill C7 and T12 of the file so exchanged."""
    path = shared / "real" / "lifting" / "s2m_box_transfer" / "Vicon.c3d"
    layout = study_settings("studies/box_transfer.yaml").lifting.markers
    sound = read_markers(path, layout)
    exchange = {"T1": "T10", "T10": "T1"}
    aliases = {
        name: replace(alias, between=tuple(exchange.get(part, part) for part in alias.between))
        if hasattr(alias, "between")
        else alias
        for name, alias in layout.aliases.items()
    }
    screening = Screening(1.75, aliases)

    def screen(points, time, rate):
        return screening(exchanged(points, "T1", "T10", slice(None)), time, rate)

    mended = read_markers(path, replace(layout, aliases=aliases), screen=screen)
    assert screening.findings == []
    np.testing.assert_array_equal(mended["C7"], sound["C7"])
    np.testing.assert_array_equal(mended["T12"], sound["T12"])


def test_every_kind_of_finding_is_explained(project):
    library = project / "workflow" / "lumbar"
    sources = [
        *(library / "lifting" / "quality").glob("*.py"),
        library / "lifting" / "movement" / "rigid_filling.py",
    ]
    text = "".join(path.read_text(encoding="utf-8") for path in sources)
    kinds = set(re.findall(r'clock\.finding\(\s*"([a-z ]+)"', text))
    page = (project / "docs" / "lifting" / "quality.md").read_text(encoding="utf-8")
    explained = r"^\| `([a-z ]+)` \| (?:error|left|proposed|noted)[^|]*\| [^|]+\| [^|]+\|$"
    assert kinds == set(re.findall(explained, page, re.MULTILINE))


def test_what_the_checks_leave_out_of_the_deposit_is_no_gap_to_be_filled(points, lift_of):
    """C7 and T12 change places for 0.35 s: the reason names that and its remedy; gaps of the file have another."""
    frames = slice(630, 665)
    found = lift_of(exchanged(points, "C7", "T12", frames))
    (finding,) = found.quality.findings
    assert (finding.outcome, set(finding.concerns)) == ("proposed", {"C7", "T12"})
    assert "gaps of both until somebody labels them again" in finding.cause
    reason = found.analysed.missing["thorax"]
    assert (
        "35 samples missing within the deposit, the first at 6.30 s; left out by the quality checks: "
        in reason
    )
    assert "from 6.30 to 6.65 s (exchanged): label both again in the capture software" in reason
    assert "maximum_s" not in reason

    hidden = changed(points, "MANUBRIUM", slice(700, 740), np.nan)
    gap = lift_of(hidden).analysed.missing["thorax"]
    assert "not seen in the file: MANUBRIUM: raise lifting.gaps.maximum_s" in gap
    assert "quality checks" not in gap
    both = lift_of(exchanged(hidden, "C7", "T12", frames)).analysed.missing["thorax"]
    assert "(exchanged)" in both and "not seen in the file: MANUBRIUM: raise" in both


def test_a_finding_concerns_what_follows_from_its_marker_by_a_rule(points, lift_of):
    rules = from_plain(
        MarkerLayout, {"aliases": {"L5": {"between": ["T12", "SACRUM"], "share": 0.7}}}
    ).aliases
    frozen = changed(points, "T12", slice(300, 340), points["T12"][300])
    (finding,) = lift_of(frozen, aliases=study_settings().lifting.markers.aliases | rules).quality.findings
    assert set(finding.concerns) == {"T12", "L5"}
