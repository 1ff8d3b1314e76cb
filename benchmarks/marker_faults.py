"""Slow and anatomical faults put into real marker recordings: how many are named, and what is said of sound ones.

The recordings are those that config/studies and tests/unit/lifting/quality name, and two walks and a dance of BTKData's
C3DSamples (c3d_edge), in the folder real of LUMBAR_SHARED or of shared beside the project.

python benchmarks/marker_faults.py [--seed 1] [--markdown docs/lifting/quality.md]
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from one_thread import PROJECT  # isort: skip

import numpy as np

from acceptance_page import show_section
from lumbar.lifting.quality.displacement import ALONE
from lumbar.lifting.quality.drift import smallest_seen
from lumbar.lifting.quality.gate import examine, unchecked_properties
from lumbar.lifting.quality.landmarks import landmarks
from lumbar.lifting.quality.other_trials import of_same_person, other_trials
from lumbar.lifting.quality.sheet import FINE_RATE, LEFT_OUT, Finding, Legend
from lumbar.records.c3d_file import analog_channels
from lumbar.records.c3d_structure import check_structure
from lumbar.records.force_plates import read_force_plates
from lumbar.records.markers import read_markers
from lumbar.settings.layout import MarkerLayout

SEEDED = {
    "lifting/athlete_floor_pickup_squats/squat.c3d": "+y",
    "lifting/athlete_static_full_spine/c3dfile1.c3d": "+z",
    "lifting/ktk_pig_com_oracle/gait.c3d": "+z",
    "lifting/ktk_pig_com_oracle/static.c3d": "+z",
    "lifting/qualisys_ior_gait/Qualisys.c3d": "+z",
    "lifting/s2m_box_transfer/Vicon.c3d": "+z",
    "lifting/weird_squat_trc/markers_Squat2.trc": "+y",
    "lifting/sts_trunk_flexion_trc/sts_perturbed_2.trc": "+y",
    "lifting/sts_trunk_flexion_trc/sts_unperturbed_4.trc": "+y",
    "c3d_edge/10_plugin_outputs.c3d": "+z",
}
SOUND = {
    **SEEDED,
    "c3d_edge/07_subject_labels.c3d": "+z",
    "c3d_edge/11_dance_no_analog.c3d": "+z",
    **{
        f"lifting/sts_trunk_flexion_trc/sts_{kind}_{trial}.trc": "+y"
        for kind, trials in (("perturbed", (1, 3, 4, 5)), ("unperturbed", (1, 2, 3, 5)))
        for trial in trials
    },
}
Points = dict[str, np.ndarray]
Others = tuple[Points, ...]
WITH = ", with other trials"
FEWEST_CUT = 10
"""Samples beyond a limit that make a fault of it."""


@dataclass(frozen=True)
class Case:
    """A recording with a fault in it, and what is to be said of it."""

    fault: str
    points: Points
    rate: float
    expected: tuple[str, tuple[str, ...]]
    """Kind of the finding and its markers."""
    frames: slice | None = None
    """Those alone may be left out; None where that is not asked."""
    untold: str = ""
    """Entry of `unchecked_properties` that says that the fault cannot be seen here."""
    size_m: float = 0.0
    """Of a drift: where the smallest that is seen is larger, the sheet says so."""
    others: Others = ()
    """Other trials of the person."""


def _folder() -> Path:
    return Path(os.environ.get("LUMBAR_SHARED", PROJECT.parent / "shared")) / "real"


def read(name: str, up: str) -> tuple[Points, float]:
    """Markers of a recording of the shared folder by the file's labels, and frames per second."""
    recording = read_markers(_folder() / name, MarkerLayout(up=up, forward="+x", check_axes=False))
    return recording.positions, recording.rate


def sound_variants(points: Points, rate: float, rng: np.random.Generator) -> Iterator[tuple[Points, float]]:
    """Yield a recording as it is, by halves, at half its rate, with noise of 0.3 mm, and with gaps."""
    count = len(next(iter(points.values())))
    yield points, rate
    for part in (slice(0, count // 2), slice(count // 2, count)):
        yield {label: positions[part] for label, positions in points.items()}, rate
    yield {label: positions[::2] for label, positions in points.items()}, rate / 2
    yield (
        {label: positions + rng.normal(0, 3e-4, positions.shape) for label, positions in points.items()},
        rate,
    )
    gappy = {}
    for label, positions in points.items():
        gappy[label] = positions.copy()
        for start in rng.integers(0, count, 3):
            gappy[label][start : start + max(1, count // 20)] = np.nan
    yield gappy, rate


def known_trials() -> dict[str, Others]:
    """Other trials of the person in a recording, as far as there are some."""
    layout, paths = MarkerLayout(check_axes=False), {name: _folder() / name for name in SOUND}
    trials = other_trials(paths.values(), layout)
    return {name: tuple(of_same_person(trials, path).values()) for name, path in paths.items()}


def alarms(rng: np.random.Generator, known: dict[str, Others]) -> tuple[list[int], list[str]]:
    """Numbers of sound recordings looked at, alone and with other trials, and what was found in them."""
    counts, found = [0, 0], []
    for name, up in SOUND.items():
        points, rate = read(name, up)
        for number, variant in enumerate(sound_variants(points, rate, rng)):
            for index, others in enumerate(((), known[name]) if known[name] else ((),)):
                counts[index] += 1
                found += [f"{name}, {number}{WITH * index}: {item}" for item in findings_of(*variant, others)]
    return counts, found


def findings_of(points: Points, rate: float, others: Others = ()) -> list[Finding]:
    """What is found in a recording."""
    time = np.arange(len(next(iter(points.values())))) / rate
    return examine(points, time, rate, others=others)


def trunk_markers(points: Points) -> list[str]:
    """Labels of the markers of the pelvis, and of one at the top."""
    found = landmarks(points)
    pelvis = [f"{side}_{name}" for side in "LR" for name in ("ASIS", "PSIS")]
    top = next(name for name in ("C7", "T1", "MANUBRIUM") if name in found)
    return [found[name] for name in (top, *pelvis, "SACRUM") if name in found]


def cases(points: Points, rate: float, rng: np.random.Generator) -> Iterator[Case]:
    """Yield a recording with one fault after the other."""
    found = landmarks(points)
    for label in trunk_markers(points):
        yield from _drifts(points, rate, label, rng)
        yield from _clipped(points, rate, label)
        yield from _jumps(points, rate, label, rng)
    for side in "LR":
        pair = tuple(found.get(f"{side}_{name}", "") for name in ("KNEE", "ANKLE"))
        if all(pair):
            exchanged = {**points, pair[0]: points[pair[1]], pair[1]: points[pair[0]]}
            yield Case("knee and ankle of one leg exchanged", exchanged, rate, ("exchanged", pair))
    back = {label: positions[::-1] for label, positions in points.items()}
    yield Case("frames in reverse", back, rate, ("backwards", ()), untold="order of the frames")
    for times in (2.0, 0.5):
        yield Case(f"rate × {times:g}", points, rate * times, ("rate", ()), untold=FINE_RATE)


def _direction(rng: np.random.Generator) -> np.ndarray:
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def _drifts(points: Points, rate: float, label: str, rng: np.random.Generator) -> Iterator[Case]:
    """Of 30 to 100 mm from the first frame it is seen to the last, straight and slowing down, and within a second in between."""
    seen = np.flatnonzero(np.isfinite(points[label][:, 0]))
    share = np.clip((np.arange(len(points[label])) - seen[0]) / np.ptp(seen), 0, 1)
    length = min(0.4, rate / np.ptp(seen))
    for size in (0.03, 0.05, 0.075, 0.1):
        start = rng.uniform(0.1, 0.9 - length)
        slowing = (1 - np.exp(-3 * share)) / (1 - np.exp(-3))
        for ramp in (share, slowing, np.clip((share - start) / length, 0, 1)):
            moved = {**points, label: points[label] + size * ramp[:, None] * _direction(rng)}
            yield Case(f"drift of {size * 1e3:.0f} mm", moved, rate, ("drift", (label,)), size_m=size)


def _clipped(points: Points, rate: float, label: str) -> Iterator[Case]:
    """The largest and the smallest tenth of the range of each coordinate cut off."""
    for axis in range(3):
        for sign in (1, -1):
            positions = points[label].copy()
            values = sign * positions[:, axis]
            limit = np.nanmax(values) - 0.1 * (np.nanmax(values) - np.nanmin(values))
            positions[:, axis] = sign * np.where(values > limit, limit, values)
            if (values > limit).sum() >= FEWEST_CUT:
                yield Case("clipping", {**points, label: positions}, rate, ("clipped", (label,)))


def _jumps(points: Points, rate: float, label: str, rng: np.random.Generator) -> Iterator[Case]:
    """The first 70 % of a marker, or the last 30 %, elsewhere by 100 mm."""
    count = len(points[label])
    border = int(0.7 * count)
    for frames, part in ((slice(0, border), "longer"), (slice(border, count), "shorter")):
        moved = points[label].copy()
        moved[frames] += 0.1 * _direction(rng)
        fault = f"jump of 100 mm, the {part} part wrong"
        yield Case(fault, {**points, label: moved}, rate, ("jump", (label,)), frames)


def verdict(case: Case) -> str:
    """named, other (something else is, too or instead), said (that it, or which part is wrong, cannot be told) or missed."""
    found = findings_of(case.points, case.rate, case.others)
    if not found:
        return "said" if _said(case) else "missed"
    right = {(item.kind, item.markers) for item in found} == {case.expected}
    if case.frames is not None:
        inside = [
            case.frames.start - 5 <= item.frames.start < item.frames.stop <= case.frames.stop + 5
            for item in found
        ]
        right = right and all(inside) and all(item.outcome == LEFT_OUT for item in found)
    if (
        case.fault.startswith("jump")
        and not right
        and len(found) == 1
        and found[0].markers == case.expected[1]
    ):
        return "said" if ALONE in found[0].evidence else "other"
    return "named" if right else "other"


def clipped_plates(name: str) -> Counter:
    """Verdicts on the channels of a file's force plates, cut off one by one at nine tenths of their largest size."""
    judged: Counter = Counter()
    path = _folder() / name
    structure = check_structure(path) if path.suffix == ".c3d" else None
    channels = analog_channels(path, structure) if structure else ()
    used = structure.parameters.get("FORCE_PLATFORM:CHANNEL", []) if len(channels) else []
    for channel in {int(number) - 1 for number in used}:
        content = np.fromfile(path, np.uint8)
        stop = structure.data_start + structure.n_frames * structure.frame_bytes
        frames = content[structure.data_start : stop].reshape(structure.n_frames, -1)
        words = frames.view("<f4" if structure.scale < 0 else "<i2")[:, 4 * structure.n_points :]
        samples = (
            words.reshape(structure.n_frames, -1, len(channels))[:, :, channel] - channels.offset[channel]
        )
        limit = 0.9 * np.abs(samples).max()
        if np.count_nonzero(np.abs(samples) > limit) < FEWEST_CUT or np.ptp(samples) == 0:
            continue
        words[:, channel :: len(channels)] = np.clip(samples, -limit, limit) + channels.offset[channel]
        with tempfile.NamedTemporaryFile(suffix=".c3d") as cut:
            content.tofile(cut.name)
            plates = read_force_plates(cut.name, MarkerLayout(up=SOUND[name], forward="+x"))
        notes = [note for plate in plates for note in plate.notes if "is clipped" in note]
        right = len(notes) == 1 and notes[0].startswith(f"channel {channel + 1} ")
        judged["named" if right else "other" if notes else "missed"] += 1
    return judged


def _said(case: Case) -> bool:
    """Whether the sheet says that this cannot be seen in the recording."""
    time = np.arange(len(next(iter(case.points.values())))) / case.rate
    if case.size_m:
        named = {label: landmark for landmark, label in landmarks(case.points).items()}
        sizes = smallest_seen(case.points, Legend(time, case.rate, named), case.others)
        return sizes[case.expected[1][0]][0] > case.size_m
    return case.untold in unchecked_properties(case.points, time, case.rate)


def count_verdicts(name: str, made: Iterable[Case], counted: dict[str, Counter]) -> None:
    """Judge cases of a recording, and print those that are not seen."""
    for case in made:
        judged = verdict(case)
        counted.setdefault(case.fault, Counter())[judged] += 1
        if judged not in ("named", "said"):
            print(f"{judged}: {name}, {case.fault}, {case.expected}")


def main() -> int:
    """Print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--markdown", type=Path)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    known = known_trials()
    counts, found = alarms(rng, known)
    print("\n".join(found))
    counted: dict[str, Counter] = {}
    for name, up in SEEDED.items():
        counted.setdefault("clipped channel of a force plate", Counter()).update(clipped_plates(name))
        points, rate = read(name, up)
        count_verdicts(name, cases(points, rate, rng), counted)
    for name in filter(known.get, SOUND):
        points, rate = read(name, SOUND[name])
        drifting = (case for label in trunk_markers(points) for case in _drifts(points, rate, label, rng))
        beside = (replace(case, fault=case.fault + WITH, others=known[name]) for case in drifting)
        count_verdicts(name, beside, counted)
    lines = [
        f"|fault in {len(SEEDED)} recordings|named|else named|said that nothing tells|not seen|",
        "|---|---|---|---|---|",
        f"|none, in {counts[0]} sound ones, {counts[1]} also{WITH[1:]}||{len(found)}|||",
    ]
    for fault, verdicts in counted.items():
        shown = "|".join(str(verdicts[word]) for word in ("named", "other", "said", "missed"))
        lines.append(f"|{fault}|{shown}|")
    show_section(options.markdown, "slow faults", lines)
    return 0


if __name__ == "__main__":
    sys.exit(main())
