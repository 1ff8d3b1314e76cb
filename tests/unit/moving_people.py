"""Marker recordings of people who move, ten kinds of valid trials: rigid segments, smooth joint angles, feet that do not slip.

x right, y forward, z up, in metres. The skin moves over the bones with the joint angles; noise is 0.2 to 1 mm per coordinate.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

Points = dict[str, np.ndarray]
STATURE_M = 1.75
"""Stature of the person in `SITES` and `JOINTS`; others are scaled."""
JOINTS = {
    "pelvis": (None, (0, 0, 0.95)),
    "abdomen": ("pelvis", (0, -0.04, 1.05)),
    "thorax": ("abdomen", (0, -0.05, 1.20)),
    "head": ("thorax", (0, -0.02, 1.50)),
    "arm": ("thorax", (0.18, -0.01, 1.41)),
    "forearm": ("arm", (0.21, -0.01, 1.12)),
    "thigh": ("pelvis", (0.09, 0, 0.92)),
    "shank": ("thigh", (0.10, 0, 0.50)),
    "foot": ("shank", (0.10, -0.02, 0.08)),
}
"""Segments with the segment that carries them, and the joint between them; right side."""
SITES = {
    "head": {"front": (0.07, 0.09, 1.66), "back": (0.07, -0.09, 1.66)},
    "thorax": {
        "C7": (0, -0.08, 1.49), "T8": (0, -0.12, 1.28), "T12": (0, -0.11, 1.16), "jugular": (0, 0.06, 1.42),
        "xiphoid": (0, 0.10, 1.26), "blade": (0.09, -0.12, 1.33), "shoulder": (0.19, -0.01, 1.45),
    },
    "abdomen": {"L5": (0, -0.10, 1.06)},
    "pelvis": {"ASIS": (0.12, 0.10, 1.0), "PSIS": (0.045, -0.09, 1.02), "sacrum": (0, -0.10, 0.99)},
    "arm": {"upper": (0.24, 0, 1.25), "elbow": (0.25, -0.01, 1.12)},
    "forearm": {
        "lower": (0.25, 0.02, 1.0), "radius": (0.21, 0.04, 0.87), "ulna": (0.25, -0.02, 0.87), "hand": (0.23, 0.03, 0.79),
    },
    "thigh": {"trochanter": (0.16, 0, 0.92), "side": (0.16, 0, 0.7), "knee": (0.155, 0, 0.5), "inner": (0.05, 0, 0.5)},
    "shank": {"calf": (0.15, 0, 0.3), "ankle": (0.135, -0.02, 0.08), "medial": (0.065, -0.01, 0.085)},
    "foot": {"heel": (0.10, -0.08, 0.05), "toe": (0.11, 0.14, 0.04), "fifth": (0.15, 0.10, 0.03)},
}  # fmt: skip
"""Places of the markers by segment, standing; right side."""
LABELS = {
    "gait": "front=FHD back=BHD C7=C7 T8=T10 jugular=CLAV xiphoid=STRN blade=BAK shoulder=SHO upper=UPA elbow=ELB lower=FRM "
    "radius=WRA ulna=WRB hand=FIN ASIS=ASI PSIS=PSI side=THI knee=KNE calf=TIB ankle=ANK heel=HEE toe=TOE",
    "ior": "C7=CV7 T8=TV8 jugular=SJN xiphoid=SXS shoulder=_SAJ elbow=_HLE radius=_RSP ulna=_USP ASIS=_IAS PSIS=_IPS "
    "trochanter=_FTC knee=_FLE inner=_FME ankle=_FAL medial=_TAM heel=_FCC toe=_FM1 fifth=_FM5",
    "spine": "C7=C7 T12=T12 L5=L5 jugular=MANUBRIUM xiphoid=XIPHOID sacrum=SACRUM shoulder=_SHOULDER elbow=_ELBOW radius=_WRIST "
    "ASIS=_ASIS trochanter=_HIP knee=_KNEE ankle=_ANKLE heel=_HEEL toe=_TOE",
    "lower": "ASIS=.ASIS PSIS=.PSIS sacrum=SACR side=.Thigh knee=.Knee ankle=.Ankle heel=.Heel toe=.Toe fifth=.MT5",
}  # fmt: skip
"""Labels of four marker sets; a side stands before all labels of both sides."""
MOTIONS = {
    "model points": "walk", "arms raised": "arms", "long walk": "walk", "turn": "turn", "quiet": "quiet", "hidden halves": "walk",
    "lift": "lift", "stairs or chair": "stairs", "other axes": "walk", "soft tissue": "lift",
}  # fmt: skip
AXES = (("+z", "+y"), ("+z", "-x"), ("+y", "+x"), ("+y", "-z"), ("+x", "+y"), ("+x", "-z"), ("-z", "+x"))


@dataclass(frozen=True)
class Trial:
    """A valid recording, in the axes of its file."""

    kind: str
    points: Points
    rate: float
    up: str
    forward: str
    """Axis that the person faces at first."""
    height_m: float


def bumps(time: np.ndarray, times: np.ndarray, seconds: float) -> np.ndarray:
    """Return a sum of bells of height 1 that rise and fall within some seconds around each time."""
    share = np.clip(np.abs(time[:, None] - times) / seconds, 0, 1)
    return (1 - share**3 * (10 - 15 * share + 6 * share**2)).max(axis=1, initial=0)


def ramp(time: np.ndarray, start: float, seconds: float) -> np.ndarray:
    """Return a smooth step from 0 to 1."""
    share = np.clip((time - start) / seconds, 0, 1)
    return share**3 * (10 - 15 * share + 6 * share**2)


def angles_of(motion: str, time: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return flexions by segment (L_ or R_ before those of a side), heading and twist in radians, and a climb in metres."""
    sway = {
        name: 0.01 * np.sin(2 * np.pi * rng.uniform(0.1, 0.6) * time + rng.uniform(0, 6)) for name in JOINTS
    }
    angles = {
        name: sway.get(name.removeprefix("L_").removeprefix("R_"), 0 * time)
        for name in (*sway, "heading", "twist")
    }
    angles |= {
        f"{side}_{name}": angles[name] + rng.normal(0, 0.02) for name in ("arm", "forearm") for side in "LR"
    }
    angles |= {
        f"{side}_{name}": 0.002 * angles["pelvis"] for name in ("thigh", "shank", "foot") for side in "LR"
    }
    angles["climb"] = 0 * time
    seconds, pace = time[-1], rng.uniform(0.8, 1.1)
    if motion in ("walk", "turn", "stairs"):
        phase = 2 * np.pi * pace * time + 0.3 * np.sin(2 * np.pi * 0.11 * time) + rng.uniform(0, 6)
        reach, lift = rng.uniform(0.3, 0.42), (1.0 if motion == "stairs" else rng.uniform(0.8, 1.05))
        for side, own in (("L", phase), ("R", phase + np.pi)):
            swing = np.exp(4 * (np.cos(own + 0.9) - 1))
            angles[f"{side}_thigh"] = 0.1 + reach * np.sin(own) + (0.4 * swing if motion == "stairs" else 0)
            angles[f"{side}_shank"] = -0.12 - lift * swing
            angles[f"{side}_foot"] = -0.6 * (angles[f"{side}_thigh"] + angles[f"{side}_shank"])
            angles[f"{side}_arm"] = -0.35 * np.sin(own)
            angles[f"{side}_forearm"] = 0.4 - 0.1 * np.sin(own)
        angles["twist"] = angles["twist"] + 0.08 * np.sin(phase)
        if motion == "stairs":
            angles["climb"] = 0.3 * pace * time
    if motion == "turn":
        start, length = 0.3 * seconds, 0.3 * seconds
        angles["heading"] = (
            rng.choice([-1, 1]) * np.radians(rng.uniform(180, 360)) * ramp(time, start, length)
        )
    elif motion == "walk":
        angles["heading"] = 0.1 * np.sin(2 * np.pi * 0.07 * time)
    elif motion == "arms":
        raised = bumps(time, np.arange(1.5, seconds, rng.uniform(2.5, 4)), 1.2)
        for side in "LR":
            angles[f"{side}_arm"] = angles["arm"] + rng.uniform(1.4, 2.9) * raised
    elif motion in ("lift", "chair"):
        bent = bumps(time, np.arange(2, seconds, rng.uniform(3, 4.5)), 1.6)
        depth, squat = rng.uniform(0.2, 0.9), rng.uniform(0.5, 1.3)
        angles["pelvis"] = angles["pelvis"] + depth * bent
        angles["abdomen"] = angles["abdomen"] + 0.4 * bent
        angles["thorax"] = angles["thorax"] + 0.25 * bent
        for side in "LR":
            angles[f"{side}_thigh"] = angles[f"{side}_thigh"] + (squat + depth) * bent
            angles[f"{side}_shank"] = angles[f"{side}_shank"] - 1.6 * squat * bent
            angles[f"{side}_foot"] = angles[f"{side}_foot"] + 0.6 * squat * bent
            angles[f"{side}_arm"] = (
                angles[f"{side}_arm"] + (0.6 + depth) * bent + 0.2 * ramp(time, 0, seconds)
            )
        angles["twist"] = angles["twist"] + rng.uniform(0, 0.4) * ramp(time, 0.5 * seconds, 1.5)
    return angles


def move(angles: dict[str, np.ndarray], rate: float, stature: float) -> Points:
    """Return the markers of all sites (L_ or R_ before those of a side); a foot on the floor stays where it is."""
    size, time = stature / STATURE_M, angles["heading"]
    placed: dict[str, tuple[Rotation, np.ndarray, np.ndarray]] = {}
    points: Points = {}
    for segment, (carrier, joint) in JOINTS.items():
        for side, sign in (("L_", -1), ("R_", 1)) if joint[0] else (("", 1),):
            name, at = side + segment, size * np.array(joint) * [sign, 1, 1]
            if carrier is None:
                origin, flexion, turn = np.zeros((len(time), 3)), angles[name], angles["heading"]
            else:
                carried = side + carrier if side + carrier in placed else carrier
                turning, base, rest = placed[carried]
                origin = base + turning.apply(at - rest)
                # Legs flex forwards at the hip and the trunk bends forwards: opposite turns about the lateral axis.
                flexion = angles[f"{carried}_sum"] + angles[name] * (
                    1 if segment in ("abdomen", "thorax", "head") else -1
                )
                turn = angles[f"{carried}_turn"] + (angles["twist"] if segment == "abdomen" else 0)
            angles |= {f"{name}_sum": flexion, f"{name}_turn": turn}
            placed[name] = Rotation.from_euler("ZX", np.column_stack([turn, -flexion])), origin, at
    for segment, sites in SITES.items():
        for site, place in sites.items():
            for side, sign in (("L_", -1), ("R_", 1)) if place[0] else (("", 1),):
                turning, origin, rest = placed[side + segment if side + segment in placed else segment]
                points[side + site] = origin + turning.apply(size * np.array(place) * [sign, 1, 1] - rest)
    # The lower foot is the stance foot: it does not move on the floor.
    soles = np.stack([points[side + site] for side in ("L_", "R_") for site in ("heel", "toe")])
    share = np.exp(-(soles[..., 2] - soles[..., 2].min(axis=0)) / 0.01)
    share = gaussian_filter1d(share / share.sum(axis=0), 0.03 * rate, axis=1)[..., None]
    shift = -np.cumsum((share[:, 1:] * np.diff(soles, axis=1)).sum(axis=0), axis=0)
    shift = np.vstack([np.zeros(3), shift])
    shift[:, 2] = gaussian_filter1d(-soles[..., 2].min(axis=0), 0.04 * rate) + angles["climb"]
    return {name: places + shift for name, places in points.items()}


def soften(points: Points, amount: float, rng: np.random.Generator) -> Points:
    """Move the skin of each marker with the height and the pose of the body, by at most about `amount` metres."""
    pose = np.stack(
        [
            points[name][:, 2] - points["sacrum"][:, 2]
            for name in ("L_knee", "R_knee", "L_hand", "R_hand", "C7")
        ]
    )
    spread = np.ptp(pose, axis=1, keepdims=True)
    pose = (pose - pose.mean(axis=1, keepdims=True)) / np.maximum(spread, 0.05)
    return {
        name: places + amount * np.tanh(pose.T @ rng.normal(0, 0.7, (5, 3)))
        for name, places in points.items()
    }


def labelled(points: Points, marker_set: str) -> Points:
    """Return the markers of a set under its labels."""
    named = {}
    for pair in LABELS[marker_set].split():
        site, _, label = pair.partition("=")
        sides = ("L", "R") if f"L_{site}" in points else ("",)
        named |= {
            (side.lower() if label[0] == "." else side) + label: points[f"{side}_{site}" if side else site]
            for side in sides
        }
    return named


def hide(points: Points, shares: np.ndarray, rng: np.random.Generator, halves: bool) -> Points:
    """Hide each marker in gaps of up to 40 frames; with `halves`, half of the markers in one half of the frames as well."""
    count, result = len(next(iter(points.values()))), {}
    for (label, places), share in zip(points.items(), shares, strict=True):
        visible = places.copy()
        for start in rng.integers(0, count, round(share * count / 20)):
            visible[start : start + rng.integers(1, 40)] = np.nan
        if halves and rng.random() < 0.5:
            visible[: count // 2] = np.nan
        result[label] = visible
    return result


def rotate(points: Points, up: str, forward: str) -> Points:
    """Express points with x right, y forward, z up in other axes."""
    upward, ahead = (
        (1 if axis[0] == "+" else -1) * np.eye(3)["xyz".index(axis[1])] for axis in (up, forward)
    )
    axes = np.array([np.cross(ahead, upward), ahead, upward])
    return {label: places @ axes for label, places in points.items()}


def valid_trial(kind: str, seed: int) -> Trial:
    """Return a valid trial of a kind (key of `MOTIONS`)."""
    rng = np.random.default_rng([list(MOTIONS).index(kind), seed])
    rate = float(rng.choice([100, 120, 200]))
    seconds = {"long walk": rng.uniform(60, 180), "quiet": rng.uniform(2, 15)}.get(kind, rng.uniform(5, 15))
    time = np.arange(round(seconds * rate)) / rate
    motion = MOTIONS[kind]
    if motion == "stairs":
        motion = str(rng.choice(["stairs", "chair"]))
    height = rng.uniform(1.5, 1.98)
    body = move(angles_of(motion, time, rng), rate, height)
    if kind == "long walk":  # on a treadmill
        belt = gaussian_filter1d(body["sacrum"], 3 * rate, axis=0) * [1, 1, 0]
        body = {name: places - belt for name, places in body.items()}
    body = soften(body, rng.uniform(0.008, 0.02) if kind == "soft tissue" else rng.uniform(0.001, 0.006), rng)
    if motion == "arms":
        raised = bumps(time, np.arange(1.5, seconds, 3), 1.2)[:, None]
        body |= {name: body[name] + raised * [0, 0.02, 0.03] for name in ("L_shoulder", "R_shoulder")}
    points = labelled(body, str(rng.choice(["gait", "ior", "spine"] if motion == "lift" else list(LABELS))))
    if motion == "lift":
        middle = (body["L_hand"] + body["R_hand"]) / 2
        corners = ((-0.2, 0, 0.1), (0.2, 0, 0.1), (-0.2, 0.3, 0.1), (0.2, 0.3, 0.1), (0, 0, 0.25))
        points |= {f"BOX_{number}": middle + corner for number, corner in enumerate(corners, 1)}
    noise = rng.uniform(0.0002, 0.001)
    points = {label: places + rng.normal(0, noise, places.shape) for label, places in points.items()}
    if rng.random() < 0.4:  # exported after smoothing
        points = {label: gaussian_filter1d(places, 0.02 * rate, axis=0) for label, places in points.items()}
    if kind == "model points":
        computed = {
            f"{label}{ending}": points[label] for label in list(points)[::4] for ending in ("F0", "1")
        }
        computed |= {
            f"AXIS_{number}": places + np.array([0.1, 0, 0])
            for number, places in enumerate(list(points.values())[:6])
        }
        points |= computed
    gaps = rng.uniform(0, 0.04, len(points)) * (rng.random() < 0.6)
    points = hide(points, gaps, rng, kind == "hidden halves")
    up, forward = AXES[seed % len(AXES)] if kind == "other axes" else AXES[0]
    points = {label: np.round(places, 5) for label, places in rotate(points, up, forward).items()}
    return Trial(kind, points, rate, up, forward, height)


FAULTS = {
    "swap": {"exchanged"},
    "freeze": {"frozen"},
    "jump": {"jump", "spike", "off its part"},
}
"""Faults with the kinds of finding that name them."""


def faulty(
    points: Points, fault: str, rate: float, rng: np.random.Generator
) -> tuple[Points, frozenset[str], slice]:
    """Put a fault of 0.1 to 2 s into the frames of a marker: its labels and frames.

    A swap is with a marker within 0.1 to 0.6 m, a freeze keeps the last position, a jump is of 30 to 150 mm, half of them to the
    end of the recording.
    """
    count, labels = len(next(iter(points.values()))), list(points)
    for _ in range(200):
        length = round(rng.uniform(0.1, 2) * rate)
        start = int(rng.integers(5, max(6, count - length - 5)))
        frames = slice(start, min(start + length, count - 5))
        around = slice(frames.start - 5, frames.stop + 5)
        label = str(rng.choice(labels))
        near = [
            other
            for other in labels
            if 0.1 < np.linalg.norm(points[other][start] - points[label][start]) < 0.6
            and np.isfinite(points[other][around]).all()
        ]
        if np.isfinite(points[label][around]).all() and near:
            break
    else:
        raise ValueError("no marker is seen for long enough")
    changed = {label: points[label].copy()}
    if fault == "swap":
        other = str(rng.choice(near))
        changed[other] = points[other].copy()
        changed[label][frames], changed[other][frames] = points[other][frames], points[label][frames]
    elif fault == "freeze":
        changed[label][frames] = points[label][start]
    else:
        frames = slice(start, count) if rng.random() < 0.5 else frames
        direction = rng.normal(size=3)
        changed[label][frames] += rng.uniform(0.03, 0.15) * direction / np.linalg.norm(direction)
    return points | changed, frozenset(changed), frames
