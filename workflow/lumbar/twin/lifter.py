"""Movement of a synthetic person who lifts a box from a pallet, carries it and deposits it on a table.

Axes: x to the right, y forward, z up; metres and seconds. The body is a chain of rigid segments from the feet up, moved by
minimum-jerk transitions between postures. The transitions begin and end at the events, which are therefore known exactly.
"""

from dataclasses import dataclass

import numpy as np

from lumbar.settings.twin import SyntheticLift, SyntheticPerson, WorkplaceSettings

# Heights of joints and landmarks and lengths of segments as shares of stature: ankle, hip, shoulder, arm and widths after
# Drillis and Contini (1966); levels of the spine of a standing person.
ANKLE_HEIGHT, HIP_HEIGHT = 0.039, 0.530
PELVIS_LENGTH, LUMBAR_LENGTH, THORAX_LENGTH = 0.070, 0.080, 0.165
SHOULDER_HALF_WIDTH, HIP_HALF_WIDTH = 0.129, 0.0955
ARM_LENGTH = 0.332
FOOT_LENGTH = 0.152
STANCE_HALF_WIDTH = 0.065
PELVIS_SHARE, LUMBAR_SHARE = 0.45, 0.80
"""Inclination of pelvis and lumbar spine per inclination of the thorax."""
# Joint centres are off the chain of segments (lordosis), markers on the skin around them: metres or shares of stature, as (right,
# forward, up) on a standing person. This anatomy differs from that of the regressions which the analysis uses.
LUMBAR_BEHIND, THORACOLUMBAR_BEHIND = 0.030, 0.010
"""Distance of L4/L5 and T12/L1 behind the chain of segments, in metres."""
C7_ON_SKIN = np.array([0.0, -0.065, 0.020])
T12_ON_SKIN, L5_ON_SKIN = np.array([0.0, -0.075, 0.0]), np.array([0.0, -0.075, 0.0])
ASIS, PSIS = np.array([0.0685, 0.0315, 0.0420]), np.array([0.0260, -0.0525, 0.0585])
"""Positions of the right-hand markers from the middle of the hips, as shares of stature; the left side is mirrored."""
SEGMENTS = {
    "thorax": ("C7T1", "T12L1", 0.82),
    "abdomen": ("T12L1", "L4L5", 0.44),
    "pelvis": ("L4L5", "MID_HIP", 0.105),
}
"""True centres of mass, as shares of the distance between joint centres (Winter, 2009, Table 4.1)."""
CARRY_FLEXION = np.deg2rad(4.0)
HIPS_AHEAD, HIPS_BACK = 0.05, 0.10
"""Distance of the hips ahead of the ankles when standing, and their backward movement per unit sine of flexion, in metres."""
CARRY_REACH, CARRY_HEIGHT = 0.34, 0.565
"""Position of a carried box: distance ahead of the hips in metres, and height as a share of stature."""


@dataclass(frozen=True)
class Movement:
    """True movement of a lift, without noise."""

    time: np.ndarray
    """Time in seconds, shape (n,)."""
    markers: dict[str, np.ndarray]
    """Positions of markers in metres, shape (n, 3), by standard name, including ``BOX_1`` to ``BOX_8``."""
    hip_angle: np.ndarray
    """Inclination of the line from mid-hip to the neck, radians forward from straight up, shape (n,)."""
    joint_centres: dict[str, np.ndarray]
    """Positions of the joint centres C7T1, T12L1, L4L5 and MID_HIP in metres, shape (n, 3)."""

    @property
    def centres_of_mass(self) -> dict[str, np.ndarray]:
        """True centres of mass of thorax, abdomen and pelvis without the box, shape (n, 3) in metres."""
        joints = self.joint_centres
        return {
            name: joints[top] + share * (joints[bottom] - joints[top])
            for name, (top, bottom, share) in SEGMENTS.items()
        }


def minimum_jerk(time: np.ndarray, start: float, stop: float) -> np.ndarray:
    """Return a transition from 0 to 1 with minimum jerk (Flash and Hogan, 1985), at rest at both ends."""
    share = np.clip((time - start) / (stop - start), 0.0, 1.0)
    return share**3 * (10 - 15 * share + 6 * share**2)


def breakaway(time: np.ndarray, start: float, stop: float) -> np.ndarray:
    """Return a transition from 0 to 1 with a step of acceleration at both ends, like a box or foot that leaves its support."""
    share = np.clip((time - start) / (stop - start), 0.0, 1.0)
    return share**2 * (3 - 2 * share)


def _pulse(time: np.ndarray, start: float, top: float, stop: float) -> np.ndarray:
    return minimum_jerk(time, start, top) - minimum_jerk(time, top, stop)


def _column(*values) -> np.ndarray:
    return np.stack(np.broadcast_arrays(*values), axis=-1).astype(float)


def simulate(
    time: np.ndarray, person: SyntheticPerson, lift: SyntheticLift, workplace: WorkplaceSettings
) -> Movement:
    """Return the movement of one person in one lift; `time` in seconds, shape (n,)."""
    height, events = person.height_m, lift.events_s
    lift_off, toe_off = events.lift_off, events.toe_off
    deposit, release = events.deposit_start, events.release
    upright_again = release + 1.4
    feet = _feet(time, height, lift, workplace.walk_m)
    walked = workplace.walk_m * breakaway(time, toe_off - 0.05, deposit)
    bending_down = minimum_jerk(time, 0.5, lift_off - 0.3)
    straightening = minimum_jerk(time, lift_off, toe_off - 0.1)
    depositing = minimum_jerk(time, deposit, release) - minimum_jerk(time, release + 0.1, upright_again)
    stooping = bending_down - straightening
    flexion = (
        np.deg2rad(lift.lift_flexion_deg) * stooping
        + CARRY_FLEXION * (straightening - minimum_jerk(time, release + 0.1, upright_again))
        + np.deg2rad(lift.deposit_flexion_deg) * depositing
        # Corrections of the trunk while the box is placed: many for a novice, few for an expert.
        + np.deg2rad(lift.hesitation_deg)
        * np.sin(2 * np.pi * lift.hesitation_Hz * (time - deposit))
        * _pulse(time, deposit, (deposit + release) / 2, release + 0.3)
    )
    side = _pulse(time, lift_off, (lift_off + toe_off) / 2, toe_off) + _pulse(
        time, deposit, release - 0.25 * (release - deposit), upright_again
    )
    sway = lift.lateral_sway_m * side + 0.015 * np.sin(2 * np.pi * 0.9 * (time - toe_off)) * _pulse(
        time, toe_off, (toe_off + deposit) / 2, deposit
    )
    mid_hip = _column(
        sway,
        walked + HIPS_AHEAD - HIPS_BACK * np.sin(flexion),
        HIP_HEIGHT * height - lift.lift_squat_m * stooping - lift.deposit_squat_m * depositing,
    )
    trunk, joints = _trunk(mid_hip, flexion, np.deg2rad(lift.lateral_bending_deg) * side, height)
    box = _box(time, events, height, workplace)
    markers = {**trunk, **feet, **_wrists(time, events, trunk, box, height, workplace.box_width_m)}
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    size = np.array([workplace.box_width_m, workplace.box_depth_m, workplace.box_height_m])
    markers.update({f"BOX_{i}": box + corner * size for i, corner in enumerate(corners, start=1)})
    line = joints["C7T1"] - mid_hip
    return Movement(time, markers, np.arctan2(line[:, 1], line[:, 2]), joints)


def _feet(time: np.ndarray, height: float, lift: SyntheticLift, walk: float) -> dict[str, np.ndarray]:
    """Return ankle, heel and toe of both feet: the right foot leads by half the distance, the left foot swings through."""
    toe_off, deposit = lift.events_s.toe_off, lift.events_s.deposit_start
    step = (deposit - toe_off) / 3.2
    swing = 0.75 * step
    swings = {"R": [(toe_off, 0.5 * walk), (toe_off + 2 * step, 0.5 * walk)], "L": [(toe_off + step, walk)]}
    markers = {}
    for side, sign in (("R", 1), ("L", -1)):
        forward, raised = np.zeros_like(time), np.zeros_like(time)
        for start, length in swings[side]:
            moved = breakaway(time, start, start + swing)
            forward = forward + length * moved
            raised = raised + 0.07 * np.sin(np.pi * moved) ** 2
        if lift.foot_adjustment and side == "L":
            # A shuffle to the box before the lift.
            forward = forward - 0.12 + 0.12 * breakaway(time, 0.3, 0.65)
        ankle = _column(sign * STANCE_HALF_WIDTH * height, forward, ANKLE_HEIGHT * height + raised)
        markers[f"{side}_ANKLE"] = ankle
        for name, ahead in (("HEEL", -0.25), ("TOE", 0.72)):
            offset = [0, ahead * FOOT_LENGTH * height, -0.6 * ANKLE_HEIGHT * height]
            markers[f"{side}_{name}"] = ankle + np.array(offset)
    return markers


def _axes(flexion: np.ndarray, bending: np.ndarray) -> np.ndarray:
    """Return the axes (right, forward, up), as columns, shape (n, 3, 3), of a segment rotated about x, then about y."""
    sf, cf, sb, cb = np.sin(flexion), np.cos(flexion), np.sin(bending), np.cos(bending)
    right, forward = _column(cb, np.zeros_like(flexion), -sb), _column(-sb * sf, cf, -cb * sf)
    return np.stack([right, forward, _column(sb * cf, sf, cb * cf)], axis=-1)


def _trunk(mid_hip, flexion, bending, height) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return the markers on the skin of the trunk, and its joint centres."""
    pelvis = _axes(PELVIS_SHARE * flexion, 0.3 * bending)
    lumbar = _axes(LUMBAR_SHARE * flexion, 0.7 * bending)
    thorax = _axes(flexion, bending)
    loin = mid_hip + PELVIS_LENGTH * height * pelvis[:, :, 2]
    waist = loin + LUMBAR_LENGTH * height * lumbar[:, :, 2]
    neck = waist + THORAX_LENGTH * height * thorax[:, :, 2]
    joints = {
        "C7T1": neck,
        "T12L1": waist - THORACOLUMBAR_BEHIND * lumbar[:, :, 1],
        "L4L5": loin - LUMBAR_BEHIND * pelvis[:, :, 1],
        "MID_HIP": mid_hip,
    }
    shoulder = np.array([SHOULDER_HALF_WIDTH * height, 0.0, -0.02 * height])
    hip = np.array([HIP_HALF_WIDTH * height, 0.0, 0.0])
    mirror = np.array([-1.0, 1.0, 1.0])
    markers = {
        "C7": joints["C7T1"] + thorax @ C7_ON_SKIN,
        "T12": joints["T12L1"] + lumbar @ T12_ON_SKIN,
        "L5": joints["L4L5"] + pelvis @ L5_ON_SKIN,
        "SACRUM": loin + pelvis @ [0, -0.105, -0.03 * height],
        "MANUBRIUM": neck + thorax @ [0, 0.055, -0.031 * height],
        "XIPHOID": neck + thorax @ [0, 0.12, -0.145 * height],
        "R_SHOULDER": neck + thorax @ shoulder,
        "L_SHOULDER": neck + thorax @ (shoulder * mirror),
        "R_HIP": mid_hip + pelvis @ hip,
        "L_HIP": mid_hip + pelvis @ (hip * mirror),
        "T8": waist + thorax @ [0, -0.105, 0.36 * THORAX_LENGTH * height],
    }
    for name, place in (("ASIS", ASIS), ("PSIS", PSIS)):
        markers[f"R_{name}"] = mid_hip + pelvis @ (height * place)
        markers[f"L_{name}"] = mid_hip + pelvis @ (height * place * mirror)
    return markers, joints


def _box(time, events, height, workplace) -> np.ndarray:
    """Return the centre of the box over time: on the pallet, in the hands, carried, on the table."""
    half = workplace.box_height_m / 2
    pallet = np.array([0.0, workplace.pallet_distance_m, workplace.pallet_height_m + half])
    held = np.array([0.0, CARRY_REACH, CARRY_HEIGHT * height])
    carried = held + np.array([0, workplace.walk_m, 0])
    table = np.array([0.0, workplace.walk_m + workplace.table_distance_m, workplace.table_height_m + half])
    lifted = breakaway(time, events.lift_off, events.toe_off - 0.1)[:, None]
    walked = breakaway(time, events.toe_off - 0.05, events.deposit_start)[:, None]
    placed = breakaway(time, events.deposit_start, events.release)[:, None]
    return pallet + lifted * (held - pallet) + walked * (carried - held) + placed * (table - carried)


def _wrists(time, events, trunk, box, height, width) -> dict[str, np.ndarray]:
    """Return the wrists over time: hanging, at the handles from just before lift-off until the release, hanging again."""
    reaching = minimum_jerk(time, 1.0, events.lift_off - 0.15)
    leaving = minimum_jerk(time, events.release, events.release + 0.9)
    holding = (reaching - leaving)[:, None]
    markers = {}
    for side, sign in (("R", 1), ("L", -1)):
        hanging = trunk[f"{side}_SHOULDER"] + np.array([0.03 * sign, 0.05, -0.97 * ARM_LENGTH * height])
        handle = box + np.array([sign * width / 2, -0.06, 0.04])
        markers[f"{side}_WRIST"] = hanging + holding * (handle - hanging)
    return markers
