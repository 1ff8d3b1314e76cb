"""Analysis of a model in the loop: late clients, units, linearisations, and the lowest safe rates."""

from dataclasses import replace

import numpy as np
import pytest
from c_programs import ON_LINUX
from effect_entries import entry_of_effects
from runtime_models import models_json
from scipy.signal import lfilter
from tissue_fits import fitted

from lumbar.settings.runtime import RuntimeSettings
from lumbar.tissue.effects.catalogue import CATALOGUES, TISSUE
from lumbar.tissue.fmu.build.export_model import export_models
from lumbar.tissue.haptics.closed_loop import SampledModel, all_angles
from lumbar.tissue.haptics.loop_verdict import analyse, judge_loop
from lumbar.tissue.haptics.rendered_model import export_at, render_model
from lumbar.tissue.haptics.z_width import _lowest, lowest_rates
from lumbar.tissue.models.fitted_model import read_models
from lumbar.tissue.models.model_data import MotionRange
from study_settings import changed

DEFAULTS = RuntimeSettings()
STYLUS = DEFAULTS.device


def analysed(name: str, rate: float, settings: RuntimeSettings = DEFAULTS, late: bool = False):
    return analyse(render_model(export_at(fitted(name), settings, rate), STYLUS, late=late), STYLUS)


def test_late_client_gets_only_the_feedthrough_late():
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


def test_units_do_not_matter():
    model = fitted("KB", "cm")
    structure = replace(model.structure, numerator=tuple(10.0 * b for b in model.structure.numerator))
    judged = render_model(export_at(replace(model, structure=structure), DEFAULTS, 100.0), STYLUS)
    expected = render_model(export_at(fitted("KB"), DEFAULTS, 100.0), STYLUS)
    np.testing.assert_allclose(judged.loops[0].numerator, expected.loops[0].numerator, rtol=1e-12)


@pytest.mark.parametrize(
    ("form", "number", "damping"),
    [("hardening_stiffness/cubic", 0.2, 14.9), ("strain_softening/cubic", 0.02, np.inf)],
)
def test_nonlinear_model_is_judged_over_its_whole_range(form, number, damping):
    """Both are at 2 mm; deeper the one is steep, of which a hand that pushes by 20 mm is shaken, and the other gives way."""
    document = models_json(entry_of_effects("LE", {form: ([number], [])}, TISSUE))
    exported = export_at(read_models(document, CATALOGUES)[0], DEFAULTS, 1000.0)
    judged = analyse(render_model(exported, STYLUS), STYLUS)
    assert judged.damping == pytest.approx(damping, rel=0.01)
    assert not judged.passive and not judged.stable
    fitted_to = replace(exported.identified, valid_for=MotionRange(-1.5, 2.0, 10.0, 0.1, 5.0))
    known = analyse(render_model(replace(exported, identified=fitted_to), STYLUS), STYLUS)
    assert known.passive and known.model.reach == pytest.approx((-1.5, 2.0))


@ON_LINUX
def test_limit_on_the_rate_prevents_a_passive_verdict(zig_cache):
    """The limit makes large forces late: thrown in, a stylus that has the damping that KB needs swings for ever."""
    held = changed(
        DEFAULTS,
        compiler_cache=str(zig_cache),
        output_rate_limit=30.0,
        device={"damping_N_s_m": 8.0},
    )
    free = changed(held, device={"hand_stiffness_N_m": 0.0})
    exported = export_models([fitted("KB")], held)[0]
    judged = judge_loop(exported, held)
    assert judged.analysis.damping < 8.0 and judged.stable and not judged.passive
    shaken = judge_loop(exported, free)
    assert shaken.analysis.stable and not shaken.stable
    assert lowest_rates(fitted("KB"), held)[0] is None


def test_force_that_changes_with_time_prevents_a_passive_verdict():
    document = models_json(entry_of_effects("KB", {"drift/linear": ([0.01], [])}, TISSUE))
    exported = export_at(read_models(document, CATALOGUES)[0], DEFAULTS, 1000.0)
    damped = STYLUS.model_copy(update={"damping_N_s_m": 11.0})
    judged = analyse(render_model(exported, damped), damped)
    assert judged.stable and not judged.passive and judged.damping < 11.0 and judged.model.omitted


def test_all_rates_above_the_lowest_safe_one_are_safe():
    """Not from 300 Hz on where what lies from 1200 to 1400 Hz is unsafe, between two of the rates that are tried first."""
    rates = [100.0 * 2**power for power in range(8)]
    judged = _lowest(rates, lambda rate: rate > 300 and not 1200 < rate < 1400, between=True)
    assert judged == pytest.approx(1400.0, rel=0.01)


def test_lowest_rates_agree_with_damping_and_gain():
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


def test_model_in_phases_has_the_response_of_its_polynomials():
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
