"""Passivity and loops with a hand, effects or dry friction: published closed forms, poles, pushes, passive fits."""

from dataclasses import replace

import numpy as np
import pytest
from c_programs import ON_LINUX
from effect_entries import FORM_NUMBERS, entry_of_effects
from runtime_models import SETTINGS, models_json
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import nnls
from scipy.signal import argrelextrema
from tissue_fits import COEFFICIENTS

from lumbar.settings.runtime import DeviceSettings, RuntimeSettings
from lumbar.tissue.effects.catalogue import TISSUE, catalogue_with
from lumbar.tissue.haptics.closed_loop import SampledModel, largest_stable_gain, propagation
from lumbar.tissue.haptics.loop_verdict import judge_loop, run_loop
from lumbar.tissue.haptics.passive_models import (
    Branches,
    DeviceCondition,
    fit_branches,
    fit_passive,
    takes_energy,
    unit_branch,
)
from lumbar.tissue.haptics.rendered_model import export_at, fmu_of, stepping
from lumbar.tissue.haptics.simulation import HandPush, simulate
from lumbar.tissue.haptics.ticks import required_damping
from lumbar.tissue.identification.arx_search import IdentificationData
from lumbar.tissue.models.fitted_model import read_models
from lumbar.tissue.models.transfer_function import FirstOrder, TransferFunction, undiscretise
from study_settings import changed

PERIOD = 0.01
ONE = np.ones(1)


@pytest.mark.parametrize("samples", [1, 2, 3, 5])
def test_an_averaged_spring_needs_half_a_sample_and_the_lag_of_its_average(samples):
    """K (T/2 + (n − 1) T/2): Colgate and Schenkel's K T/2, and the average's mean delay."""
    spring = SampledModel("spring", 1000.0 * np.ones(samples) / samples, ONE, PERIOD)
    assert required_damping(spring) == pytest.approx(1000.0 * PERIOD * samples / 2, rel=1e-5)


@pytest.mark.parametrize(("stiffness", "viscosity"), [(800.0, 2.0), (800.0, -2.0), (0.0, 3.0)])
def test_a_virtual_wall_needs_the_published_damping(stiffness, viscosity):
    """b > K T/2 + |B| for H = K + B (z − 1)/(T z): Colgate and Schenkel (1997), equation 39."""
    wall = SampledModel("wall", np.array([stiffness + viscosity / PERIOD, -viscosity / PERIOD]), ONE, PERIOD)
    expected = stiffness * PERIOD / 2 + abs(viscosity)
    if viscosity < 0:  # negative damping acts at low frequencies, where it adds to the spring's
        expected = max(stiffness * PERIOD / 2 - viscosity, expected)
    assert required_damping(wall) == pytest.approx(expected, rel=1e-4)


def data_of(structure: TransferFunction, noise: float = 0.0) -> IdentificationData:
    rng = np.random.default_rng(6)
    inputs = np.convolve(rng.standard_normal(3000), np.ones(5) / 5)[:3000]
    inputs -= inputs.mean()
    outputs = structure.simulate(inputs) + noise * rng.standard_normal(3000)
    return IdentificationData("drawn", inputs, outputs, 0.0, 0.0, PERIOD, 50)


TRUTH = Branches((0.5, 3.0, 0.4), (np.inf, 0.034, 0.8))


def test_branch_is_the_ramp_invariant_maxwell_element():
    fit = undiscretise(unit_branch(0.034, PERIOD), PERIOD)
    assert fit == FirstOrder(
        k=pytest.approx(0, abs=1e-12), nu=pytest.approx(0.034), gamma=pytest.approx(0.034)
    )


def test_stiffnesses_are_those_of_non_negative_least_squares():
    data = data_of(TRUTH.transfer_function(PERIOD), noise=0.3)
    times = [np.inf, *np.geomspace(0.01, 5.0, 9)]
    fit, error = fit_branches(data, times)
    regressors = np.column_stack([unit_branch(time, PERIOD).simulate(data.inputs) for time in times])[50:]
    expected, norm = nnls(regressors, data.outputs[50:])
    assert error == pytest.approx(norm**2, rel=1e-6)
    np.testing.assert_allclose(
        fit.stiffnesses, expected[expected > 1e-4 * expected.max()], rtol=1e-2, atol=1e-3
    )


@pytest.mark.parametrize("rate", [100.0, 1000.0])
@pytest.mark.parametrize("delay", [0.0, 0.0007])
@pytest.mark.parametrize("average", [1, 3])
def test_device_is_passive_with_the_model_fitted_for_it(rate, delay, average):
    """At the limit where the condition binds, well within where it does not; delays are cones."""
    data = data_of(TRUTH.transfer_function(PERIOD), noise=0.1)
    kernel = np.full(average, 1000.0 / average)
    rendering = SampledModel("", kernel, np.ones(1), 1.0 / rate).late(delay)
    fit = fit_passive(data, True, None, DeviceCondition(5.5, rendering))

    def damping_of(fit: Branches) -> float:
        structure = fit.transfer_function(1.0 / rate)
        numerator = np.convolve(structure.numerator, rendering.numerator)
        rendered = replace(rendering, numerator=numerator, denominator=np.array(structure.denominator))
        return required_damping(rendered)

    needed, wanted = damping_of(fit), damping_of(fit_passive(data, True, None))
    assert needed <= 5.5
    if wanted > 5.6:
        assert needed > 5.4


@pytest.mark.parametrize(("name", "takes"), [("MW", False), ("Maxwell", True), ("KB", True), ("HO", False)])
def test_which_models_of_the_thesis_take_energy(name, takes):
    """Against the work of sampled sines, trapezoid by trapezoid."""
    structure = TransferFunction(*COEFFICIENTS[name])
    assert takes_energy(structure) == takes
    works = []
    for positions in np.sin(np.multiply.outer(np.linspace(0.05, 3.1, 60), np.arange(6000))):
        force = structure.simulate(positions)
        works.append(float(((force[1:] + force[:-1]) / 2 * np.diff(positions))[3000:].sum()))
    assert (min(works) > -1e-6 * max(map(abs, works))) == takes


def test_negative_spring_releases_energy():
    assert not takes_energy(Branches((-0.5, 3.0), (np.inf, 0.034)).transfer_function(PERIOD))
    assert takes_energy(Branches((0.0, 3.0), (np.inf, 0.034)).transfer_function(PERIOD))


STYLUS = DeviceSettings()


def test_device_and_hand_move_as_integrated():
    device = DeviceSettings(hand_mass_kg=0.1, hand_damping_N_s_m=2.0)
    transition, by_force = propagation(device, 0.013)

    def motion(_, state):
        return [state[1], (3.0 - 300.0 * state[0] - 7.5 * state[1]) / 0.35]

    integrated = solve_ivp(motion, (0, 0.013), [0.002, -0.1], rtol=1e-12, atol=1e-15).y[:, -1]
    np.testing.assert_allclose(transition @ [0.002, -0.1] + 3.0 * by_force, integrated, rtol=1e-9)


def test_an_unstable_model_has_no_stable_gain():
    model = SampledModel("", np.ones(1), np.array([1, -1.1]), 0.01)
    assert largest_stable_gain(model, STYLUS).gain == 0.0


def test_narrow_resonance_needs_its_damping():
    # K(1 + g z⁻¹/(1 − 2r cos θ z⁻¹ + r² z⁻²)); the peak is 1e-5 rad wide
    radius, angle, period = 1.0 - 1e-5, 1.234, 1e-3
    denominator = np.array([1.0, -2.0 * radius * np.cos(angle), radius**2])
    model = SampledModel("ringing", 300.0 * denominator + [0.0, 0.05, 0.0], denominator, period)
    z = np.exp(1j * (angle + np.linspace(-2e-4, 2e-4, 40001)))
    condition = (
        period / 2.0 * ((1.0 - 1.0 / z) * np.polyval(model.numerator, z) / np.polyval(denominator, z)).real
    )
    needed = (condition / (1.0 - z.real)).max()
    assert needed > 1.5 * period / 2.0 * 300.0
    assert required_damping(model) == pytest.approx(needed, rel=1e-3)


def drawn_loop(rng):
    """A stable model of order 1 to 3, of either sign of static stiffness or without any, late, in a stiff, soft or no hand."""
    order = rng.integers(1, 4)
    poles = rng.uniform(-0.2, 0.98, order).astype(complex)
    if order > 1 and rng.random() < 0.4:
        poles[0] = rng.uniform(0.3, 0.97) * np.exp(1j * rng.uniform(0.05, 2.5))
        poles[1] = poles[0].conj()
    denominator, numerator = np.poly(poles).real, 2000 * rng.standard_normal(order + 1)
    if rng.random() < 0.1:
        numerator[-1] -= numerator.sum()
    numerator = np.r_[np.zeros(rng.integers(0, 4)), numerator]
    period = rng.choice([1e-3, 2e-3, 1e-2])
    delay = rng.choice([0.0, rng.uniform(0.05, 0.95) * period])
    device = {"mass_kg": rng.uniform(0.05, 1.0), "damping_N_s_m": 10 ** rng.uniform(-1, 1)}
    hand = rng.choice([0.0, 0.0, 50.0, 300.0, 1500.0])
    return SampledModel("drawn", numerator, denominator, float(period), float(delay)), device, float(hand)


def transition(model, mass, damping, hand, gain):
    """Over one sample: position, velocity, force, and the model's states in controller form."""
    order = max(len(model.numerator), len(model.denominator)) - 1
    b, a = (np.pad(part, (0, order + 1 - len(part))) for part in (model.numerator, model.denominator))
    moving = np.array([[0.0, 1.0, 0.0], [-hand / mass, -damping / mass, 1.0 / mass], [0.0, 0.0, 0.0]])
    newest = np.zeros(3 + order)
    newest[0], newest[3:] = 1.0, -a[1:]
    force = b[0] * newest
    force[3:] += b[1:]
    at_new = expm(moving * model.delay) @ np.eye(3 + order)[:3]
    at_new[2] = -gain * force
    whole = np.zeros((3 + order, 3 + order))
    whole[:3] = expm(moving * (model.sampling_time - model.delay)) @ at_new
    whole[3], whole[4:, 3:-1] = newest, np.eye(order - 1)
    return whole


def gain_by_eigenvalues(model, device, hand):
    """By bisection between a factor that is stable with all below it and the first on a fine grid that is not."""
    drifts = hand == 0 and abs(model.numerator.sum()) < 1e-9 * np.abs(model.numerator).sum()

    def unstable(gain):
        poles = np.linalg.eigvals(transition(model, *device.values(), hand, gain))
        if drifts:  # a stylus without a hand stays at its position
            poles = np.delete(poles, np.abs(poles - 1.0).argmin())
        return np.abs(poles).max() >= 1 + 1e-12

    stable = 0.0
    for tried in np.geomspace(1e-6, 1e6, 600):
        if unstable(tried):
            break
        stable = tried
    else:
        return np.inf
    for _ in range(60 if stable else 0):
        middle = (stable + tried) / 2
        stable, tried = (stable, middle) if unstable(middle) else (middle, tried)
    return stable


def disagreement(rng):
    """Return the fault of one drawn loop, or an empty text."""
    model, values, hand = drawn_loop(rng)
    device = changed(RuntimeSettings(), device=values | {"hand_stiffness_N_m": hand}).device
    fit, expected = largest_stable_gain(model, device).gain, gain_by_eigenvalues(model, values, hand)
    stiffness = model.numerator.sum() / model.denominator.sum()
    if stiffness < -1e-6 and np.isfinite(required_damping(model, 200)):
        return f"passive with {stiffness:g} N/m"
    if fit == pytest.approx(expected, rel=1e-5, abs=1e-6) or (fit > 1e6 and np.isinf(expected)):
        return ""
    return f"{model}, {values}, {hand} N/m: {fit}, by eigenvalues {expected}"


@pytest.mark.parametrize(
    "loops",
    [pytest.param(100, marks=pytest.mark.nightly), pytest.param(2000, marks=pytest.mark.statistical)],
)
def test_gains_are_those_of_the_eigenvalues(loops):
    rng = np.random.default_rng(loops)
    assert [text for _ in range(loops) if (text := disagreement(rng))] == []


FRICTION, STIFFNESS = 0.05, 300.0


def moved(**device):
    """Simulate a stylus that only the hand moves: pushed by 50 mm, then free to oscillate."""
    stylus = DeviceSettings(damping_N_s_m=1e-9, hand_stiffness_N_m=STIFFNESS, encoder_um=0, **device)
    return simulate(lambda time, position: 0.0, [1e-3], stylus, 15.0, HandPush(50.0))


def test_friction_shortens_every_half_swing():
    run = moved(friction_N=FRICTION)
    late = run.time > 0.3
    position = run.position[late]
    peaks = np.sort(np.concatenate([argrelextrema(position, kind)[0] for kind in (np.greater, np.less)]))
    sizes = np.abs(position[peaks] - 50e-3)
    lost = -np.diff(sizes)
    assert len(lost) > 2
    # Peaks are read to a millisecond and friction is late by one: a few µm of each swing.
    np.testing.assert_allclose(lost, 2 * FRICTION / STIFFNESS, atol=4e-6)


def test_friction_makes_the_stylus_stick():
    """It sticks if the spring is weaker than the friction, and does not move if any force is."""
    position = moved(friction_N=FRICTION).position
    assert np.ptp(position[-100:]) < 1e-12
    assert abs(position[-1] - 50e-3) <= FRICTION / STIFFNESS
    assert np.ptp(moved().position[-500:]) > 5e-3
    assert np.abs(moved(friction_N=15.1).position).max() == pytest.approx(0.0, abs=1e-15)


def test_a_force_that_drifts_does_not_oscillate():
    """By 50 mN a second; a sine of the same size does."""
    stylus = DeviceSettings(encoder_um=0)
    drifting, swinging = (
        simulate(lambda time, position, shape=shape: 0.05 * shape(time), [1e-3], stylus, 15.0, HandPush())
        for shape in (float, lambda time: np.sin(20.0 * time))
    )
    assert drifting.peak_to_peak == pytest.approx(0.05, rel=0.01)
    assert drifting.calm and swinging.oscillates


OWN = {"hertzian_contact/sphere": ([0.4], []), "hertzian_contact/power": ([0.4], [1.7])}


ENCODERS_UM = (0.0, 1.0, 30.0)


@ON_LINUX
@pytest.mark.parametrize(
    ("form", "encoder_um"),
    [  # by night every form with one encoder, in turn
        pytest.param(
            form, encoder, marks=pytest.mark.nightly if place == number % 3 else pytest.mark.acceptance
        )
        for number, form in enumerate([*FORM_NUMBERS, *OWN])
        for place, encoder in enumerate(ENCODERS_UM)
    ],
)
def test_no_push_shakes_a_stable_loop(form, encoder_um, zig_cache, project):
    catalogue = TISSUE
    if form in OWN:
        catalogue = catalogue_with([project / "examples" / "own_effect" / "hertzian_contact.yaml"])
    entry = entry_of_effects("KB", {form: {**FORM_NUMBERS, **OWN}[form]}, catalogue)
    settings = changed(SETTINGS, compiler_cache=str(zig_cache), device={"encoder_um": encoder_um})
    exported = export_at(read_models(models_json(entry), {"tissue": catalogue})[0], settings, 1000.0)
    verdict = judge_loop(exported, settings)
    with fmu_of(exported, settings) as fmu:
        for push_mm in (3.0, 0.2, -2.0) if verdict.stable else ():
            with stepping(fmu) as step:
                run = run_loop(verdict.analysis, step, HandPush(push_mm))
            assert run.calm, f"{push_mm:g} mm: {run.outcome}; {verdict.finding}"
