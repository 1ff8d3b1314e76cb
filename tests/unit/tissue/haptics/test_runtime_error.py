"""Files that run as the thesis's simulator did, against its loop written out; what a runtime's steps cost, in closed form."""

from dataclasses import replace

import fmpy
import numpy as np
import pytest
from c_programs import ON_LINUX
from effect_entries import effect_entry
from periodic_records import record
from runtime_models import TARGET, about, entry, models_json, selected
from tissue_fits import fitted

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.settings.runtime import RuntimeSettings
from lumbar.tissue.fmu.build.export_model import find_models
from lumbar.tissue.fmu.build.package import export_fmus
from lumbar.tissue.haptics.judgement import judge
from lumbar.tissue.haptics.runtime_error import runtime_error_table
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.transfer_function import TransferFunction
from lumbar.tissue.perception.thresholds import Hands

STEP = 0.01
ORDER_3 = ([0.0, 21.0, -40.0, 19.6], [1.0, -0.4, 0.2, -0.05])


def thesis_loop(numerator, denominator, position, rest, rest_force):
    """Eqs 3.17 and 3.18 in controllable form, the mean of the three positions before, and the device's 15 N."""
    order = len(denominator) - 1
    a, b = np.eye(order, k=-1), np.zeros(order)
    a[0], b[0] = -np.array(denominator[1:]), 1.0
    d = numerator[0]
    c = np.array(numerator[1:]) - d * np.array(denominator[1:])
    state, forces = np.zeros(order), []
    measured = [rest] * 3
    for now in position:
        u = np.mean(measured[-3:]) - rest
        forces.append(np.clip(c @ state + d * u + rest_force, -15.0, 15.0))
        state = a @ state + b * u
        measured.append(now)
    return np.array(forces)


@ON_LINUX
@pytest.mark.parametrize("version", ["2", "3"])
@pytest.mark.parametrize("numbers", [([1.9, -1.2], [1.0, -0.45]), ORDER_3], ids=["KB", "HO"])
def test_an_independent_importer_reads_the_forces_of_the_thesiss_loop(numbers, version, tmp_path, zig_cache):
    content = models_json(entry("KB", *numbers, **about(0.3, -0.2)))
    models = selected(content, RuntimeSettings(models=("KB-thesis",)))
    export_fmus(models, tmp_path, "synthetic twin", TARGET, zig_cache)
    time = np.arange(300) * STEP
    signal = np.zeros(300, dtype=[("time", float), ("position", float)])
    signal["time"], signal["position"] = time, 0.3 + 25 * np.sin(5 * time) + np.sin(40 * time)
    played = fmpy.simulate_fmu(
        str(tmp_path / f"KB-thesis_fmi{version}.fmu"),
        stop_time=time[-1],
        output_interval=STEP,
        input=signal,
        output=["force"],
        use_event_mode=version == "3",
    )
    # Of the values at one instant the last, after the event, counts.
    read = dict(zip(np.rint(played["time"] / STEP).astype(int), played["force"], strict=True))
    expected = thesis_loop(*numbers, signal["position"], 0.3, -0.2)
    assert np.abs(expected).max() == 15.0
    np.testing.assert_allclose([read[k] for k in range(300)], expected, atol=1e-10)


def test_its_file_says_so_whatever_the_settings_are():
    settings = RuntimeSettings(models=("KB-thesis",), rate_Hz=2000.0, contact=True, output_limit=40.0)
    (model,) = selected(models_json(), settings)
    assert (model.sampling_time, model.moving_average, model.output_limit) == (STEP, 3, 15.0)
    assert not model.guards.contact
    assert "at 100 Hz, on the mean of the three samples before the newest, within 15 N" in model.runtime


@pytest.mark.parametrize(
    ("unit", "limit", "expected"), [("mN", 2e4, 15e3), ("N", 3.0, 3.0), ("N m", 40.0, 40.0)]
)
def test_its_limit_is_a_force_that_the_device_may_receive(unit, limit, expected):
    content = models_json(entry("KB", [1.9, -1.2], [1.0, -0.45]))
    content["models"][0]["output"]["unit"] = unit
    settings = RuntimeSettings(models=("KB-thesis",), output_limit=limit)
    assert selected(content, settings)[0].output_limit == pytest.approx(expected)


def test_the_thesis_ran_transfer_functions_alone():
    content = models_json(effect_entry("KB", "coulomb_friction/coulomb"))
    with pytest.raises(InputError, match="XX-thesis: no such model"):
        selected(content, RuntimeSettings(models=("XX-thesis",)))
    with pytest.raises(InputError, match=r"friction-thesis: no transfer function.*take it without -thesis"):
        selected(content, RuntimeSettings(models=("KB+coulomb_friction-thesis",)))


def arx(model: FittedModel) -> FittedModel:
    return replace(model, estimator="arx")


def test_on_the_device_it_has_one_rate_and_needs_more_damping_than_with_the_newest_position():
    models = find_models([arx(fitted("KB"))], RuntimeSettings(models=("KB", "KB-thesis")))
    found, _ = judge(models, RuntimeSettings())
    assert [(item.analysis.name, item.analysis.rate) for item in found] == [
        ("KB", 100.0),
        ("KB", 1000.0),
        ("KB-thesis", 100.0),
    ]
    newest, _, thesis = (item.analysis for item in found)
    assert thesis.damping > newest.damping
    assert thesis.gain < newest.gain


SPRING, SPEED, NOISE = 2.0, 30.0, 0.037
"""N/mm, mm/s and N."""


def ramp(samples: int) -> Record:
    """A push at constant speed into a spring, measured with an error of constant size."""
    position = SPEED * STEP * np.arange(samples)
    force = SPRING * position + NOISE * (-1.0) ** np.arange(samples)
    return record(position, force)


def costs(samples: int, **settings) -> dict[str, dict]:
    spring = replace(arx(fitted("KB")), name="LE", structure=TransferFunction((SPRING,), (1.0,)))
    chosen = RuntimeSettings(models=("LE", "LE-thesis"), **settings)
    table = runtime_error_table(
        find_models([spring], chosen), ramp(samples), chosen, 0.05, Hands.of(), "synthetic twin"
    )
    return {row["model"]: row for row in table.frame.to_dict("records")}


def test_each_step_costs_a_spring_its_lateness_times_the_rate_of_the_force():
    found = costs(21)
    rate = SPRING * SPEED
    for name, lag, average, late in (("LE", 0.001, 0.001, 0.0), ("LE-thesis", 0.02, 0.01, 0.01)):
        row = found[name]
        assert row["lag_ms"] == pytest.approx(1e3 * lag)
        assert row["fit_error"] == pytest.approx(NOISE)
        assert (row["sampling"], row["limit"]) == (0.0, 0.0)
        assert row["average"] == pytest.approx(rate * average, abs=1e-6)
        assert row["late_sample"] == pytest.approx(rate * late, abs=1e-6)
        assert row["all"] == pytest.approx(rate * lag, abs=1e-6)
        # The error of measurement alternates: over an even number of samples it adds in squares.
        assert row["file_error"] == pytest.approx(np.hypot(NOISE, rate * lag), abs=1e-6)
    assert found["LE"]["file_error_fmi2"] == pytest.approx(np.hypot(NOISE, rate * 0.002), abs=1e-6)
    assert found["LE-thesis"]["file_error_fmi2"] == found["LE-thesis"]["file_error"]


def test_the_limit_costs_what_it_takes_from_the_largest_forces():
    found = costs(60)["LE-thesis"]
    position = SPEED * STEP * (np.arange(60) - 2)
    beyond = np.maximum(SPRING * position - 15.0, 0.0)[5:]
    assert beyond.max() > 1.0
    assert found["limit"] == pytest.approx(np.sqrt(np.mean(beyond**2)), abs=1e-6)
