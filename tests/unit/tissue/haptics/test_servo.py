"""A servo of any rate: as ``tissue_force.h`` does it, against that header, time simulations and closed forms."""

import ctypes
from dataclasses import replace

import numpy as np
import pytest
from c_programs import ON_LINUX, zig_cc
from runtime_models import unzipped
from scipy.linalg import eigh
from scipy.signal import lfilter
from tissue_fits import fitted

from lumbar.base.errors import InputError
from lumbar.settings.runtime import DeviceSettings, RuntimeSettings
from lumbar.tissue.fmu.build.compiler import TARGETS
from lumbar.tissue.fmu.instance import UnzippedFmu
from lumbar.tissue.haptics.closed_loop import SampledModel, largest_stable_gain
from lumbar.tissue.haptics.loop_verdict import analyse
from lumbar.tissue.haptics.rendered_model import export_at, render_model, stepping
from lumbar.tissue.haptics.simulation import (
    HandPush,
    TissueForce,
    difference_equation,
    encoder_ripple,
    simulate,
)
from lumbar.tissue.haptics.ticks import PeriodicModel, decimate_to_ticks, realisation, required_damping
from running import PROJECT

STYLUS = RuntimeSettings().device
LIBRARY = """
#include "tissue_force.h"
void *loader_open(const char *folder) {
    tissue_force *tissue = malloc(sizeof *tissue);
    return tissue_force_open(tissue, folder, NULL, NULL) ? tissue : NULL;
}
double loader_step(void *tissue, double time, double position) {
    double force = 0.0;
    return tissue_force_step(tissue, time, position, &force) ? force : NAN;
}
void loader_close(void *tissue) { tissue_force_close(tissue); free(tissue); }
"""


def drawn_device(rng: np.random.Generator) -> DeviceSettings:
    """A stylus and a hand; the servo is as fast as the model."""
    return DeviceSettings(
        mass_kg=float(rng.uniform(0.05, 1.0)),
        damping_N_s_m=float(np.exp(rng.uniform(np.log(0.5), np.log(20.0)))),
        hand_stiffness_N_m=float(np.exp(rng.uniform(np.log(50.0), np.log(2000.0)))),
        hand_damping_N_s_m=float(rng.uniform(0.0, 5.0)),
        hand_mass_kg=float(rng.choice([0.0, rng.uniform(0.0, 0.5)])),
        encoder_um=float(rng.choice([1.0, 10.0, 50.0])),
    )


def drawn_model(rng: np.random.Generator) -> SampledModel:
    """A stable model of order 0 to 4 with average and delay, soft to stiff."""
    order = int(rng.integers(0, 5))
    poles = rng.uniform(-0.5, 0.97, order).astype(complex)
    if order >= 2 and rng.random() < 0.3:
        poles[:2] = rng.uniform(0.2, 0.9) * np.exp(np.array([1j, -1j]) * rng.uniform(0.1, 3.0))
    denominator = np.atleast_1d(np.real(np.poly(poles)))
    zeros = rng.uniform(-0.8, 1.0, int(rng.integers(0, order + 1)))
    numerator = np.convolve(np.poly(zeros), np.ones(average := int(rng.integers(1, 5))) / average)
    numerator = np.concatenate([np.zeros(int(rng.integers(0, 2))), np.atleast_1d(numerator)])
    period = float(1.0 / np.exp(rng.uniform(np.log(50.0), np.log(2000.0))))
    stiffness = np.exp(rng.uniform(np.log(0.02), np.log(3.0))) / period  # needs a damping of about 1 N·s/m
    model = SampledModel("drawn", numerator, denominator, period)
    size = np.abs(model.response(np.linspace(0.01, np.pi, 200))).max()
    return scaled(model, stiffness / size).late(float(rng.choice([0.0, rng.uniform(0.0, 1.5) * period])))


def scaled(model: SampledModel, factor: float) -> SampledModel:
    return replace(model, numerator=factor * model.numerator)


def growth(model: SampledModel, intervals, device, delay: float = 0.0, seconds: float = 4.0) -> float:
    """By how much the force moves more in the second half of a time than in the first, behind the push."""
    tick = TissueForce(difference_equation(model), model.sampling_time)
    exact = device.model_copy(update={"encoder_um": 0.0, "delay_ms": 1e3 * delay})
    run = simulate(tick, intervals, exact, np.inf, HandPush(duration_s=0.3 + seconds))
    moving = run.samples[-int(seconds / np.mean(intervals)) :]
    first, second = np.array_split(np.diff(moving), 2)
    return float(np.ptp(second) / np.ptp(first))


@pytest.fixture(scope="module")
def header(zig_cache, tmp_path_factory):
    """Return the loader of the examples, compiled as a library."""
    folder = tmp_path_factory.mktemp("loader")
    (folder / "loader.c").write_text(LIBRARY)
    options = "-std=c99 -O2 -fno-sanitize=undefined -shared -fPIC loader.c -ldl -lm -o loader.so"
    target, include = TARGETS["x86_64-linux"].triple, str(PROJECT / "examples" / "haptic_runtime")
    zig_cc(["-target", target, "-I", include, *options.split()], folder, zig_cache)
    library = ctypes.CDLL(str(folder / "loader.so"))
    library.loader_open.restype, library.loader_open.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
    library.loader_step.restype = ctypes.c_double
    library.loader_step.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_double]
    library.loader_close.argtypes = [ctypes.c_void_p]
    return library


def random_intervals(low: float, high: float) -> np.ndarray:
    return np.random.default_rng(4).uniform(low, high, 400)


@ON_LINUX
@pytest.mark.parametrize(
    "intervals",
    [
        *([1 / rate] for rate in (100, 1000, 50, 30, 150)),
        random_intervals(0.001, 0.03),
        random_intervals(0.0098, 0.0102),
    ],
    ids=["equal", "ten times faster", "half", "a third and more", "faster", "uneven", "nearly equal"],
)
def test_header_and_its_rule_give_equal_forces(intervals, header, fmu_folder, fmu_models, tmp_path):
    folder = unzipped(fmu_folder / "KB_fmi3.fmu", tmp_path / "fmu")
    device = STYLUS.model_copy(update={"damping_N_s_m": 40.0, "encoder_um": 0.0, "delay_ms": 0.3})
    rendered = render_model(next(model for model in fmu_models if model.name == "KB"), device)
    with stepping(UnzippedFmu(folder)) as step:
        rule = TissueForce(rendered.loop_step(step), rendered.sampled[0].sampling_time)
        expected = simulate(rule, intervals, device, 15.0, HandPush(duration_s=1.0))
    tissue = header.loader_open(str(folder).encode())
    start = 1234.5

    def tick(time: float, position: float) -> float:
        return rendered.loop_step(lambda given: header.loader_step(tissue, start + time, given))(position)

    result = simulate(tick, intervals, device, 15.0, HandPush(duration_s=1.0))
    header.loader_close(tissue)
    assert np.ptp(expected.samples) > 1.0
    np.testing.assert_allclose(result.samples, expected.samples, atol=1e-9)


def judged(rate: float, **device):
    """Kelvin–Boltzmann of the default study at 1 kHz on a servo of this rate."""
    device = STYLUS.model_copy(update={"rate_Hz": rate, **device})
    return render_model(export_at(fitted("KB"), RuntimeSettings(), 1000.0), device), device


@pytest.mark.parametrize(
    ("rate", "gain"), [(500.0, 1.961), (250.0, 1.378), (200.0, 1.195), (300.0, 1.360), (1500.0, 2.336)]
)
def test_servo_of_another_rate_is_judged_like_the_loader(rate, gain):
    """Against the loop in time through the loader's rule, which dies away below the gain and grows above."""
    rendered, device = judged(rate)
    assert analyse(rendered, device).gain == pytest.approx(gain, abs=6e-4)
    assert growth(scaled(rendered.sampled[0], 0.99 * gain), [1 / rate], device) < 1.0
    assert growth(scaled(rendered.sampled[0], 1.01 * gain), [1 / rate], device) > 1.0


def drawn_sequence(seed: int, ticks: int) -> tuple[PeriodicModel, DeviceSettings]:
    """A drawn model on ticks that repeat, delays of several of them included."""
    rng = np.random.default_rng([seed, 5])
    model, device = replace(drawn_model(rng), delay=0.0), drawn_device(rng)
    intervals = rng.dirichlet(np.full(ticks, 4.0)) * rng.integers(1, 2 * ticks) * model.sampling_time
    return PeriodicModel(
        model, tuple(intervals), delay=float(rng.uniform(0.0, 2.0) * model.sampling_time)
    ), device


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.nightly) for seed in range(2, 8))]
)
def test_ticks_that_repeat_are_stable_up_to_the_gain_and_not_above(seed):
    """In time through the loader's rule, for as long as the largest pole needs to double or halve a motion ten times."""
    loop, device = drawn_sequence(seed, 3)
    limit = loop.largest_stable_gain(device)
    assert 0 < limit.frequency <= 0.5 / loop.sampling_time
    for share in (0.7, 1.4):
        growing = np.log(loop.transitions(device).radius(share * limit.gain))
        assert (growing > 0) == (share > 1)
        seconds = 10 * np.log(2) / abs(growing) * sum(loop.intervals)
        model = scaled(loop.model, share * limit.gain)
        assert (growth(model, loop.intervals, device, loop.delay, seconds) > 1) == (share > 1)


@pytest.mark.parametrize(("ticks", "samples"), [(3, 3), (3, 1)])
@pytest.mark.parametrize("seed", range(8))
def test_equal_ticks_agree_with_the_exact_analysis(seed, ticks, samples):
    """Three written out for one, as fast as the model and faster: gain, frequency, damping and what an encoder keeps up."""
    rng = np.random.default_rng([seed, 3])
    model, device = drawn_model(rng), drawn_device(rng)
    intervals = (model.sampling_time * samples / ticks,) * ticks
    loop = PeriodicModel(replace(model, delay=0.0), intervals, delay=model.delay)
    result, expected = loop.largest_stable_gain(device), largest_stable_gain(model, device)
    assert result.gain == pytest.approx(expected.gain, rel=1e-6)
    assert result.frequency == pytest.approx(expected.frequency, rel=1e-6)
    needed = required_damping(model)
    assert required_damping(loop) == pytest.approx(needed, rel=1e-4, abs=1e-9)
    if result.gain > 1:
        assert encoder_ripple(loop, device) == pytest.approx(encoder_ripple(model, device), rel=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_no_motion_takes_energy_above_the_damping_and_one_does_below(seed):
    """Compare the largest gain of all moves over many periods with the damping that the condition requires."""
    loop, _ = drawn_sequence(seed, 2)
    needed = required_damping(loop)
    ticks = 120
    pieces = [(tick, *part) for tick in range(ticks) for part in loop.acting[tick % 2]]
    times = np.cumsum([0.0, *loop.intervals * (ticks // 2)])[:-1]
    given = np.zeros((len(pieces), len(pieces)))
    for move, (moved_at, _, _) in enumerate(pieces):
        tick = TissueForce(difference_equation(loop.model), loop.model.sampling_time)
        forces = [tick(time, float(number > moved_at)) for number, time in enumerate(times)]
        given[:, move] = [-forces[number - age] if number >= age else 0.0 for number, age, _ in pieces]
    damping = np.diag([1.0 / seconds for _, _, seconds in pieces])
    most = eigh((given + given.T) / 2.0, damping, eigvals_only=True)[-1]
    assert 0.9 * needed < most <= needed * (1 + 1e-9)


@pytest.mark.parametrize("samples", [2, 3, 8])
@pytest.mark.parametrize("seed", range(4))
def test_servo_slower_by_a_whole_factor_is_a_decimated_model(seed, samples):
    """Forces of random ticks: on straight lines, and where the position waits, each sample written out."""
    rng = np.random.default_rng([seed, 6])
    model = replace(drawn_model(rng), delay=0.0)
    ticks = np.concatenate([[0.0], rng.standard_normal(50)])
    slow, waits = (decimate_to_ticks(model, samples, held) for held in (False, True))
    lines = np.interp(np.arange(samples * 50 + 1) / samples, np.arange(51), ticks)
    for result, positions in ((slow, lines), (waits, np.repeat(ticks, samples))):
        expected = lfilter(model.numerator, model.denominator, positions)[::samples]
        forces = lfilter(result.numerator, result.denominator, ticks)
        np.testing.assert_allclose(forces, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
        assert result.sampling_time == pytest.approx(samples * model.sampling_time)


def test_long_impulse_response_has_the_states_of_its_source():
    impulse = lfilter([2.0, -1.9, 0.1], [1.0, -1.94, 0.9408], np.eye(1, 4000)[0])
    result = realisation(SampledModel("", impulse, np.ones(1), 0.001))
    np.testing.assert_allclose(sorted(np.linalg.eigvals(result.a)), [0.96, 0.98], atol=1e-9)
    np.testing.assert_allclose(
        [result.d, result.c @ result.b, result.c @ result.a @ result.b], impulse[:3], atol=1e-9
    )
    average = SampledModel("", np.full(200, 0.005), np.ones(1), 0.001)
    assert len(realisation(average).a) == 199


def test_rates_without_a_common_period_are_judged_at_the_worst_phase():
    """Every place of the first tick among the samples, as each lasts long: worse than three samples locked to a tick."""
    locked, drifting = judged(1000.0 / 3.0), judged(333.333)
    assert len(drifting[0].loops) > 1
    assert analyse(*locked).gain == pytest.approx(1.620, abs=1e-3)
    assert analyse(*drifting).gain == pytest.approx(1.138, abs=1e-3)


def test_too_slow_servo_is_rejected():
    with pytest.raises(InputError, match=r"runtime\.device: .*\b3 Hz.*0\.333 s.*0\.25 s"):
        judged(3.0)
