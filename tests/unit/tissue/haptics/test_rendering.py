"""Models on a device: ``lumbar render``, verdicts on linear models and on FMUs, and the check at export."""

import json
import re

import numpy as np
import pytest
from c_programs import ON_LINUX
from effect_entries import effect_entry
from runtime_models import SETTINGS, contents, models_json
from tissue_fits import COEFFICIENTS, fitted

import lumbar
from study_settings import changed

DEFAULTS = lumbar.StudySettings().runtime


@pytest.fixture
def models(tmp_path):
    path = tmp_path / "models.json"
    path.write_text(json.dumps(models_json()))
    return path


@pytest.fixture(scope="module")
def rendering():
    return lumbar.render([fitted(name) for name in COEFFICIENTS])


def verdict(rendering, name: str, rate: float):
    return next(item for item in rendering if (item.model.name, item.analysis.rate) == (name, rate))


def test_command_prints_verdicts_and_writes_table_and_figures(run, models, tmp_path):
    out = run.done(
        "render", models, "--model", "KB", "--hand", "300", "--damping", "5.5", "--output", tmp_path / "out"
    )
    assert re.search(r"KB at 100 Hz: UNSTABLE .*15\.4.* oscillates at [\d.]+ Hz", out)
    endings = {"rendering": "csv tex html", "closed_loop": "svg pdf", "z_width": "svg pdf"}
    written = {f"{stem}.{ending}" for stem, given in endings.items() for ending in given.split()}
    assert {path.name for path in (tmp_path / "out").iterdir()} == written


@pytest.mark.parametrize(
    ("option", "key"), [("--mass", "mass_kg"), ("--damping", "damping_N_s_m"), ("--rate", "rate_Hz")]
)
def test_device_without_mass_damping_or_rate_is_rejected(run, models, option, key):
    assert re.search(rf"{key}: .*\b0\b", run.refused("render", models, "--model", "KB", option, "0"))


def test_table_defines_its_columns_and_has_the_numbers(rendering, tmp_path):
    frame = rendering.table.frame.set_index(["model", "rate_Hz"])
    needed = verdict(rendering, "KB", 100.0).analysis.damping
    assert frame.loc[("KB", 100.0), "damping_needed_N_s_m"] == needed
    assert frame.loc[("KB", 100.0), "stable"] == "NO"
    assert np.isnan(frame["oscillation_Hz"].to_numpy()[-1])
    rendering.table.write(tmp_path / "rendering")
    assert "Colgate" not in (tmp_path / "rendering.csv").read_text()
    assert "Re{(1 − exp(−jωT)) H(exp(jωT))}" in (tmp_path / "rendering.html").read_text()


@pytest.mark.parametrize(
    ("name", "damping", "gain"),
    [("MW", 13.05, 0.624), ("Maxwell", 26.63, 0.282), ("KB", 29.30, 0.303), ("HO", 108.0, 0.295)],
)
def test_at_100_Hz_no_model_is_stable_on_a_light_stylus(name, damping, gain, rendering):
    """Expected from 200 000 frequencies and 20 000 gains, each a product of polynomials written out."""
    analysis = verdict(rendering, name, 100.0).analysis
    assert (analysis.damping, analysis.gain) == (
        pytest.approx(damping, rel=2e-3),
        pytest.approx(gain, rel=4e-3),
    )
    assert not analysis.passive
    assert not analysis.stable


def test_inverted_model_is_judged_with_its_displayed_sign(rendering):
    """Like the others, so that it draws the tool in: −125 N/m against a hand of 300 N/m, and of 100 N/m."""
    held = verdict(rendering, "IL", 100.0).analysis
    np.testing.assert_allclose(held.model.loops[0].numerator, -125.0 / 3)
    assert held.gain == pytest.approx(2.4) and held.stable and not held.passive
    loose = lumbar.render(fitted("IL"), hand_stiffness_N_m=100.0)[0]
    assert not loose.analysis.stable
    assert np.isinf(loose.analysis.damping) and loose.analysis.limit.frequency == 0.0
    assert loose.run.runs_away and loose.run.limit == 15.0


def test_worst_corner_of_the_hands_range_decides(rendering):
    """The inverted spring of −125 N/m is held by every hand that is stiffer, at any damping."""
    loose = verdict(rendering, "IL", 1000.0)
    assert loose.stable and not loose.safe
    assert (loose.worst_hand.stiffness, loose.worst_hand.stable) == (50.0, False)
    firm = changed(DEFAULTS, device={"hands_stiffness_N_m": (130.0, 1500.0)})
    held = lumbar.render(fitted("IL"), settings=firm)[-1]
    assert held.safe and (held.worst_hand.stiffness, held.worst_hand.stable) == (130.0, True)


def test_passive_loop_is_safe_without_a_hand():
    """A free stylus keeps any position: the pole at 1 of this corner of the hand's range is not an instability."""
    settings = changed(DEFAULTS, device={"hands_stiffness_N_m": (0.0, 1500.0), "damping_N_s_m": 40.0})
    free = lumbar.render(fitted("Maxwell"), settings=settings)[-1]
    assert free.passive and free.safe


def test_angle_is_not_a_position_of_a_stylus():
    with pytest.raises(lumbar.InputError, match=r"KB: .*\bangle .*'rad'.*runtime\.device"):
        lumbar.render(fitted("KB", "rad", "angle"))


@ON_LINUX
def test_bound_of_the_fmu_calms_an_unstable_loop(rendering, zig_cache):
    """Simulated with the library: half of the device's damping given to it, 30 N peak to peak become less than a step's."""
    settings = changed(SETTINGS, device_damping=2.75, compiler_cache=str(zig_cache))
    bounded = lumbar.render(fitted("KB"), settings=settings)[0]
    free = verdict(rendering, "KB", 100.0).run
    assert not bounded.analysis.stable
    assert (free.peak_to_peak, free.oscillates) == (30.0, True)
    assert bounded.run.peak_to_peak < 0.05
    assert not bounded.run.oscillates


@ON_LINUX
def test_dry_friction_is_judged_by_its_slope_and_its_effect(zig_cache, tmp_path):
    """0.8 N turn within 0.7 mm/s: 1.14 N·s/mm at the turn, of which a step of the encoder shows a fortieth."""
    path = tmp_path / "models.json"
    path.write_text(json.dumps(models_json(effect_entry("KB", "coulomb_friction/coulomb"))))
    settings = changed(SETTINGS, compiler_cache=str(zig_cache))
    judged = lumbar.render(lumbar.load_models(path), settings=settings)[-1]
    slopes = {" ".join(loop.name.split()[-2:]): loop.numerator[0] for loop in judged.model.loops[:4]}
    springs = 1e3 * (0.8 + 6.0) / 3  # those of the base, over the average of three positions
    assert slopes["1e-06 mm"] - springs == pytest.approx(1e3 * 0.8 / 0.7 * 1e3 / 3, rel=1e-3)
    assert judged.analysis.gain < 0.3 and not judged.stable


def exported_page(settings, folder) -> str:
    """Return the page of KB's FMU."""
    _, path = lumbar.export_fmu(fitted("KB"), folder, settings=settings)
    return contents(path)["documentation/index.html"].decode()


@ON_LINUX
def test_export_rejects_an_unstable_loop_on_request(zig_cache, tmp_path, capsys):
    refusing = changed(SETTINGS, compiler_cache=str(zig_cache), device={"unsafe": "refuse"})
    with pytest.raises(lumbar.NumericalError, match=r"runtime\.device\.unsafe: warn"):
        exported_page(refusing, tmp_path)
    assert list(tmp_path.iterdir()) == []
    assert "Device: " in exported_page(changed(refusing, device={"damping_N_s_m": 40.0}), tmp_path)
    assert "WARNING" not in capsys.readouterr().err


@ON_LINUX
@pytest.mark.parametrize(
    ("damping", "device", "safe"),
    [(2.75, {}, True), (5.5, {}, False), (2.75, {"delay_ms": 5.0}, False), (2.75, {"rate_Hz": 50.0}, False)],
    ids=["bounded", "swings without loss", "late", "slower servo"],
)
def test_bound_counts_if_forces_are_prompt_and_the_loop_rests(
    damping, device, safe, zig_cache, tmp_path, capsys
):
    """All of the device's damping leaves an oscillation of 1.2 N; a delay or a slower servo one of 30 N."""
    settings = changed(SETTINGS, device_damping=damping, compiler_cache=str(zig_cache), device=device)
    page = exported_page(settings, tmp_path)
    assert ("WARNING: " in capsys.readouterr().err) == (not safe)
    assert (re.search(r"device_damping\b.*\bpassive\b", page) is not None) == (device == {})


@ON_LINUX
@pytest.mark.nightly
def test_passive_models_of_a_file_are_exported(run, examples, tmp_path, zig_cache):
    """From records to an FMU that is passive on the device: `export` reads the file of `identify --passive`."""
    fits = lumbar.identify(examples, max(examples, key=len).name).passive(examples)
    assert str(fits).count("KB-passive") == 3
    frame = fits.table("drawn").frame
    assert (frame.loc[frame["fit"] != "free, ridge ARX", "vaf_cost"].dropna() > -0.01).all()
    assert (frame.loc[frame["fit"].str.startswith("passive"), "takes_energy"] == "yes").all()
    on_device = frame[frame["fit"] == "passive on the device at 1000Hz"]
    assert (on_device["damping_at_servo_rate_N_s_m"] <= 5.5).all()
    fits.save(tmp_path, "drawn")
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
    files = contents(tmp_path / "fmu" / "KB-passive-1000Hz_fmi3.fmu")
    assert b"passive" in files["documentation/index.html"]
