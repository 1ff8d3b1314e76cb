"""A device from its stylus in the air: intervals that hold the truth, and what is refused."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import lumbar
from lumbar.base.errors import InputError
from lumbar.records.record import Channel, Record
from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.haptics.device_identification.free_motion import MARGIN, Stretches, cut, free_motion
from lumbar.tissue.haptics.device_identification.identification import identify
from lumbar.twin.device_recordings import chirp, device_recording, play, pushes, write_example

DEVICE = DeviceSettings(mass_kg=0.25, damping_N_s_m=1.5, friction_N=0.2, delay_ms=1.3, rate_Hz=500)
PAGE = Path(__file__).parents[4] / "docs" / "tissue" / "haptic_runtime.md"
TRUTH = {"mass": "mass_kg", "damping": "damping_N_s_m", "friction": "friction_N", "delay": "delay_ms"}


@pytest.fixture(scope="module")
def recording():
    return device_recording(DEVICE)


def test_a_spring_and_a_constant_force_act_as_integrated():
    stretches = Stretches(1e-3, np.full(300, 0.5), np.full(300, 0.02), np.array([5]), 200)
    parameters = np.array([[0.25], [1.5], [0.0], [0.0], [0.3], [40.0]])
    ways = free_motion(stretches, parameters, np.full((1, 1), -0.1))[:, 0, 0]

    def motion(_, state):
        return [state[1], (0.8 - 1.5 * state[1] - 40.0 * state[0]) / 0.25]

    exact = solve_ivp(motion, (0, 0.2), [0.02, -0.1], t_eval=1e-3 * np.arange(200), rtol=1e-10, atol=1e-13).y[
        0
    ]
    np.testing.assert_allclose(ways, exact - 0.02, atol=2e-7)


def drawn(seed: int) -> tuple[DeviceSettings, float]:
    """A device of the ranges that haptic devices have, and the noise of its encoder in µm; some without friction or delay."""
    rng = np.random.default_rng([2603, seed])
    mass, damping = np.exp(rng.uniform(np.log([0.05, 0.1]), np.log([1.0, 10.0])))
    friction, delay, encoder = rng.uniform(0.0, [1.0, 3.0, 30.0])
    noise = rng.uniform(0.0, 5.0) if seed % 3 == 0 else 0.0
    return DeviceSettings(
        mass_kg=float(mass),
        damping_N_s_m=float(damping),
        friction_N=0.0 if seed % 10 == 0 else float(friction),
        delay_ms=0.0 if seed % 10 == 1 else float(delay),
        encoder_um=0.0 if seed % 10 == 2 else float(encoder),
        rate_Hz=float(np.round(np.exp(rng.uniform(np.log(500.0), np.log(4000.0))))),
    ), float(noise)


def held(device: DeviceSettings, found) -> list[bool]:
    """Whether the interval of each number holds it."""
    return [
        getattr(found, name).low <= getattr(device, key) <= getattr(found, name).high
        for name, key in TRUTH.items()
    ]


@pytest.mark.statistical
def test_of_200_devices_each_number_lies_in_its_interval_as_often_as_it_says():
    """Identified from pushes and a chirp: masses of 0.05 to 1 kg, 0.1 to 10 N·s/m, 0 to 1 N, 0 to 3 ms, encoders of 0 to 30 µm
    with and without noise, 500 to 4000 Hz. None may be refused."""
    inside = []
    for seed in range(200):
        device, noise = drawn(seed)
        inside.append(held(device, identify(device_recording(device, noise_um=noise, seed=seed))))
    counts = dict(zip(TRUTH, np.sum(inside, axis=0).tolist(), strict=True))
    print(counts)
    assert min(counts.values()) >= 186, counts


def test_rows_that_are_missing_only_part_the_recording(recording):
    gapped = replace(recording, filled=(1500, 1501)).between(0.0, 6.0)
    found = identify(gapped)
    assert abs(found.mass.value - 0.25) < 2e-4 and found.rate_Hz == pytest.approx(500.0)
    ticks = cut(gapped).ticks
    assert not np.isin([1500, 1501], ticks).any()
    # No force from before the gap is taken for one of after it.
    assert ticks[ticks > 1501].min() - 1501 >= MARGIN


def test_a_motion_that_repeats_itself_is_told_once():
    """Five seconds of one sine: an encoder errs alike in each period."""
    time = np.arange(5000) / 1000
    found = identify(play(replace(DEVICE, rate_Hz=1000), 1.5 * np.sin(2 * np.pi * 5 * time)))
    assert all(held(DEVICE, found))


def pushed(commands, extra, sub=8):
    """Play commands on the device with a force (position, velocity) besides, in fine steps in which friction stops it at best."""
    step = 1.0 / DEVICE.rate_Hz / sub
    inertia = DEVICE.mass_kg / step + DEVICE.damping_N_s_m
    late = round(1e-3 * DEVICE.delay_ms / step)
    position = velocity = 0.0
    readings, acting = np.empty(len(commands)), np.concatenate([np.zeros(late), np.repeat(commands, sub)])
    for tick in range(len(commands) * sub):
        if tick % sub == 0:
            readings[tick // sub] = round(position / 3e-5) * 3e-2
        drive = DEVICE.mass_kg / step * velocity + acting[tick] + extra(position, velocity)
        velocity = np.sign(drive) * max(abs(drive) - DEVICE.friction_N, 0.0) / inertia
        position += step * velocity
    channels = {"input": Channel(readings, "position", "mm"), "output": Channel(commands, "force", "N")}
    return Record("pushed", np.arange(len(commands)) / DEVICE.rate_Hz, channels)


COMMANDS = 2.5 * np.concatenate([pushes(500)[:1500], chirp(500)[:1500]])


@pytest.mark.nightly
def test_what_the_equation_does_not_give_is_said_beside_the_intervals():
    found = identify(pushed(COMMANDS, lambda position, _: 0.05 * np.sin(position / 1e-3)))
    assert 0.002 < found.unexplained < 0.05
    assert "the intervals do not hold what follows from that; possible causes" in str(found)


@pytest.mark.parametrize(
    ("extra", "told"),
    [
        (
            lambda position, velocity: -40.0 * position - 2.0 * velocity,
            r"a spring of 4\d(\.\d)? N/m .* nobody may hold it",
        ),
        pytest.param(
            lambda position, _: 0.6 * np.sin(position / 1e-3),
            r"no mass with .* was found that moves so: .* possible causes: .*cogging",
            marks=pytest.mark.nightly,
        ),
    ],
    ids=["hand", "cogging"],
)
def test_a_motion_that_is_not_the_device_s_alone_is_refused(extra, told):
    with pytest.raises(InputError, match=told):
        identify(pushed(COMMANDS, extra))


def sine(amplitude: float, frequency: float, **device) -> Record:
    time = np.arange(3000) / 500
    return play(replace(DEVICE, **device), amplitude * np.sin(2 * np.pi * frequency * time))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda record: record.between(0.0, 0.5), "at least 0.91 s without a gap are needed"),
        (
            lambda record: record.with_values(output=-record["output"]).between(0.0, 4.0),
            "moves as if every force were turned round",
        ),
        (
            lambda record: record.with_values(output=np.roll(record["output"], 2)).between(0.0, 6.0),
            "before they are commanded",
        ),
        (lambda _: sine(0.15, 5.0), "moves over 0 steps of its encoder"),
        (lambda _: sine(0.5, 0.5, friction_N=0.0, damping_N_s_m=10.0), "mass: not told: "),
        (lambda record: replace(record, channels={"input": record.channels["input"]}), "output in none"),
    ],
    ids=["too short", "sign", "later row", "stuck", "too slow", "no force"],
)
def test_what_a_recording_does_not_tell_is_said_and_no_number_is_given(recording, change, told):
    with pytest.raises(InputError, match=told):
        identify(change(recording))


def test_friction_is_not_told_from_damping_where_all_sliding_has_one_speed():
    """A slow slide to either side, for a second each, on a coarse encoder."""
    commands = 0.23 * np.where(np.arange(5000) // 500 % 2, 1.0, -1.0)
    device = replace(DEVICE, mass_kg=0.05, encoder_um=200)
    with pytest.raises(
        InputError, match="damping: not told: in this motion another friction makes up for it"
    ) as told:
        identify(play(device, commands, spring_N_m=0.0))
    assert "of the motion is left" not in str(told.value)


def test_what_a_coarse_encoder_hides_of_a_motion_that_repeats_itself_is_no_other_law():
    commands = 0.4 * np.sign(np.sin(2 * np.pi * 2.0 * np.arange(3000) / 500))
    device = replace(DEVICE, encoder_um=100)
    found = identify(play(device, commands))
    assert found.unexplained == 0.0 and all(held(device, found))


def test_the_command_writes_what_render_takes(run, tmp_path):
    write_example(tmp_path / "device.csv")
    lines = (tmp_path / "device.csv").read_text().splitlines(keepends=True)
    (tmp_path / "device.csv").write_text("".join(lines[:4000]))
    out = run.done("device", tmp_path / "device.csv", "--output", tmp_path / "device.yaml")
    loaded = lumbar.load_settings(tmp_path / "device.yaml").runtime.device
    for name, key in TRUTH.items():
        told = re.search(rf"^{name} +(\S+)", out, re.MULTILINE)[1]
        assert getattr(loaded, key) == pytest.approx(float(told), rel=1e-3)
        assert getattr(loaded, key) == pytest.approx(getattr(DEVICE, key), rel=0.02)
    assert (loaded.rate_Hz, loaded.encoder_um) == (1000.0, 30.0)


@pytest.mark.nightly
def test_the_page_shows_what_its_example_prints(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_example("recording.csv")
    assert str(lumbar.identify_device("recording.csv")) in PAGE.read_text()


def test_a_file_that_cannot_be_taken_leaves_nothing_behind(run, tmp_path):
    lines = ["time_s,force_N,position_mm", *(f"{tick / 1000},{tick % 7},{tick % 5}" for tick in range(1000))]
    lines[99] = lines[99].replace(",", ",x", 1)
    (tmp_path / "device.csv").write_text("\n".join(lines))
    assert "line 100" in run.refused("device", tmp_path / "device.csv", "--output", tmp_path / "device.yaml")
    assert not (tmp_path / "device.yaml").exists()
    (tmp_path / "other.csv").write_text("\n".join(lines[:50]))
    (tmp_path / "device.csv").write_text("\n".join(lines[:50]))
    status, _, err = run("device", tmp_path)
    assert status == 1 and "2 recordings; give the file of one" in err
