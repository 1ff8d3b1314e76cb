"""Rendering on a device: ``lumbar render``, exported models in its units, effects, FMUs, slower servos."""

import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from c_programs import ON_LINUX
from effect_entries import effect_entry, entry_of_effects
from runtime_models import SETTINGS, models_json
from scipy.signal import lfilter
from tissue_fits import fitted

import lumbar
from lumbar.base.errors import InputError, NumericalError
from lumbar.settings.runtime import RuntimeSettings
from lumbar.tissue.effects.catalogue import CATALOGUES, TISSUE
from lumbar.tissue.fmu.build.export_model import export_models
from lumbar.tissue.haptics.closed_loop import SampledModel, all_angles
from lumbar.tissue.haptics.device_table import judge_on_device
from lumbar.tissue.haptics.loop_verdict import analyse, judge_loop, judge_models, run_loop
from lumbar.tissue.haptics.rendered_model import export_at, render_model
from lumbar.tissue.haptics.z_width import _lowest, lowest_rates
from lumbar.tissue.models.fitted_model import read_models
from lumbar.tissue.models.model_data import MotionRange
from study_settings import changed

STYLUS = RuntimeSettings().device


@pytest.fixture
def models(tmp_path):
    path = tmp_path / "models.json"
    path.write_text(json.dumps(models_json()))
    return path


def test_the_command_says_what_happens_and_writes_table_and_figures(run, models, tmp_path):
    out = run.done(
        "render", models, "--model", "KB", "--hand", "300", "--damping", "5.5", "--output", tmp_path / "out"
    )
    assert "KB at 100 Hz: UNSTABLE (it needs 15.4" in out and "simulated, it oscillates at" in out
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written == {
        f"{stem}.{ending}"
        for stem, endings in (
            ("rendering", "csv tex html"),
            ("closed_loop", "svg pdf"),
            ("z_width", "svg pdf"),
        )
        for ending in endings.split()
    }


@pytest.mark.parametrize("option", ["--mass", "--damping", "--rate"])
def test_a_device_without_mass_damping_or_rate_is_refused(run, models, option):
    assert "a finite number above 0" in run.refused("render", models, "--model", "KB", option, "0")


def test_the_table_defines_its_columns_and_keeps_the_numbers(tmp_path):
    found = lumbar.render([fitted("KB"), fitted("IL")])
    frame = found.table.frame.set_index(["model", "rate_Hz"])
    assert frame.loc[("KB", 100.0), "damping_needed_N_s_m"] == found[0].analysis.damping
    assert frame.loc[("KB", 100.0), "stable"] == "NO"
    assert np.isnan(frame["oscillation_Hz"].to_numpy()[-1])
    found.save(tmp_path)
    assert "Colgate" not in (tmp_path / "rendering.csv").read_text()
    assert "Re{(1 − exp(−jωT)) H(exp(jωT))}" in (tmp_path / "rendering.html").read_text()


@ON_LINUX
def test_the_bound_of_the_fmu_calms_a_loop_that_the_analysis_calls_unstable(zig_cache):
    """Simulated with the library: half of the device's damping given to it, 30 N peak to peak become less than a step's."""
    given = changed(SETTINGS, device_damping=2.75, compiler_cache=str(zig_cache))
    bounded, free = (judge_models([fitted("KB")], settings)[0][0] for settings in (given, SETTINGS))
    assert not bounded.analysis.stable
    assert (free.run.peak_to_peak, free.run.oscillates) == (30.0, True)
    assert bounded.run.peak_to_peak < 0.05
    assert not bounded.run.oscillates


def test_export_refuses_what_is_unstable_where_the_study_says_so(capsys):
    (model,) = export_models([fitted("KB")], SETTINGS)
    with pytest.raises(NumericalError, match=r"runtime\.device\.unsafe: warn"):
        judge_on_device([model], changed(DEFAULTS, device={"unsafe": "refuse"}), [fitted("KB")])
    damped = changed(DEFAULTS, device={"damping_N_s_m": 40.0, "unsafe": "refuse"})
    assert judge_on_device([model], damped, [fitted("KB")])[0].on_device
    assert capsys.readouterr().err == ""


@ON_LINUX
@pytest.mark.parametrize(
    ("damping", "device", "safe"),
    [(2.75, {}, True), (5.5, {}, False), (2.75, {"delay_ms": 5.0}, False), (2.75, {"rate_Hz": 50.0}, False)],
    ids=["bounded", "swings without loss", "late", "slower servo"],
)
def test_a_bound_counts_where_forces_act_at_their_own_samples_and_the_loop_rests(
    damping, device, safe, zig_cache, capsys
):
    """With all of the device's damping it swings on by 1.2 N; behind a delay or on a slower servo by 30 N."""
    settings = changed(
        SETTINGS,
        models=["KB"],
        device_damping=damping,
        compiler_cache=str(zig_cache),
        device=device,
    )
    (model,) = export_models([fitted("KB")], settings)
    (told,) = judge_on_device([model], settings, [fitted("KB")])
    assert ("WARNING: not safe" in capsys.readouterr().err) == (not safe)
    assert any("keeps the device passive" in words for words in told.on_device) == (device == {})


@ON_LINUX
@pytest.mark.nightly
def test_export_of_a_file_of_passive_models(run, tmp_path, zig_cache):
    """From records to an FMU that is passive on the device: what `identify --passive` writes, `export` takes."""
    from lumbar.base.files import write_json
    from lumbar.tissue.models.fitted_model import models_document
    from lumbar.twin.examples import example_records

    records = example_records()
    training = max(records, key=len)
    found = lumbar.identify(records, training.name)
    fits = found.passive(records)
    assert str(fits).count("KB-passive") == 3
    frame = fits.table("drawn").frame
    assert (frame.loc[frame["fit"] != "free, ridge ARX", "vaf_cost"].dropna() > -0.01).all()
    assert (frame.loc[frame["fit"].str.startswith("passive"), "takes_energy"] == "yes").all()
    on_device = frame[frame["fit"] == "passive on the device at 1000Hz"]
    assert (on_device["damping_at_servo_rate_N_s_m"] <= 5.5).all()
    write_json(tmp_path / "passive_models.json", models_document(fits.passive, "drawn"))
    settings = tmp_path / "study.yaml"
    settings.write_text(
        f"runtime: {{rate_Hz: 1000, compiler_cache: {zig_cache}, device: {{unsafe: refuse}}}}",
        encoding="utf-8",
    )
    status, _, err = run(
        "export", tmp_path / "passive_models.json", "--model", "KB-passive-1000Hz", "--config", settings,
        "--output", tmp_path / "fmu",
    )  # fmt: skip
    assert status == 0, err
    assert "warning" not in err
    with zipfile.ZipFile(tmp_path / "fmu" / "KB-passive-1000Hz_fmi3.fmu") as archive:
        assert "passive in any hand" in archive.read("documentation/index.html").decode()


DEFAULTS = RuntimeSettings()


def analysed(name: str, rate: float, settings: RuntimeSettings = DEFAULTS, late: bool = False):
    return analyse(render_model(export_at(fitted(name), settings, rate), STYLUS, late=late), STYLUS)


@pytest.mark.parametrize(
    ("name", "damping", "gain"),
    [("MW", 13.05, 0.624), ("Maxwell", 26.63, 0.282), ("KB", 29.30, 0.303), ("HO", 108.0, 0.295)],
)
def test_at_100_Hz_no_model_is_stable_on_a_light_stylus(name, damping, gain):
    """As of 200 000 frequencies and 20 000 gains, each a product of polynomials written out."""
    found = analysed(name, 100.0)
    assert (found.damping, found.gain) == (pytest.approx(damping, rel=2e-3), pytest.approx(gain, rel=4e-3))
    assert not found.passive
    assert not found.stable


def test_a_client_that_reads_first_gets_the_feedthrough_late():
    """C x[k] + D u[k−1], not the whole force: that would be H/z, which asks for 45 N·s/m of Kelvin–Boltzmann."""
    model = export_at(fitted("KB"), DEFAULTS, 100.0)
    loop = render_model(model, STYLUS, late=True).loops[0]
    rng = np.random.default_rng(1)
    positions = np.concatenate([[0.0], rng.standard_normal(200)])
    averaged = np.convolve(positions, np.ones(3) / 3)[:201]
    expected = 1000 * model.dynamics.response(averaged, late=True)
    np.testing.assert_allclose(lfilter(loop.numerator, loop.denominator, positions), expected, atol=1e-9)
    assert analysed("KB", 100.0, late=True).damping == pytest.approx(25.09, rel=2e-3)
    whole = analyse(replace_loop(model, 0.01), STYLUS)
    assert whole.damping == pytest.approx(45.1, rel=2e-3)


def replace_loop(model, seconds: float):
    meets = render_model(model, STYLUS)
    return replace(meets, loops=(meets.loops[0].late(seconds),))


def test_units_change_nothing():
    model = fitted("KB", "cm")
    structure = replace(model.structure, numerator=tuple(10.0 * b for b in model.structure.numerator))
    found = render_model(export_at(replace(model, structure=structure), DEFAULTS, 100.0), STYLUS)
    expected = render_model(export_at(fitted("KB"), DEFAULTS, 100.0), STYLUS)
    np.testing.assert_allclose(found.loops[0].numerator, expected.loops[0].numerator, rtol=1e-12)


def test_an_angle_is_no_position_of_a_stylus():
    model = fitted("KB", "rad", "angle")
    with pytest.raises(InputError, match="angle in 'rad'"):
        render_model(export_at(model, DEFAULTS, 100.0), STYLUS)
    judgements, refused = judge_models([model], DEFAULTS)
    assert judgements == []
    assert "angle in 'rad'" in refused[0]


def test_the_inverted_model_is_judged_as_it_is_displayed():
    """Like the others, so that it draws the tool in: −125 N/m against a hand of 300 N/m, and of 100 N/m."""
    meets = render_model(export_at(fitted("IL"), DEFAULTS, 100.0), STYLUS)
    np.testing.assert_allclose(meets.loops[0].numerator, -125.0 / 3)
    held, loose = (
        analyse(meets, STYLUS.model_copy(update={"hand_stiffness_N_m": stiffness}))
        for stiffness in (300.0, 100.0)
    )
    assert held.gain == pytest.approx(2.4) and held.stable and not held.passive
    assert not loose.stable
    assert np.isinf(loose.damping) and loose.limit.frequency == 0.0
    run = run_loop(loose)
    assert run.runs_away and run.limit == 15.0


@ON_LINUX
def test_dry_friction_is_judged_by_its_slope_and_by_what_it_does(zig_cache):
    """0.8 N turn within 0.7 mm/s: 1.14 N·s/mm where it turns, of which a step of the encoder shows a fortieth."""
    settings = changed(SETTINGS, compiler_cache=str(zig_cache))
    model = read_models(models_json(effect_entry("KB", "coulomb_friction/coulomb")), CATALOGUES)[0]
    found = judge_loop(export_at(model, settings, 1000.0), settings)
    slopes = {loop.name.split("steps of ")[1]: loop.numerator[0] for loop in found.model.loops[:4]}
    base = analysed_spring(found.model)
    assert slopes["1e-06 mm"] - base == pytest.approx(1e3 * 0.8 / 0.7 * 1e3 / 3, rel=1e-3)
    assert found.analysis.gain < 0.3 and not found.stable


@pytest.mark.parametrize(
    ("form", "number", "damping"),
    [("hardening_stiffness/cubic", 0.2, 14.9), ("strain_softening/cubic", 0.02, np.inf)],
)
def test_what_is_calm_where_it_is_shallow_is_not_called_passive(form, number, damping):
    """Both are at 2 mm; deeper the one is steep, of which a hand that pushes by 20 mm is shaken, and the other gives way."""
    document = models_json(entry_of_effects("LE", {form: ([number], [])}, TISSUE))
    exported = export_at(read_models(document, CATALOGUES)[0], DEFAULTS, 1000.0)
    found = analyse(render_model(exported, STYLUS), STYLUS)
    assert found.damping == pytest.approx(damping, rel=0.01)
    assert not found.passive and not found.stable
    fitted_to = replace(exported.identified, valid_for=MotionRange(-1.5, 2.0, 10.0, 0.1, 5.0))
    known = analyse(render_model(replace(exported, identified=fitted_to), STYLUS), STYLUS)
    assert known.passive and known.model.reach == pytest.approx((-1.5, 2.0))


@ON_LINUX
def test_a_force_that_may_change_no_faster_is_not_called_passive(zig_cache):
    """The limit makes large forces late: thrown in, a stylus that has the damping that KB needs swings for ever."""
    held = changed(
        DEFAULTS,
        compiler_cache=str(zig_cache),
        output_rate_limit=30.0,
        device={"damping_N_s_m": 8.0},
    )
    free = changed(held, device={"hand_stiffness_N_m": 0.0})
    exported = export_models([fitted("KB")], held)[0]
    found = judge_loop(exported, held)
    assert found.analysis.damping < 8.0 and found.stable and not found.passive
    shaken = judge_loop(exported, free)
    assert shaken.analysis.stable and not shaken.stable
    assert lowest_rates(fitted("KB"), held)[0] is None


def test_a_force_that_changes_with_time_alone_is_not_called_passive():
    document = models_json(entry_of_effects("KB", {"drift/linear": ([0.01], [])}, TISSUE))
    exported = export_at(read_models(document, CATALOGUES)[0], DEFAULTS, 1000.0)
    damped = STYLUS.model_copy(update={"damping_N_s_m": 11.0})
    found = analyse(render_model(exported, damped), damped)
    assert found.stable and not found.passive and found.damping < 11.0 and found.model.omitted


def analysed_spring(meets) -> float:
    """What the base adds to the first value of each impulse response: its springs, over the average of three positions."""
    return 1e3 * (0.8 + 6.0) / 3


def test_the_worst_corner_of_the_hands_range_decides():
    """The inverted spring of −125 N/m is held by every hand that is stiffer, at any damping."""
    exported = export_at(fitted("IL"), DEFAULTS, 1000.0)
    loose = judge_loop(exported, DEFAULTS)
    assert loose.stable and not loose.safe
    assert (loose.worst_hand.stiffness, loose.worst_hand.stable) == (50.0, False)
    firm = changed(DEFAULTS, device={"hands_stiffness_N_m": (130.0, 1500.0)})
    held = judge_loop(exported, firm)
    assert held.safe and (held.worst_hand.stiffness, held.worst_hand.stable) == (130.0, True)


def test_a_passive_loop_is_safe_without_a_hand_too():
    """A free stylus keeps any position: the pole at 1 of this corner of the hand's range is not an instability."""
    settings = changed(DEFAULTS, device={"hands_stiffness_N_m": (0.0, 1500.0), "damping_N_s_m": 40.0})
    verdict = judge_loop(export_at(fitted("Maxwell"), settings, 1000.0), settings)
    assert verdict.passive and verdict.safe


def test_rates_above_the_lowest_safe_one_are_safe_too():
    """Not from 300 Hz on where what lies from 1200 to 1400 Hz is unsafe, between two of the rates that are tried first."""
    rates = [100.0 * 2**power for power in range(8)]
    found = _lowest(rates, lambda rate: rate > 300 and not 1200 < rate < 1400, between=True)
    assert found == pytest.approx(1400.0, rel=0.01)


def test_lowest_rates_are_where_damping_and_gain_suffice():
    passive, stable = lowest_rates(fitted("KB"), DEFAULTS)
    for rate, quantity, needed in ((passive, "damping", 5.5), (stable, "gain", 1.0)):
        at, below = (getattr(analysed_alone("KB", rate * share), quantity) for share in (1.0, 0.97))
        assert min(at, below) < needed < max(at, below) or at == pytest.approx(needed, rel=1e-3)
        assert (at <= needed) == (quantity == "damping")
    assert lowest_rates(fitted("IL"), DEFAULTS) == (None, 100.0)


def analysed_alone(name: str, rate: float):
    """On a servo that is as fast as the model."""
    device = STYLUS.model_copy(update={"rate_Hz": rate})
    return analyse(render_model(export_at(fitted(name), DEFAULTS, rate), device), device)


def test_a_model_that_is_held_answers_as_its_long_polynomials_do():
    """Over 40 steps between two samples of its own, behind a delay of 60: the powers of z⁻⁴⁰ alone are looked at."""
    short = np.array([1.0, -1.1, 0.5, -0.2])
    numerator, denominator = np.zeros(142), np.zeros(121)
    numerator[60:101:40], denominator[::40] = (2.0, -1.0), short
    model = SampledModel("held", numerator, denominator, 2.5e-4)
    back = np.exp(-1j * all_angles(50))
    expected = np.polyval(numerator[::-1], back) / np.polyval(denominator[::-1], back)
    np.testing.assert_allclose(model.response(all_angles(50)), expected, rtol=1e-10)
    assert model.stable and (np.abs(np.roots(denominator)) < 1).all()
    assert np.abs(np.roots(short)).max() == pytest.approx(np.abs(np.roots(denominator)).max() ** 40, rel=1e-3)
    denominator[::40] = 1.0, -2.1, 1.2, 0.0
    assert not SampledModel("held", numerator, denominator, 2.5e-4).stable
