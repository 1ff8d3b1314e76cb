"""The body model beside the rules: on virtual people, whose truth is known, and on real recordings.

    python benchmarks/body_model.py [people coverage boxes hidden centre t12 areas] [--seeds 8] [--shared ../shared]

Prints the tables of docs/lifting/body_model.md. `people` takes about 6 CPU-seconds per person and condition, `coverage` (on the
page of 200 people, `--markdown PAGE` writes it) about 12 per person, the others together four minutes. Rules bridge every gap by
a spline here, however long, where they would leave it open by default.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, replace
from pathlib import Path

from one_thread import PROJECT  # isort: skip

import numpy as np
import pandas as pd

from acceptance_page import show_section
from lumbar.lifting.body_model import anatomy
from lumbar.lifting.body_model.build import (
    at_nodes,
    build,
    measured_markers,
)
from lumbar.lifting.body_model.fit import BodyFit, fit, model_points
from lumbar.lifting.body_model.pendulums import DEPOSIT, Conditions, Planar, basin_intervals, model_pendulums
from lumbar.lifting.movement.centre_of_mass import COMS, WINTER, segment_centres, trunk_centre
from lumbar.lifting.movement.cleaning import filter_markers
from lumbar.lifting.movement.event_detection import find_events
from lumbar.lifting.movement.events import held_frames
from lumbar.lifting.movement.gaps import fill_gaps
from lumbar.lifting.movement.joint_centres import trunk_points
from lumbar.lifting.movement.pendulum_states import pendulum_states
from lumbar.lifting.movement.rigid_filling import body_shape, fill_rigid
from lumbar.lifting.stability.comparison.percent_differences import measured_interval
from lumbar.records.markers import MarkerRecording, read_markers
from lumbar.settings.layout import MarkerLayout
from lumbar.settings.lifting import BodyModelSettings
from predicted_markers import predicted_marker
from study_settings import study_settings, subject_settings
from virtual_people import JOINTS, virtual_trial

RATE = 50.0
"""Instants of the model per second."""
STATURE = 1.72
"""Where a recording's README states none."""
CONDITIONS = {
    "complete": ("complete", 0.001),
    "complete, noise of 2 mm": ("complete", 0.002),
    "complete, noise of 3 mm": ("complete", 0.003),
    "gaps": ("gaps", 0.001),
    "exchanged": ("exchanged", 0.001),
    "neither T12 nor L5": ("no_T12", 0.001),
}
"""What is wrong with the markers, and the noise of each of them in m."""
HIDDEN_S = 1.0


@dataclass(frozen=True)
class Source:
    """A real recording: file, axes, and what its own labels mean."""

    path: str
    up: str = "+z"
    forward: str = "+x"
    unit: str = "file"
    window: tuple[float, float] | None = None


SOURCES = {
    "floor pick-up": Source("athlete_floor_pickup_squats/squat.c3d", "+y", window=(0.0, 6.0)),
    "box transfer": Source("s2m_box_transfer/Vicon.c3d", forward="-x", window=(0.5, 5.0)),
    "sit-to-stand": Source("sts_trunk_flexion_trc/sts_perturbed_3.trc", "+y"),
    "squat": Source("weird_squat_trc/markers_Squat2.trc", "+y"),
    "gait": Source("ktk_pig_com_oracle/gait.c3d", unit="m"),
}


def at(times: np.ndarray, time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Interpolate a trajectory of shape (n, 3)."""
    return np.stack([np.interp(times, time_s, axis) for axis in values.T], axis=1)


def angle(relative: np.ndarray) -> np.ndarray:
    """Flexion of a pendulum about its pivot, radians."""
    return np.arctan2(relative[:, 1], relative[:, 2])


def rate_of(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Derivative of a cubic spline."""
    from scipy.interpolate import CubicSpline

    return CubicSpline(times, values)(times, 1)


def rms(values: np.ndarray) -> float:
    """Root mean square over time, of the norm of vectors."""
    return float(np.sqrt(np.mean(np.sum(values.reshape(len(values), -1) ** 2, axis=1))))


def people(seeds: int) -> None:
    """Errors and coverage on virtual people."""
    columns = "centre off, mm: model | rules | θ off, mrad: model | rules | θ̇ off, mrad/s: model | rules"
    print(f"| markers | {columns} | in 95 %: centre | θ | θ̇ |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    settings, start = study_settings().twin.lifting, time.process_time()
    for condition, how in CONDITIONS.items():
        rows = np.concatenate([one_person(settings, seed, how) for seed in range(seeds)])
        off, inside = np.sqrt(np.mean(rows[:, :6] ** 2, axis=0)), 100 * rows[:, 6:].mean(axis=0)
        shown = ["no result" if np.isnan(value) else f"{value:.1f}" for value in off]
        print(
            f"| {condition} | {' | '.join(shown)} | {' | '.join(f'{share:.0f} %' for share in inside)} |",
            flush=True,
        )
    print(f"{(time.process_time() - start) / seeds / len(CONDITIONS):.1f} CPU-seconds per person", flush=True)


def one_person(settings, seed: int, condition: tuple[str, float]) -> np.ndarray:
    """Errors of model and rules in turn, and coverage; one row per centre of mass, over the deposit."""
    trial = virtual_trial(settings, seed, *condition)
    recording = MarkerRecording("virtual", trial.time, trial.rate, trial.markers)
    times, nodes = at_nodes(recording, RATE)
    held = (times > trial.events.lift_off) & (times < trial.events.release)
    found = fit(build(times, nodes, trial.person.height_m, "male", held))
    inside = (times >= trial.events.deposit_start) & (times <= trial.events.release)
    filled, _ = fill_gaps(recording, 2.0)
    smooth = filter_markers(filled)
    rules = segment_centres_or_none(trunk_points(smooth, "inner", "harrington", "male"))
    rules_pivot = (smooth["L_ANKLE"] + smooth["R_ANKLE"]) / 2
    unknowns = [found.best, *found.draws(100, seed)]
    centres = [segment_centres(model_points(found, each), WINTER) for each in unknowns]
    pivots = [(each.points["L_ANKLE"] + each.points["R_ANKLE"]) / 2 for each in unknowns]
    rows = []
    for com in COMS:
        truth, pivot = (
            at(times, trial.time, trial.centres[com]),
            at(times, trial.time, trial.pivots["mid_ankle"]),
        )
        true_rate = np.interp(
            times, trial.time, rate_of(trial.time, angle(trial.centres[com] - trial.pivots["mid_ankle"]))
        )
        place = np.array([each[com] for each in centres])
        turned = np.array([angle(each[com] - at_) for each, at_ in zip(centres, pivots, strict=True)])
        speed = np.array([rate_of(times, each) for each in turned])
        pairs = [(place, truth, 1e3), (turned, angle(truth - pivot), 1e3), (speed, true_rate, 1e3)]
        by_rules: list[np.ndarray | None] = [None] * 3
        if com in rules:
            centre = at(times, trial.time, rules[com])
            theta = angle(centre - at(times, trial.time, rules_pivot))
            by_rules = [centre, theta, rate_of(times, theta)]
        errors, covered = [], []
        for (values, true, unit), other in zip(pairs, by_rules, strict=True):
            sd = np.sqrt(np.mean((values[1:] - values[0]) ** 2, axis=0))
            errors.append(unit * rms((values[0] - true)[inside]))
            errors.append(np.nan if other is None else unit * rms((other - true)[inside]))
            covered.append(np.mean(np.abs(values[0] - true)[inside] < 1.96 * sd[inside]))
        rows.append([*errors, *covered])
    return np.array(rows)


BASINS = {"mid_ankle": (50, 0.003), "hip": (200, 2.0)}
"""Knots and control weight (as `stability.grid` has it) about each pivot; more knots change the areas by less than 0.2 %."""
COVERAGE_DRAWS, BOX_DRAWS = 100, 400
ABOUT_S = 1.2
"""Seconds kept before and after the deposit."""


def area_intervals(
    seed: int, joints_of: str, lift: str | None = None, count: int = COVERAGE_DRAWS, pivots=tuple(BASINS)
) -> pd.DataFrame:
    """Intervals of one virtual person's basin areas between detected events, and the true areas between the true ones."""
    study = study_settings()
    trial = virtual_trial(study.twin.lifting, seed, joints_of=joints_of, lift=lift)
    recording = MarkerRecording("virtual", trial.time, trial.rate, trial.markers)
    events = find_events(filter_markers(recording), study.lifting.events)
    start, stop = trial.events.deposit_start, trial.events.release
    kept = (trial.time > start - ABOUT_S) & (trial.time < stop + ABOUT_S)
    positions = {name: points[kept] for name, points in recording.positions.items()}
    times, nodes = at_nodes(replace(recording, time=trial.time[kept], positions=positions), RATE)
    found = fit(build(times, nodes, trial.person.height_m, "male", held_frames(times, events)))
    draws, off = list(found.draws(count, seed)), BodyModelSettings().event_sd_s
    rows = []
    for pivot in pivots:
        knots, weight = BASINS[pivot]
        settings = replace(study.lifting, points=knots, pivot=pivot)
        regulator = replace(study.stability.regulator, control_weight=weight)
        stability = replace(study.stability, knots=knots, regulator=regulator)
        conditions = Conditions(WINTER, trial.person.mass_kg, trial.box_mass, 0.0, events, settings, off)
        modelled = model_pendulums(found, conditions, draws)
        true: Planar = {}
        for com, centre in trial.centres.items():
            way = centre - trial.pivots[pivot]
            planar = pendulum_states(trial.time, way, start, stop, knots, com)
            true |= {(com, plane): states for plane, states in planar.items()}
        sign = stability.pendulum.sign
        truth = basin_intervals(replace(modelled, states=true, draws=[]), stability, sign, pivot)
        table = basin_intervals(modelled, stability, sign, pivot)
        rows.append(table.assign(truth=truth.mean_area, about=pivot))
    late = {name: events[name].time_s - getattr(trial.events, name) for name in DEPOSIT}
    return pd.concat(rows).assign(**late)


def covered(rows: pd.DataFrame) -> pd.DataFrame:
    """How often an interval holds the true area, where there is a true basin and an interval, and by how much both are off."""
    table = []
    for key, own in rows.groupby(["about", "com", "plane"], sort=False):
        both = own.dropna(subset=["truth", "mean_area_low"])
        inside = both.truth.between(both.mean_area_low, both.mean_area_high).mean()
        off = np.log(both.mean_area / both.truth)
        drawn = np.log(both.mean_area_high / both.mean_area_low).mean() / 3.92
        lost = 100 * own.no_basin_share.mean(), 100 * own.truth.isna().mean()
        table.append((*key, len(own), len(both), 100 * inside, off.mean(), off.std(), drawn, *lost))
    columns = [
        "simulated",
        "with both",
        "in 95 %",
        "ln(area/true)",
        "its SD",
        "of the draws",
        "no basin, %: told",
        "true",
    ]
    return pd.DataFrame(table, columns=["about", "com", "plane", *columns])


def coverage_lines(table: pd.DataFrame) -> list[str]:
    """The page's table: a row per centre of mass, coverage about ankles and hips in both planes."""
    lines = ["| pendulum | ankles, lateral | flexion | hips, lateral | flexion |", "|" + "---|" * 5]
    for com, own in table.groupby("com", sort=False):
        lines.append(f"| {com} | {' | '.join(f'{share:.1f}' for share in own['in 95 %'])} |")
    return lines


def coverage(people: int, first: int = 0, joints: str = JOINTS[0], markdown: Path | None = None) -> None:
    """Coverage of the areas' intervals about ankles and hips, of people from one on."""
    rows = pd.concat([area_intervals(seed, joints) for seed in range(first, first + people)])
    table = covered(rows)
    print(table.round(3).to_string(index=False))
    for name in DEPOSIT:
        print(f"{name}, late by ms:", (1e3 * rows[name]).agg(["mean", "std"]).round(0).to_dict())
    show_section(markdown, "areas covered", coverage_lines(table))


def boxes(people: int, first: int = 0) -> None:
    """Coverage of the intervals of what a lighter box changes, of people who lift both, about the ankles."""
    rows = []
    for seed in range(first, first + people):
        who = ("expert", "novice")[seed % 2]
        both = pd.concat(
            area_intervals(seed, JOINTS[0], f"{who}_{mass}kg", BOX_DRAWS, ("mid_ankle",)).assign(
                subject=who, experience=who, box_mass_kg=float(mass)
            )
            for mass in (15, 23)
        )
        for (com, plane), own in both.groupby(["com", "plane"], sort=False):
            light, heavy = own["truth"]
            ends = measured_interval(own, (who, 23.0), (who, 15.0), com, plane)
            rows.append((com, plane, *ends, 100 * (light / heavy - 1)))
    table = pd.DataFrame(rows, columns=["com", "plane", "low", "high", "truth"])
    table["held"] = table["truth"].between(table["low"], table["high"])
    table["off"], table["width"] = (
        (table["low"] + table["high"]) / 2 - table["truth"],
        table["high"] - table["low"],
    )
    print(
        table.groupby(["com", "plane"], sort=False).agg(
            {"held": "mean", "off": ["mean", "std"], "width": "mean"}
        )
    )
    print(
        f"{100 * table['held'].mean():.1f} % of {len(table)} held, half-width {table['width'].mean() / 2:.2f} points"
    )


def segment_centres_or_none(points) -> dict[str, np.ndarray]:
    """Centres of the segments whose ends are inside the body."""
    inner = {name: point for name, point in points.points.items() if point.inner}
    return segment_centres(replace(points, points=inner), WINTER)


def real(shared: Path, source: Source) -> MarkerRecording:
    """A real recording with its landmarks named."""
    layout = MarkerLayout(up=source.up, forward=source.forward, unit=source.unit, check_axes=False)
    aliases = study_settings("studies/box_transfer.yaml").lifting.markers.aliases
    own = aliases if "box" in source.path else {}
    recording = measured_markers(read_markers(shared / "real" / "lifting" / source.path, layout), own)
    if source.window:
        kept = (recording.time >= source.window[0]) & (recording.time < source.window[1])
        positions = {name: points[kept] for name, points in recording.positions.items()}
        recording = replace(recording, time=recording.time[kept], positions=positions)
    return recording


def hidden(shared: Path, only: str | None = None) -> None:
    """Hide each marker of the trunk for a second and predict it."""
    print("| recording | marker hidden | its way, m | model, mm | spline | rigid filling | in 95 % |")
    print("|---|---|---|---|---|---|---|")
    covered = []
    for name, source in SOURCES.items():
        if only not in (None, name):
            continue
        recording = real(shared, source)
        candidates = [name for name in (*anatomy.THORAX, *anatomy.PELVIS) if name in recording]
        trunk = [name for name in candidates if name[2:] not in ("SHOULDER", "HIP")]
        for marker in trunk:
            row = one_hidden(recording, marker)
            if row is not None:
                way, *errors, share = row
                covered.append(share)
                shown = ["–" if np.isnan(error) else f"{error:.0f}" for error in errors]
                print(
                    f"| {name} | {marker} | {way:.2f} | {' | '.join(shown)} | {100 * share:.0f} % |",
                    flush=True,
                )
    print(f"in 95 %, all: {100 * np.mean(covered):.0f} %")


def one_hidden(recording: MarkerRecording, marker: str) -> tuple[float, ...] | None:
    """Way of the marker in its second of most movement, and errors of model, spline and rigid filling, mm."""
    truth, frames = recording[marker], int(HIDDEN_S * recording.rate)
    way = np.convolve(np.nan_to_num(np.linalg.norm(np.diff(truth, axis=0), axis=1)), np.ones(frames), "valid")
    margin = int(0.3 * recording.rate)
    start = margin + int(np.argmax(way[margin : len(way) - margin]))
    if not np.isfinite(truth[start : start + frames]).all():
        return None
    gone = truth.copy()
    gone[start : start + frames] = np.nan
    lacking = replace(recording, positions={**recording.positions, marker: gone})
    times, nodes = at_nodes(lacking, RATE)
    found = fit(build(times, nodes, STATURE))
    if marker not in found.noise:
        return None
    inside = (times >= recording.time[start]) & (times < recording.time[start + frames - 1])
    true = at(times, recording.time, truth)[inside]
    best = predicted_marker(found, marker)[inside]
    spline = fill_gaps(lacking, HIDDEN_S + 0.1)[0][marker]
    group = anatomy.PELVIS if marker in anatomy.PELVIS else anatomy.THORAX
    shape = body_shape(lacking.positions, [name for name in group if name in recording], "")
    rigid = np.full_like(truth, np.nan)
    if shape is not None:
        rigid = fill_rigid(lacking.positions, recording.rate, 0.0, shape, "", 0.2)[0][marker]
    others = [at(times, recording.time, values)[inside] for values in (spline, rigid)]
    share = np.mean(np.abs(best - true) < 1.96 * marker_sd(found, marker)[inside])
    return way[start], *(1e3 * rms(values - true) for values in (best, *others)), share


def marker_sd(found: BodyFit, marker: str) -> np.ndarray:
    """Standard deviation of a hidden marker: of its place on the body, and of its skin."""
    structure = found.model.structure
    part = next(part for part, place in structure.places if place == marker)
    places = np.array([each.place(structure, part, marker) for each in found.draws(60, 1)])
    return np.sqrt(places.var(axis=0) + found.noise[marker].sd ** 2)


def centre(shared: Path) -> None:
    """The whole body's centre against Plug-in Gait's own."""
    from test_centre_of_mass import errors_mm, plug_in_gait, whole_body

    print("| trial | model: forward, in space, mm | its SD forward | rules | skin |")
    print("|---|---|---|---|---|")
    for trial in ("static", "gait"):
        recording = plug_in_gait(shared, trial)
        times, nodes = at_nodes(
            real(shared, Source(f"ktk_pig_com_oracle/{trial}.c3d", forward="+y", unit="m")), RATE
        )
        found = fit(build(times, nodes, STATURE))
        there = {name: at(times, recording.time, points) for name, points in recording.positions.items()}
        offsets = []
        for unknowns in (found.best, *found.draws(60, 1)):
            points = model_points(found, unknowns)
            trunk = trunk_centre(segment_centres(points, WINTER), WINTER)
            offsets.append(whole_body(there, trunk) - there["WHOLE"])
            if unknowns is found.best:
                forward = np.cross([0, 0, 1], points.right)
        ahead = 1e3 * np.sum(np.array(offsets) * forward, axis=2)
        distance = 1e3 * np.nanmean(np.linalg.norm(offsets[0], axis=1))
        rows = [errors_mm(recording, ends, "unknown") for ends in ("inner", "skin")]
        shown = " | ".join(f"{row[0]:+.0f}, {row[1]:.0f}" for row in rows)
        sd = np.nanmean(ahead[1:].std(axis=0))
        print(f"| {trial} | {np.nanmean(ahead[0]):+.0f}, {distance:.0f} | {sd:.0f} | {shown} |", flush=True)


def t12(shared: Path) -> None:
    """T12 of a person standing, left out and estimated, against its real marker."""
    recording = real(shared, Source("athlete_static_full_spine/c3dfile1.c3d"))
    print("| left out | T12 off in space, mm | standard deviation in space |")
    print("|---|---|---|")
    for out in (("T12",), ("T12", "T6"), ("T12", "T6", "SPINMOL", "SPINM2", "SPINM3")):
        left = {name: points for name, points in recording.positions.items() if name not in out}
        times, nodes = at_nodes(replace(recording, positions=left), RATE)
        found = fit(
            build(times[:100], {name: points[:100] for name, points in nodes.items()}, 1.60, "female")
        )
        structure = found.model.structure
        estimate = found.best.place(structure, "thorax", "T12").mean(axis=0)
        drawn = [each.place(structure, "thorax", "T12").mean(axis=0) for each in found.draws(100, 1)]
        off = 1e3 * np.linalg.norm(estimate - recording["T12"].mean(axis=0))
        print(
            f"| {', '.join(out)} | {off:.0f} | {1e3 * np.sqrt(np.var(drawn, axis=0).sum()):.0f} |", flush=True
        )


def areas(shared: Path) -> None:
    """Basin areas of the box transfer with intervals."""
    from lumbar.lifting.body_model.pendulums import model_of_lift
    from lumbar.lifting.movement.lift import analyse_lift

    study, subject = study_settings("studies/box_transfer.yaml"), subject_settings("box_transfer")
    path = shared / "real" / "lifting" / "s2m_box_transfer" / "Vicon.c3d"
    settings, trial = study.lifting, subject.trials[0]
    lift = analyse_lift(read_markers(path, settings.markers), "box", subject, trial, settings)
    modelled = model_of_lift(path, lift, subject, trial, settings, BodyModelSettings())
    columns = "θ, rad: model | rules | θ̇ off the rules', rad/s (rms) | its SD | area, rad²/s | 95 %"
    print(f"| pendulum | {columns} | draws without basin |")
    print("|---|---|---|---|---|---|---|---|")
    pendulums = modelled.pendulums
    table = basin_intervals(pendulums, study.stability, study.stability.pendulum.sign, settings.pivot)
    for row in table.itertuples():
        key = row.com, row.plane
        best, rules, sd = pendulums.states[key], lift.states[key], pendulums.sd[key]
        off = rms(best.angular_velocity - rules.angular_velocity)
        theta = f"{best.angle.mean():.3f} ± {sd.angle.mean():.3f} | {rules.angle.mean():.3f}"
        area = f"{row.mean_area:.3g} | {row.mean_area_low:.3g} to {row.mean_area_high:.3g}"
        lost = f"{row.draws_without_basin} of {len(pendulums.draws)}"
        print(
            f"| {', '.join(key)} | {theta} | {off:.3f} | {sd.angular_velocity.mean():.3f} | {area} | {lost} |"
        )


def main() -> None:
    """Print what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parts = {
        "hidden": lambda shared: hidden(shared, options.recording),
        "centre": centre,
        "t12": t12,
        "areas": areas,
    }
    virtual = {
        "people": people,
        "coverage": lambda count: coverage(count, options.first, options.joints, options.markdown),
        "boxes": lambda count: boxes(count, options.first),
    }
    parser.add_argument("parts", nargs="*", choices=[*parts, *virtual, []], default=[])
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--first", type=int, default=0, help="coverage and boxes of people from this one on")
    parser.add_argument(
        "--joints", choices=JOINTS, default=JOINTS[0], help="what they scatter about, of coverage"
    )
    parser.add_argument("--markdown", type=Path, help="page that the table of coverage goes into")
    parser.add_argument("--recording", choices=list(SOURCES), help="hide markers of this one alone")
    parser.add_argument("--shared", type=Path, default=PROJECT.parent / "shared")
    options = parser.parse_args()
    for part in options.parts or [*virtual, *parts]:
        print(f"\n{part}\n")
        virtual[part](options.seeds) if part in virtual else parts[part](options.shared)


if __name__ == "__main__":
    main()
