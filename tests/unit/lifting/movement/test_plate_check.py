"""Force plates against bodies whose acceleration is known, spoilt in known ways, and against real recordings."""

from dataclasses import replace

import numpy as np
import pytest
from lifting_cases import ATHLETE, without

from lumbar.lifting.movement.centre_of_mass import whole_body_centre
from lumbar.lifting.movement.lift import analyse_lift
from lumbar.lifting.movement.plate_check import check_against_plates, plate_check
from lumbar.records.ground_forces import ForcePlate
from lumbar.records.markers import MarkerRecording, read_markers
from lumbar.settings.lifting import LiftingSettings
from lumbar.settings.subject import SubjectSettings, TrialSettings
from study_settings import changed

TIME = np.arange(0, 6, 0.01)
MASS = 70.0
CORNERS = np.array([[0.4, 0.4, 0], [-0.4, 0.4, 0], [-0.4, -0.4, 0], [0.4, -0.4, 0]])
STANDING = {
    "C7": (0, -0.065, 1.48),
    "T12": (0, -0.075, 1.22),
    "MANUBRIUM": (0, 0.055, 1.41),
    "XIPHOID": (0, 0.1, 1.27),
    "L5": (0, -0.1, 1.10),
    "SACRUM": (0, -0.1, 1.07),
    **{
        side + name: (sign * x, y, z)
        for side, sign in (("L_", -1), ("R_", 1))
        for name, x, y, z in (
            *(("ASIS", 0.12, 0.055, 1.05), ("PSIS", 0.045, -0.09, 1.08), ("HIP", 0.16, 0, 0.98)),
            *(("SHOULDER", 0.2, 0, 1.45), ("WRIST", 0.25, 0.05, 0.85)),
            *(("ANKLE", 0.1, -0.02, 0.08), ("TOE", 0.1, 0.15, 0.03), ("HEEL", 0.1, -0.07, 0.03)),
        )
    },
}
AMPLITUDE, OMEGA = 0.05, 2 * np.pi * 0.8


def bouncing(time=TIME):
    """A body that moves up and down as a whole, so that the acceleration of its centre is that of every marker."""
    rise = AMPLITUDE * np.sin(OMEGA * time)
    positions = {name: np.array(point) + rise[:, None] * [0, 0, 1.0] for name, point in STANDING.items()}
    return MarkerRecording("body", time, 100.0, positions, source="body.c3d")


def lift_of(recording):
    subject = SubjectSettings(name="x", sex="male", mass_kg=MASS, height_m=1.75, experience="expert")
    trial, settings = TrialSettings(box_mass_kg=0, markers="body.c3d"), LiftingSettings()
    return analyse_lift(recording, "x", subject, trial, settings), subject, trial, settings


@pytest.fixture(scope="module")
def lift():
    return lift_of(bouncing())


def plate(lift, delay=0.0, factor=1.0, shift=(0.0, 0.0, 0.0)):
    """Force of a body of MASS that bounces, from the second derivative by hand, on one plate at 1000 Hz."""
    time = np.arange(0, 6, 0.001)
    force = np.zeros((len(time), 3))
    force[:, 2] = factor * MASS * (9.81 - AMPLITUDE * OMEGA**2 * np.sin(OMEGA * (time - delay)))
    centre = whole_body_centre(lift[0].recording, lift[0].points, lift[0].table)[0] * [1, 1, 0] + shift
    return ForcePlate(
        "plate 1", time, force, np.tile(centre, (len(time), 1)), np.zeros(len(time)), 1000.0, CORNERS
    )


def check(lift, *plates):
    return check_against_plates(lift[0], plates, *lift[1:])


def test_a_body_s_own_force_agrees(lift):
    found = check(lift, plate(lift))
    assert found.correlation > 0.999
    # The filter takes 0.05 % off an oscillation at 0.8 Hz; the ends of the recording lean on its continuation.
    assert found.rmse_N < 3
    assert found.plates_kg == pytest.approx(MASS, rel=0.01)
    assert (found.forward_mm, found.right_mm, found.sway_mm) == pytest.approx((0, 0, 0), abs=0.5)
    assert not found.findings


@pytest.mark.parametrize(
    ("spoilt", "said"),
    [
        ({"factor": 2.2046}, "one of both is in pounds"),
        ({"factor": 0.1}, "a unit is wrong by ten"),
        ({"factor": 1 / 9.81}, "one of both is in kilograms and the other in newtons"),
        (
            {"factor": 1.3},
            "91.0 kg stand on the plates where 70.0 kg are declared: mass_kg or box_mass_kg is wrong",
        ),
        ({"delay": 0.5}, "the force does not follow the movement"),
        ({"shift": (0.0, 0.08, 0.0)}, "80 mm from the centre of mass on average: segment ends on the skin"),
        ({"shift": (1.0, 0.0, 0.0)}, "1000 mm from the centre of mass: the plates' corners or axes"),
    ],
)
def test_what_does_not_fit_is_said_with_what_it_means(lift, spoilt, said):
    found = check(lift, plate(lift, **spoilt))
    assert len(found.findings) == 1
    assert said in found.findings[0]
    assert found.findings[0] in str(found)


def test_where_the_centre_of_pressure_lies_is_said_as_the_person_sees_it(lift):
    found = check(lift, plate(lift, shift=(0.02, -0.03, 0.0)))
    assert (found.forward_mm, found.right_mm) == pytest.approx((-30, 20), abs=0.5)


def test_a_person_beside_the_plates_is_not_compared(lift):
    far = replace(plate(lift), corners=CORNERS + np.array([3.0, 0, 0]))
    found = check(lift, far)
    assert found.correlation is None
    assert found.findings == ("not compared: the person stands wholly on the plates for 0.00 s only",)


def test_a_body_without_arms_is_not_compared_and_without_plates_nothing_is_said(lift):
    armless = lift_of(without(bouncing(), "WRIST"))
    assert check(armless, plate(lift)).findings == ("not compared: no L_WRIST, R_WRIST",)
    assert check_against_plates(lift[0], [], *lift[1:]) is None


def test_elbows_and_knees_count_where_they_are_seen(lift):
    recording = bouncing()
    ahead = {name: recording[name.replace("KNEE", "ANKLE")] + [0, 0.3, 0.4] for name in ("L_KNEE", "R_KNEE")}
    bent = lift_of(replace(recording, positions={**recording.positions, **ahead}))
    straight, moved = (
        whole_body_centre(item[0].recording, item[0].points, item[0].table) for item in (lift, bent)
    )
    # Thigh 0.1 at 0.433 of the way to the knee, shank with foot 0.061 at 0.394 from it; on the straight leg the
    # leg's centre lies 0.447 of the way from hip to ankle. Both sides, by hand:
    hip, ankle = bent[0].points["MID_HIP"][0], recording["L_ANKLE"][0]
    knee = ahead["L_KNEE"][0]
    thigh, shank = hip + 0.433 * (knee - hip), knee + 0.606 * (ankle - knee)
    leg = 0.161 * (hip + 0.447 * (ankle - hip))
    expected = 2 * (0.100 * thigh + 0.061 * shank - leg)
    assert (moved - straight)[0, 1:] == pytest.approx(expected[1:], abs=1e-6)


QUALISYS = {
    "SACRUM": {"mean": ["L_IPS", "R_IPS"]},
    "T12": {"between": ["TV8", "SACRUM"], "share": 0.45},
    "L5": {"between": ["T12", "SACRUM"], "share": 0.65},
    **{f"{side}_WRIST": {"mean": [f"{side}_RSP", f"{side}_UHE"]} for side in "LR"},
}


def real(path, aliases, mass, rate_Hz=None, **changes):
    layout = {"aliases": aliases, "check_axes": False, "rate_Hz": rate_Hz}
    settings = changed(LiftingSettings(), markers=layout, **changes)
    subject = SubjectSettings(name="x", sex="female", mass_kg=mass, height_m=1.6, experience="unknown")
    trial = TrialSettings(box_mass_kg=0, markers=path.name)
    recording = read_markers(path, settings.markers)
    return plate_check(analyse_lift(recording, "x", subject, trial, settings), subject, trial, settings)


def test_a_person_who_stands_has_the_centre_of_pressure_below_the_centre_of_mass(shared):
    """Athlete of 58.35 kg in a static trial: the pressure lies 15 mm behind the centre, and 27 mm ahead of the skin's."""
    path = shared / "real" / "lifting" / "athlete_static_full_spine" / "c3dfile1.c3d"
    inner, skin = (real(path, ATHLETE, 58.35), real(path, ATHLETE, 58.35, segment_ends="skin"))
    assert inner.plates_kg == pytest.approx(58.35, rel=0.10)
    assert abs(inner.forward_mm) < 25
    assert inner.sway_mm < 5
    assert not inner.findings
    # On the skin of the back the centre of mass lies that much further behind.
    assert skin.forward_mm > inner.forward_mm + 30


@pytest.mark.parametrize("factor", [0.5, 1.0, 1.5, 2.0])
def test_plates_tell_the_rate_of_the_markers_of_a_person_who_walks(shared, factor):
    """Accelerations grow with the square of the rate: a file of 200 Hz that says otherwise is seen, and its true rate told."""
    path = shared / "real" / "lifting" / "qualisys_ior_gait" / "Qualisys.c3d"
    found = real(path, QUALISYS, 66.8, rate_Hz=200 * factor)
    assert found.rate_factor == pytest.approx(factor, rel=0.03)
    assert found.plates_kg == pytest.approx(66.8, rel=0.02)
    said = [finding for finding in found.findings if "set markers.rate_Hz" in finding]
    assert found.findings == tuple(said)
    assert len(said) == (factor != 1)
    assert all(190 < float(text.split("at about ")[1].split()[0]) < 210 for text in said)


def test_forces_of_a_file_of_their_own_are_compared_and_one_in_other_axes_is_named(lift, tmp_path):
    def written(name, columns):
        table = np.column_stack([np.arange(0, 6, 0.001), columns])
        heads = [f"ground_force_{kind}{axis}" for kind in "vp" for axis in "xyz"]
        heads += [f"ground_torque_{axis}" for axis in "xyz"]
        head = "GRF\nendheader\n" + "\t".join(["time", *heads])
        np.savetxt(tmp_path / name, table, fmt="%.6g", delimiter="\t", header=head, comments="")
        return tmp_path / name

    own = plate(lift)
    columns = np.hstack([own.force, own.centre_of_pressure, 0 * own.force])
    found = plate_check(*lift, written("forces.mot", columns))
    assert found.correlation > 0.999 and not found.findings
    turned = np.hstack([own.force[:, [0, 2, 1]], own.centre_of_pressure[:, [0, 2, 1]], 0 * own.force])
    found = plate_check(*lift, written("opensim.mot", turned))
    assert "the forces push along +y, but markers.up is +z" in found.findings[0]
    late = plate(lift)
    [said] = check(lift, replace(late, time=late.time + 5.9)).findings
    assert "for 0.00 s only" in said
