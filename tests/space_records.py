"""A periodic motion in three axes on a spring that is alike in every direction, with an error of the force and noise."""

import numpy as np

from lumbar.records.record import Channel, Record

STEP, PERIODS, SAMPLES = 0.01, 5, 800
TIME = np.arange(PERIODS * SAMPLES) * STEP
STIFFNESS, NOISE = 0.8, 0.02
_RATES = 2 * np.pi / (SAMPLES * STEP) * np.array([[1, 5, 9], [2, 7, 12], [3, 8, 13]])[:, :, None]
_PHASES = np.array([[0.1, 2.0, 4.0], [1.0, 3.3, 5.1], [0.4, 2.7, 1.9]])[:, :, None]
POSITION = np.sum(np.sin(_RATES * TIME + _PHASES), axis=1)
VELOCITY = np.sum(_RATES * np.cos(_RATES * TIME + _PHASES), axis=1)
SPEED = np.linalg.norm(VELOCITY, axis=0)
FRICTION = 0.4 * VELOCITY / SPEED


def white(seed: int = 1) -> np.ndarray:
    """Noise alike along every axis."""
    return NOISE * np.random.default_rng(seed).standard_normal(POSITION.shape)


def record_of(name: str, time: np.ndarray, position, force, axes: str) -> Record:
    """A record of these axes; position in mm and force in N of shape (axes, samples)."""
    channels = {}
    for axis, moved, pushed in zip(axes, position, force, strict=True):
        channels[f"input_{axis}"] = Channel(moved, "position", "mm")
        channels[f"output_{axis}"] = Channel(pushed, "force", "N")
    return Record(name, time, channels)


def record(error: np.ndarray, noise: np.ndarray | None = None, axes: str = "xyz") -> Record:
    """The record with an error of the force and this noise; default `white`."""
    force = STIFFNESS * POSITION + error + (white() if noise is None else noise)
    return record_of("multisine", TIME, POSITION[: len(axes)], force[: len(axes)], axes)


TABLE = "time_s,position_x_mm,position_y_mm,position_z_mm,force_x_N,force_y_N,force_z_N\n" + "".join(
    ",".join(f"{value:.6f}" for value in row) + "\n"
    for row in np.column_stack([TIME, POSITION.T, record(FRICTION).stacked("output").T])
)
