"""Synthetic recordings of a haptic device that moves its stylus by itself, in the air: pushes with releases, then a chirp.

The program of the device is played tick by tick: it reads the encoder, commands a force with a weak spring towards the
middle in it, and writes both down. Between two changes of the force the motion has a closed form, with dry friction too.
"""

import math
import os
from collections import deque
from dataclasses import replace
from itertools import repeat

import numpy as np

from lumbar.base.files import write_text
from lumbar.records.record import Channel, Record
from lumbar.settings.runtime import DeviceSettings

TRAVEL_MM, _MOTOR_N, _COARSE_HZ = 40.0, 5.0, 250.0
"""Largest excursion to either side that the amplitudes lead to, largest force, and the rate at which that is tried."""


def pushes(rate_Hz: float) -> np.ndarray:
    """Eight pushes of 40 ms in turn to either side, each with its release of 0.71 s; shape (samples,), of an amplitude of 1."""
    push = np.concatenate([np.ones(round(0.04 * rate_Hz)), np.zeros(round(0.71 * rate_Hz))])
    return np.concatenate([push, -push] * 4)


def chirp(rate_Hz: float) -> np.ndarray:
    """Sine from 3 to 50 Hz in 10 s, whose frequency grows in proportion to itself; shape (samples,), of an amplitude of 1."""
    growth = math.log(50.0 / 3.0) / 10.0
    return np.sin(2 * np.pi * 3.0 / growth * np.expm1(growth * np.arange(round(10.0 * rate_Hz)) / rate_Hz))


def moved(
    device: DeviceSettings, position: float, velocity: float, force: float, seconds: float
) -> tuple[float, float]:
    """Position in m and velocity in m/s of the stylus after a time in which the force in N is held; nobody holds it.

    Solves m ẍ + b ẋ + F sign(ẋ) = force; at rest it stays there as long as the force is no larger than the friction F.
    """
    direction = math.copysign(1.0, velocity or force)
    if velocity == 0.0 and abs(force) <= device.friction_N:
        return position, 0.0
    relaxation = device.mass_kg / device.damping_N_s_m
    final = (force - direction * device.friction_N) / device.damping_N_s_m
    # It stops on the way where what drives it, friction included, has turned against it.
    stop = relaxation * math.log1p(-velocity / final) if velocity * final < 0.0 else math.inf
    part = min(stop, seconds)
    lost = -math.expm1(-part / relaxation)
    position += velocity * relaxation * lost + final * (part - relaxation * lost)
    if stop < seconds:
        return moved(device, position, 0.0, force, seconds - stop)
    return position, velocity + (final - velocity) * lost


def play(
    device: DeviceSettings,
    commands: np.ndarray,
    spring_N_m: float = 10.0,
    noise_um: float = 0.0,
    seed: int = 0,
) -> Record:
    """Play forces in N, shape (samples,), on a device and record what its program knows: force and encoder.

    The program takes from each what its spring pulls back; the encoder errs by `noise_um`, standard deviation, before it is
    rounded to its steps. ``input`` is the position in mm, ``output`` the commanded force in N, as in tissue tests.
    """
    step, delay = 1.0 / device.rate_Hz, 1e-3 * device.delay_ms
    late = int(delay / step)
    part = delay - late * step
    resolution = 1e-6 * device.encoder_um
    noise = 1e-6 * noise_um * np.random.default_rng(seed).standard_normal(len(commands))
    position = velocity = 0.0
    coming = deque(repeat(0.0, late + 1))
    readings, forces = np.empty(len(commands)), np.empty(len(commands))
    for tick, command in enumerate(commands.tolist()):
        read = position + noise[tick]
        readings[tick] = round(read / resolution) * resolution if resolution else read
        forces[tick] = command - spring_N_m * readings[tick]
        coming.append(forces[tick])
        position, velocity = moved(device, position, velocity, coming.popleft(), part)
        position, velocity = moved(device, position, velocity, coming[0], step - part)
    channels = {"input": Channel(1e3 * readings, "position", "mm"), "output": Channel(forces, "force", "N")}
    return Record("device", step * np.arange(len(commands)), channels, source="synthetic twin")


def device_recording(device: DeviceSettings, noise_um: float = 0.0, seed: int = 0) -> Record:
    """Record `pushes` and `chirp`, each at the largest amplitude of up to 5 N at which the stylus stays within its travel."""
    commands, coarse = [], replace(device, rate_Hz=_COARSE_HZ)
    for shape in (pushes, chirp):
        amplitude = _MOTOR_N
        while np.abs(play(coarse, amplitude * shape(_COARSE_HZ))["input"]).max() > TRAVEL_MM:
            amplitude *= 0.85
        commands.append(amplitude * shape(device.rate_Hz))
    return play(device, np.concatenate(commands), noise_um=noise_um, seed=seed)


def write_example(path: str | os.PathLike) -> None:
    """Write the recording of `docs/tissue/haptic_runtime.md`: a stylus of 0.25 kg, 1.5 N·s/m, 0.2 N and 1.3 ms at 1 kHz."""
    device = DeviceSettings(mass_kg=0.25, damping_N_s_m=1.5, friction_N=0.2, delay_ms=1.3)
    record = device_recording(device, noise_um=5.0)
    rows = zip(record.time, record["output"], record["input"], strict=True)
    lines = [f"{time:.3f},{force:.6g},{position:.6g}\n" for time, force, position in rows]
    write_text(path, "".join(["time_s,force_N,position_mm\n", *lines]))
