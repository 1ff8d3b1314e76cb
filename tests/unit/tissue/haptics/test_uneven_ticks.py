"""Ticks that come early or late or are left out: the worst timing diverges in time, and what is proved to be stable does not."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_loops import drawn_device, drawn_model, growth, largest_pole
from tissue_fits import fitted

from lumbar.base.errors import InputError, NumericalError
from lumbar.settings.runtime import RuntimeSettings
from lumbar.tissue.haptics.closed_loop import largest_stable_gain
from lumbar.tissue.haptics.device_table import device_table, with_device
from lumbar.tissue.haptics.judgement import analyse, judge_exported
from lumbar.tissue.haptics.rendered_model import export_at, render_model
from lumbar.tissue.haptics.ticks.sequence import PeriodicModel
from lumbar.tissue.haptics.ticks.uneven import longest_wait, spans, worst_timing

DEFAULTS = RuntimeSettings()


def uneven(rate: float = 1000.0, **device) -> RuntimeSettings:
    """The default study's stylus with a servo of a rate in Hz."""
    return replace(DEFAULTS, device=replace(DEFAULTS.device, rate_Hz=rate, hands=0, **device))


def kelvin_boltzmann(settings: RuntimeSettings):
    """As exported at 1 kHz, on the device of the settings."""
    return render_model(export_at(fitted("KB"), settings, 1000.0), settings.device)


def test_ticks_that_jitter_drift_until_each_sample_is_a_whole_one_late():
    """The worst that a little jitter does to a servo as fast as the model; more of it is no worse."""
    for percent in (1.0, 20.0):
        settings = uneven(jitter_percent=percent)
        (found,) = kelvin_boltzmann(settings).timings
        late = kelvin_boltzmann(DEFAULTS).sampled[0].late(0.001)
        assert found.gain == pytest.approx(largest_stable_gain(late, settings.device)[0], rel=0.01)
        assert 1.3 < found.proved < found.gain


@pytest.mark.parametrize(
    ("rate", "more"),
    [
        (250.0, {"missed_ticks": 1}),
        (1000.0, {"jitter_percent": 10.0, "missed_ticks": 4}),
        (1000.0, {"jitter_percent": 10.0, "delay_ms": 1.7}),
    ],
)
def test_a_timing_that_is_said_to_be_unstable_diverges(rate, more):
    """In time, through the loader's rule, where even ticks let the same motion die away."""
    settings = uneven(rate, **more)
    device, rendered = settings.device, kelvin_boltzmann(settings)
    (found,) = rendered.timings
    assert found.gain < 1.0 < largest_stable_gain(rendered.loops[0], device)[0]
    lead = found.loop.age or sum(found.loop.intervals)
    for share, grows in ((1.0, True), (0.9 * found.gain, False)):
        model = rendered.sampled[0].scaled(share)
        ticks = [lead, *found.loop.intervals * 400]
        assert (growth(model, ticks, device, found.loop.delay, 3.0) > 1.0) == grows
    assert growth(rendered.sampled[0], [1 / rate], device, found.loop.delay, 3.0) < 1.0
    low, high = spans(device)[0][0], spans(device)[-1][1]
    assert all(low * 0.999 <= interval <= high * 1.001 for interval in found.loop.intervals)


def test_ticks_left_out_without_jitter_stay_where_ticks_come():
    """Every second one left out is a servo of half the rate, of which the exact analysis is known."""
    settings = uneven(missed_ticks=1)
    (found,) = kelvin_boltzmann(settings).timings
    half = kelvin_boltzmann(uneven(500.0))
    assert found.gain == pytest.approx(analyse(half, uneven(500.0).device).gain, rel=1e-6)
    assert longest_wait(half.sampled[0], settings.device) == pytest.approx(0.001)


def drawn_uneven(seed: int):
    """A drawn model on a drawn device whose servo is about as fast as it."""
    rng = np.random.default_rng([seed, 7])
    model = replace(drawn_model(rng), delay=0.0)
    device = replace(
        drawn_device(rng),
        rate_Hz=float(rng.choice([0.7, 1.0, 2.5])) / model.sampling_time,
        delay_ms=1e3 * model.sampling_time * float(rng.choice([0.0, 0.4, 1.3])),
        jitter_percent=float(rng.choice([0.0, 5.0, 20.0])),
        missed_ticks=int(rng.integers(0, 2)),
    )
    return model, device


def random_ticks(model, device, seed: int) -> PeriodicModel:
    """Ticks drawn within their spans, again and again, on a whole number of samples."""
    rng = np.random.default_rng([seed, 8])
    left_out = rng.integers(0, device.missed_ticks + 1, 200)
    left_out = np.r_[
        left_out, np.zeros(-(len(left_out) + left_out.sum()) % 35, int)
    ]  # a multiple of all the rates' periods
    low, high = np.array(spans(device))[left_out].T
    ticks = low + rng.uniform(0.01, 0.99, len(low)) * (high - low)
    ticks *= round(ticks.sum() / model.sampling_time) * model.sampling_time / ticks.sum()
    return PeriodicModel(model, tuple(ticks), delay=1e-3 * device.delay_ms)


def contradictions(seeds) -> list[int]:
    """Seeds of loops that are proved to be stable up to a gain, and are not below it with the worst ticks or with drawn ones."""
    wrong = []
    for seed in seeds:
        model, device = drawn_uneven(seed)
        found = worst_timing(model, device)
        drawn = random_ticks(model, device, seed)
        growing = found.proved and abs(largest_pole(drawn, device, 0.999 * found.proved)) >= 1.0
        if found.proved > found.gain or growing:
            wrong.append(seed)
    return wrong


def test_what_is_proved_to_be_stable_is_in_no_timing_found_unstable():
    assert contradictions(range(6)) == []


@pytest.mark.statistical
def test_no_proof_of_many_is_contradicted():
    """200 drawn loops, servos slower and faster than the model, delays, jitter and ticks left out."""
    assert contradictions(range(100, 300)) == []


def test_the_verdict_is_that_of_the_worst_timing_everywhere(capsys):
    """Analysis, table, page and refusal; a loop that even ticks leave stable."""
    settings = uneven(jitter_percent=10.0, missed_ticks=4, unsafe="refuse")
    model = export_at(fitted("KB"), settings, 1000.0)
    fast = judge_exported(model, settings)
    assert fast.analysis.even_gain > 1.0 > fast.analysis.gain
    assert "UNSTABLE where ticks are uneven" in fast.finding
    assert not fast.run.calm
    table = device_table([fast], [], settings, "drawn")
    assert (table.frame["proved_gain"] <= table.frame["largest_stable_gain"]).all()
    assert "ticks up to 10 % early or late, up to 4 in a row left out" in table.notes[0]
    with pytest.raises(NumericalError, match="UNSTABLE where ticks are uneven"):
        with_device([model], settings, [fitted("KB")])
    little = uneven(jitter_percent=2.0)
    told = with_device([model], little, [fitted("KB")])[0]
    assert "stable in this hand whenever ticks come" in " ".join(told.on_device)
    between = analyse(kelvin_boltzmann(uneven(jitter_percent=10.0, missed_ticks=1)), little.device)
    assert "which is no proof" in between.finding
    assert capsys.readouterr().err == ""


def test_gaps_that_the_loader_refuses_are_refused():
    with pytest.raises(InputError, match=r"up to 0\.42 s apart"):
        kelvin_boltzmann(uneven(50.0, missed_ticks=20))
