"""Faults put into real marker recordings: how many are named, and what is found in valid ones.

The recordings are those that config/studies and tests/unit/lifting/quality name, and two walks and a dance of BTKData's
C3DSamples (c3d_edge), in the folder real of LUMBAR_SHARED, by default of the folder shared next to the project.

python benchmarks/marker_faults.py [--seed 1] [--markdown docs/lifting/quality.md]
"""

from __future__ import annotations

import argparse
import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from one_thread import PROJECT  # isort: skip

import numpy as np

from acceptance_page import show_section
from lumbar.lifting.quality.body import landmarks, side_pairs
from lumbar.lifting.quality.displacement import MAJORITY
from lumbar.lifting.quality.findings import ERROR, LEFT_OUT, PROPOSED, MarkerFinding
from lumbar.lifting.quality.gate import examine
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


@dataclass(frozen=True)
class Case:
    """A recording with a fault in it, and the finding that is expected."""

    fault: str
    points: Points
    rate: float
    expected: tuple[str, tuple[str, ...]]
    """Kind of the finding and its markers."""
    frames: slice | None = None
    """Frames that may be left out; None for a fault in all frames."""
    outcome: str = LEFT_OUT


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


def alarms(rng: np.random.Generator) -> tuple[int, list[str]]:
    """Return the number of valid recordings examined, and what was found in them."""
    count, found = 0, []
    for name, up in SOUND.items():
        points, rate = read(name, up)
        for number, variant in enumerate(sound_variants(points, rate, rng)):
            count += 1
            found += [f"{name}, {number}: {item}" for item in findings_of(*variant)]
    return count, found


def findings_of(points: Points, rate: float) -> list[MarkerFinding]:
    """Findings in a recording."""
    time = np.arange(len(next(iter(points.values())))) / rate
    return examine(points, time, rate)


def trunk_markers(points: Points) -> list[str]:
    """Labels of the markers of the pelvis, and of one at the top."""
    markers = landmarks(points)
    pelvis = [f"{side}_{name}" for side in "LR" for name in ("ASIS", "PSIS")]
    top = next(name for name in ("C7", "T1", "MANUBRIUM") if name in markers)
    return [markers[name] for name in (top, *pelvis, "SACRUM") if name in markers]


def cases(points: Points, rate: float, rng: np.random.Generator) -> Iterator[Case]:
    """Yield a recording with one fault after the other."""
    count = len(next(iter(points.values())))
    start = int(0.45 * count)
    frames = slice(start, min(count - 5, start + round(rate)))
    for label in trunk_markers(points):
        yield from _jumps(points, rate, label, rng)
        frozen = points[label].copy()
        frozen[frames] = frozen[frames.start]
        yield Case("frozen for 1 s", {**points, label: frozen}, rate, ("frozen", (label,)), frames)
    for pair in side_pairs(points, {label: landmark for landmark, label in landmarks(points).items()}):
        for fault, part in (("left and right exchanged for 1 s", frames), ("left and right exchanged", None)):
            spoilt = _exchanged(points, pair, part or slice(None))
            yield Case(fault, spoilt, rate, ("exchanged", pair), part, LEFT_OUT if part else PROPOSED)
    for times in (10.0, 0.1):
        scaled = {label: times * positions for label, positions in points.items()}
        yield Case(f"unit × {times:g}", scaled, rate, ("unit", ()), outcome=ERROR)


def _exchanged(points: Points, pair: tuple[str, str], frames: slice) -> Points:
    one, other = (points[label].copy() for label in pair)
    one[frames], other[frames] = points[pair[1]][frames], points[pair[0]][frames]
    return {**points, pair[0]: one, pair[1]: other}


def _direction(rng: np.random.Generator) -> np.ndarray:
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


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
    """named, other (another finding, too or instead), said (the part of a jump cannot be seen) or missed."""
    findings = findings_of(case.points, case.rate)
    if not findings:
        return "missed"
    right = {(item.kind, frozenset(item.markers)) for item in findings} == {
        (case.expected[0], frozenset(case.expected[1]))
    }
    right = right and all(item.outcome == case.outcome for item in findings)
    if case.frames is not None:
        first, stop = case.frames.start - 5, case.frames.stop + 5
        right = right and all(first <= item.frames.start < item.frames.stop <= stop for item in findings)
    if (
        not right
        and len(findings) == 1
        and findings[0].markers == case.expected[1]
        and MAJORITY in findings[0].evidence
    ):
        return "said"
    return "named" if right else "other"


def main() -> None:
    """Print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--markdown", type=Path)
    options = parser.parse_args()
    if not _folder().is_dir():
        print(f"no recordings in {_folder()}: set LUMBAR_SHARED to the folder that holds real/")
        return
    rng = np.random.default_rng(options.seed)
    count, found = alarms(rng)
    print("\n".join(found))
    counted: dict[str, Counter] = {}
    for name, up in SEEDED.items():
        for case in cases(*read(name, up), rng):
            judged = verdict(case)
            counted.setdefault(case.fault, Counter())[judged] += 1
            if judged not in ("named", "said"):
                print(f"{judged}: {name}, {case.fault}, {case.expected}")
    lines = [
        f"|fault in {len(SEEDED)} recordings|named|else named|said that nothing tells|not seen|",
        "|---|---|---|---|---|",
        f"|none, in {count} sound ones||{len(found)}|||",
    ]
    for fault, verdicts in counted.items():
        shown = "|".join(str(verdicts[word]) for word in ("named", "other", "said", "missed"))
        lines.append(f"|{fault}|{shown}|")
    show_section(options.markdown, "marker faults", lines)


if __name__ == "__main__":
    main()
