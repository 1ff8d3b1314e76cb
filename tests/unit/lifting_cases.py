"""Lifts, trials and pendulums that several tests share."""

from dataclasses import replace
from pathlib import Path

import numpy as np

import lumbar
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import Pendulums, Weights, gather
from lumbar.lifting.stability.model.pendulum_trajectories import Trajectory
from lumbar.records.c3d_file import write_c3d
from lumbar.records.marker_file import RecordedEvent
from lumbar.records.markers import MarkerRecording
from lumbar.settings.lifting import ALIASES, RegulatorSettings, SubjectSettings, TrialSettings
from lumbar.twin.examples import example_lift
from lumbar.twin.lifter import simulate
from lumbar.twin.lifting_recordings import true_movement, write_lift
from study_settings import study_settings

__all__ = ["ALIASES", "example_lift", "simulate", "true_movement"]

GRAVITY = 9.81
WEIGHTS = Weights.from_settings(RegulatorSettings(control_weight=1e-3))


def minimum_jerk(
    start=0.4,
    end=0.05,
    duration=1.5,
    mass=33.0,
    length=1.1,
    samples=400,
    subject="expert",
    box=23.0,
    com="abdomen",
    plane="flexion_extension",
) -> Trajectory:
    """Move smoothly from one angle to another (Flash and Hogan's minimum-jerk polynomial)."""
    time = np.linspace(0.0, duration, samples)
    s, way = time / duration, end - start
    return Trajectory(
        subject=subject,
        experience=subject,
        box_mass_kg=box,
        com=com,
        plane=plane,
        pivot="mid_ankle",
        time=time,
        angle=start + way * (10 * s**3 - 15 * s**4 + 6 * s**5),
        angular_velocity=way / duration * 30 * (s**2 - 2 * s**3 + s**4),
        angular_acceleration=way / duration**2 * 60 * (s - 3 * s**2 + 2 * s**3),
        mass_kg=mass,
        length_m=length,
    )


def pendulums_of(items, sign, damping=1.0, gravity=GRAVITY, knots=401) -> Pendulums:
    """Gather trajectories of one sign and damping."""
    return gather(items, [sign] * len(items), [damping] * len(items), gravity, knots)


def full(entries):
    """Symmetric matrix of its three entries."""
    return np.array([[entries[0], entries[1]], [entries[1], entries[2]]])


ATHLETE = {
    "MANUBRIUM": "STRN",
    "XIPHOID": "XIPH",
    "L5": "SACROL",
    "SACRUM": {"mean": ["LPSI", "RPSI"]},
    **{f"{side}_SHOULDER": f"{side}ACR" for side in "LR"},
    **{f"{side}_HIP": {"from": f"{side}ASI", "offset_m": [0, 0, -0.1]} for side in "LR"},
    **{
        f"{side}_{name}": {"mean": [side + label for label in labels]}
        for side in "LR"
        for name, labels in {
            "WRIST": ["WRR", "WRU"],
            "ELBOW": ["CUBL", "CUBM"],
            "KNEE": ["KNEL", "KNEM"],
            "ANKLE": ["MALL", "MALM"],
        }.items()
    },
}


ANN = SubjectSettings(name="ann", sex="unknown", mass_kg=80.0, height_m=1.75, experience="unknown")


def trial_of(mass_kg=15.0, events=None, **others) -> TrialSettings:
    """A trial, with events set by hand (a mapping) or those of the file (``"file"``)."""
    return TrialSettings.model_validate(
        {"box_mass_kg": mass_kg, "markers": "lift.c3d", "events": events, **others}
    )


def write_recording(path, positions, rate=100.0, subject="ann") -> Path:
    """Write markers in metres to a C3D file."""
    labels = [f"{'box' if name.startswith('BOX_') else subject}:{name}" for name in positions]
    write_c3d(path, 1e3 * np.stack(list(positions.values()), axis=1), labels, float(rate))
    return path


def hide(positions, frames, *labels) -> dict[str, np.ndarray]:
    """Markers, some of which are not seen in some frames."""
    return {
        label: np.where(np.isin(np.arange(len(points)), np.r_[frames])[:, None], np.nan, points)
        if label in labels
        else points
        for label, points in positions.items()
    }


def mark(label, time, context="") -> RecordedEvent:
    """An event in a recording's file."""
    return RecordedEvent(label, context, time)


def recording_of(positions, rate=100.0, name="lift", **others) -> MarkerRecording:
    """A recording from time 0 under standard names; `others` are its further attributes."""
    time = np.arange(len(next(iter(positions.values())))) / rate
    return MarkerRecording(name, time, rate, dict(positions), source=f"{name}.c3d", **others)


def true_recording(name) -> MarkerRecording:
    """Markers of a lift of the synthetic twin as they are, without noise or gap."""
    return recording_of(true_movement(study_settings().twin.lifting, name).markers)


def noisy_recording(name, seed, noise_mm, folder) -> MarkerRecording:
    """A lift of the synthetic twin with noise and gaps, as it is read."""
    twin = study_settings().twin.lifting.model_copy(update={"marker_noise_mm": noise_mm})
    write_lift(twin, name, [seed], folder / "lift.c3d", None)
    return lumbar.read(folder / "lift.c3d", layout=study_settings().lifting.markers)


def hide_markers(recording, *parts) -> MarkerRecording:
    """The recording without the markers in whose names one of these parts stands."""
    kept = {name: points for name, points in recording.positions.items() if not any(map(name.count, parts))}
    return replace(recording, positions=kept)


def cut(recording, kept) -> MarkerRecording:
    """The frames of a recording that are kept."""
    positions = {name: points[kept] for name, points in recording.positions.items()}
    return replace(recording, time=recording.time[kept], positions=positions)


def missing_share(recording: MarkerRecording) -> float:
    """Share of samples in which a marker was not seen, over all markers."""
    return float(np.mean([np.isnan(points[:, 0]).mean() for points in recording.positions.values()]))
