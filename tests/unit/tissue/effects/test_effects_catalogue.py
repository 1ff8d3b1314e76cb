"""The catalogue is complete and each form follows its equation; operators against fine steps, equations and closed forms."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from periodic_records import record

from lumbar.base.errors import InputError, Problems
from lumbar.base.yaml_file import read_yaml
from lumbar.settings.lifting import PendulumSettings
from lumbar.tissue.diagnosis.fitting.joint_fit import fit_base
from lumbar.tissue.diagnosis.fitting.preparation import Experiment, prepare
from lumbar.tissue.diagnosis.selection.candidate import Candidate, evaluate
from lumbar.tissue.diagnosis.selection.forward_selection import extend
from lumbar.tissue.effects import catalogue
from lumbar.tissue.effects.catalogue import CATALOGUES, TISSUE, load_effects
from lumbar.tissue.effects.hooks import HOOKS
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.form import Place
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.operators import (
    bouc_wen,
    bouc_wen_general,
    elastoplastic,
    play,
    presliding,
    relaxation,
)
from lumbar.tissue.models.structure import Structure

FORMS = [form for effect in TISSUE.values() for form in effect.forms]


@pytest.fixture(scope="module")
def motion():
    time = np.arange(1200) * 0.01
    return Motion(time, 3 * np.sin(2 * np.pi * 0.7 * time) + np.cos(2 * np.pi * 2.3 * time), 0.01)


def middle(form):
    return np.array([np.sqrt(shape.low * shape.high) for shape in form.nonlinear])


@pytest.mark.parametrize("system", CATALOGUES)
def test_every_effect_is_described(system):
    for name, effect in CATALOGUES[system].items():
        assert effect.mechanism.endswith(".") and effect.source and effect.experiment, name
        assert len({form.name for form in effect.forms}) == len(effect.forms)
        for form in effect.forms:
            assert form.equation and form.effect == name
            parameters = [*form.linear, *form.nonlinear]
            assert len({item.name for item in parameters}) == len(parameters)
            assert all(item.unit for item in parameters)


EQUATIONS = {
    "hardening_stiffness/cubic": lambda z, v, a, t, s: [z**3],
    "hardening_stiffness/exponential": lambda z, v, a, t, s: [np.sign(z) * (np.exp(np.abs(z) / s[0]) - 1)],
    "coulomb_friction/coulomb": lambda z, v, a, t, s: [np.tanh(v / s[0])],
    "depth_dependent_damping/bilinear": lambda z, v, a, t, s: [z * v, v],
    "quadratic_stiffness/rounded": lambda z, v, a, t, s: [np.sqrt(z**2 + s[0] ** 2) - s[0]],
    "quadratic_stiffness/deep": lambda z, v, a, t, s: [np.where(z > s[0], z - s[0], 0)],
    "depth_dependent_damping/hunt_crossley": lambda z, v, a, t, s: [np.where(z > 0, z, 0) ** s[0] * v, v],
    "inertia/mass": lambda z, v, a, t, s: [a],
    "drift/power": lambda z, v, a, t, s: [t ** s[0]],
    "periodic_disturbance/sine": lambda z, v, a, t, s: [
        np.sin(2 * np.pi * s[0] * t),
        np.cos(2 * np.pi * s[0] * t),
    ],
}


@pytest.mark.parametrize("key", EQUATIONS)
def test_columns_equal_the_equation_with_exact_derivatives(key, motion):
    form = next(form for form in FORMS if form.key == key)
    slow, fast, time = 2 * np.pi * 0.7, 2 * np.pi * 2.3, motion.time
    velocity = 3 * slow * np.cos(slow * time) - fast * np.sin(fast * time)
    acceleration = -3 * slow**2 * np.sin(slow * time) - fast**2 * np.cos(fast * time)
    expected = EQUATIONS[key](motion.position, velocity, acceleration, time, middle(form))
    for column, exact in zip(form.columns(motion, middle(form)), expected, strict=True):
        assert np.abs(column - exact)[10:-10].max() < 2e-3 * np.abs(exact).max()


def test_output_forms_limit_force_without_overflow(motion):
    force = np.concatenate([10 * motion.position, [1e30, -1e30]])
    forms = {form.key: form.output_transform for form in FORMS if form.place is Place.OUTPUT}

    def limited(key, *numbers):
        return forms[key](force, motion, np.array(numbers))

    assert np.array_equal(limited("contact_loss/sharp", 4.0), np.maximum(force, -4.0))
    assert np.array_equal(limited("saturation/sharp", 6.0), np.clip(force, -6.0, 6.0))
    assert np.allclose(limited("contact_loss/soft", 4.0, 1e-3)[:-2], np.maximum(force, -4.0)[:-2], atol=1e-2)
    assert np.allclose(limited("saturation/rounded", 6.0, 400.0), np.clip(force, -6, 6), atol=0.02)
    expected = force[:-2] / (1 + np.abs(force[:-2] / 6.0) ** 5) ** 0.2
    assert np.allclose(limited("saturation/rounded", 6.0, 5.0)[:-2], expected)


def test_elements_of_iwan_slide_one_after_the_other():
    """Pushed from rest, stiffness falls by one element's share whenever it begins to slide."""
    position = np.linspace(0, 4, 401)
    form = next(form for form in FORMS if form.key == "hysteresis/iwan")
    columns = form.columns(Motion(0.01 * np.arange(401), position, 0.01), np.array([2.0]))
    for distance, column in zip((2.0, 1.0, 0.5, 0.25), columns, strict=True):
        assert np.allclose(column, np.minimum(position / distance, 1.0))


def test_user_defined_effect_in_python(tmp_path):
    path = tmp_path / "own.py"
    path.write_text(
        "from lumbar.tissue.models.form import LinearParameter, Effect, Form, Place\n"
        "STEP = Effect('step', 'A step at zero.', (Form('step', 'F1*where(z > 0, 1, 0)', Place.PARALLEL,\n"
        "    (LinearParameter('step_force', '{y}', symbol='F1'),)),), 'me')\n",
        encoding="utf-8",
    )
    assert list(load_effects(path)) == ["step"]
    path.write_text(path.read_text().replace("F1*where", "F_2*where"), encoding="utf-8")
    with pytest.raises(
        InputError,
        match=r"own\.py: 1 problem\n  - step/step, equation: .*\bF_2\b.*\bF1\b",
    ):
        load_effects(path)
    path.write_text("x = 1\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"own\.py: .*\bEffect\b"):
        load_effects(path)
    path.write_text("import nothing_of_this_name\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"own\.py: .*ModuleNotFoundError.*nothing_of_this_name"):
        load_effects(path)
    with pytest.raises(InputError, match=r"absent\.py: .*improvement\.effect_files"):
        load_effects(tmp_path / "absent.py")


@pytest.mark.parametrize(("system", "name"), [("tissue", "effects"), ("pendulum", "pendulum_effects")])
def test_pages_of_the_catalogues_are_up_to_date(project, system, name):
    from generate.effects_reference import effects_page

    page = project / "docs" / "tissue" / f"{name}.md"
    text = page.read_text(encoding="utf-8")
    assert text == effects_page(system), "run make docs"
    for effect, definition in CATALOGUES[system].items():
        picture = f"images/{name}/{effect}.svg"
        shown = any(not form.channels for form in definition.forms)
        assert (picture in text) == shown
        assert (page.parent / picture).is_file() == shown


FOLDER = Path(catalogue.__file__).parent
FILES = sorted(FOLDER.glob("*/*.yaml"))


def test_catalogue_contains_every_file():
    for name in ("tissue", "pendulum", "motion_sensor"):
        effects = getattr(catalogue, name.upper())
        files = {path.stem: path for path in (FOLDER / name).glob("*.yaml")}
        assert set(effects) == files.keys()
        assert all(effect.name == key for key, effect in effects.items())


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_catalogue_files_pass_checks_of_user_files(path):
    """Only hooks are not allowed in user files."""
    problems = Problems("catalogue")
    strict = read_yaml(path, problems, anchors=False)
    problems.raise_if_any()
    assert strict.content == yaml.safe_load(path.read_text(encoding="utf-8"))
    effect = getattr(catalogue, path.parent.name.upper())[path.stem]
    for form in effect.forms:
        form.check()
    if hooked := sorted(HOOKS.keys() & {key for form in strict.content["forms"] for key in form}):
        with pytest.raises(InputError, match=rf"line \d+: \S+\.{hooked[0]}: .*equation, state, "):
            load_effects(path)
    else:
        assert load_effects(path)[path.stem] == effect


def test_hooks_are_named_and_used():
    named = {key: set() for key in HOOKS}
    for path in FILES:
        for form in yaml.safe_load(path.read_text(encoding="utf-8"))["forms"]:
            for key in HOOKS.keys() & form.keys():
                named[key].add(form[key])
    assert named == {key: set(known) for key, known in HOOKS.items()}


def test_gravity_is_that_of_settings():
    constants = [
        item for effect in catalogue.PENDULUM.values() for form in effect.forms for item in form.constants
    ]
    assert {item.value for item in constants if item.symbol == "g"} == {PendulumSettings().gravity_m_s2}


STEP = 0.01


def test_reversals_skip_rests():
    motion = Motion(np.arange(8) * STEP, np.array([0.0, 1, 1, 2, 2, 1, 0, 1]), STEP, smooth=False)
    assert motion.reversals.tolist() == [0, 4, 6, 7]
    assert motion.interval.tolist() == [0, 0, 0, 0, 1, 1, 2, 2]


FINE = 50
"""Steps between two samples of a motion that is known finely."""


def band_limited(seed: int, fastest: float = 5.0) -> tuple[Motion, Motion]:
    """A motion up to 5 Hz as a sensor samples it, and in fine steps."""
    random = np.random.default_rng(seed)
    lines, phases = random.uniform(0.1, fastest, 12), random.uniform(0, 6, 12)
    time = np.arange(1 + 1499 * FINE) * STEP / FINE
    position = np.cos(2 * np.pi * np.outer(time, lines) + phases).sum(axis=1)
    sampled = Motion(time[::FINE], position[::FINE], STEP)
    return sampled, Motion(time, position, STEP / FINE, smooth=False)


OPERATORS = {
    "play": lambda motion: play(motion, 0.4),
    "presliding": lambda motion: presliding(motion, 0.3),
    "bouc_wen": lambda motion: bouc_wen(motion, 0.3),
    "bouc_wen_general": lambda motion: bouc_wen_general(motion, 0.3, 0.8),
    "elastoplastic": lambda motion: elastoplastic(motion, 0.3),
}


@pytest.mark.parametrize("name", OPERATORS)
@pytest.mark.parametrize("seed", range(3))
def test_smooth_motion_turns_between_its_samples(name, seed):
    sampled, fine = band_limited(seed)
    truth = OPERATORS[name](fine)[::FINE]
    apart = Motion(sampled.time, sampled.position, STEP, smooth=False)
    within, without = (OPERATORS[name](motion) - truth for motion in (sampled, apart))
    assert np.abs(within).mean() < 0.05 * np.abs(without).mean()
    assert abs(within.mean()) < 1e-3 * np.abs(truth).mean()


def test_branch_with_play_follows_the_motion_between_samples():
    sampled, fine = band_limited(3)
    truth = relaxation(Motion(fine.time, play(fine, 0.4), fine.sampling_time, smooth=False), 0.1)[::FINE]
    error = relaxation(sampled.through(lambda motion: play(motion, 0.4)), 0.1) - truth
    coarse = relaxation(Motion(sampled.time, play(sampled, 0.4), STEP, smooth=False), 0.1) - truth
    assert np.sqrt(np.mean(error**2)) < 0.3 * np.sqrt(np.mean(coarse**2))


def test_rests_and_corners_are_not_turns_between_samples():
    ramps = np.concatenate([np.arange(50), np.full(30, 50.0), 50 - np.arange(50), np.arange(20)])
    motion = Motion(np.arange(len(ramps)) * STEP, ramps, STEP)
    np.testing.assert_allclose(motion.turns, ramps[motion.reversals], atol=1e-12)


FRICTION = {form.name: form for name in ("hysteresis", "coulomb_friction") for form in TISSUE[name].forms}


def recorded(name: str, seed: int, form: str, linear: tuple[float, ...], nonlinear: tuple[float, ...]):
    """Four periods of a multisine of 3 mm on a spring and dashpot with a form of friction, noise of 0.01 N."""
    random, lines = np.random.default_rng(seed), np.arange(1, 50) / 10
    time = np.arange(0, 10, STEP)
    period = np.cos(2 * np.pi * np.outer(time, lines) + random.uniform(0, 6.28, len(lines))) @ lines**-0.7
    position = np.tile(3 * period / np.abs(period).max(), 4)
    motion = Motion(np.arange(len(position)) * STEP, position, STEP)
    tissue = Structure(BASES["KV"], (FRICTION[form],))
    force = tissue.simulate(motion, np.array([0.8, 0.03, *linear]), np.array(nonlinear))
    force = force + 0.01 * random.standard_normal(len(force))
    return record(position, force, name)


def experiment_of(form: str, *nonlinear: float, linear: tuple[float, ...] = (0.6,)) -> Experiment:
    """Two records of a tissue with friction."""
    records = [recorded(name, seed, form, linear, nonlinear) for seed, name in enumerate(("train", "unseen"))]
    return prepare(records, "train")


def extended(experiment: Experiment, *names: str, effect: str = "hysteresis") -> list[Candidate]:
    """Spring and dashpot with these forms of an effect, or all, best first."""
    effect = TISSUE[effect]
    if names:
        forms = tuple(
            replace(FRICTION[name], general=len(names) > 1 and FRICTION[name].general) for name in names
        )
        effect = replace(effect, forms=forms)
    base = evaluate(fit_base(Structure(BASES["KV"]), experiment.training), experiment)
    return extend(base, {effect.name: effect}, experiment)


def test_loop_of_the_benchmark_is_found_with_its_parameters():
    """w = (γ − δ)/2γ = 1.1875 for γ = 0.8, δ = −1.1, beyond what a quadratic energy admits."""
    experiment = experiment_of("bouc_wen_general", 0.6, 1.1875)
    best = extended(experiment)[0]
    assert best.fit.structure.forms[0].name == "bouc_wen_general"
    assert best.fit.nonlinear == pytest.approx([0.6, 1.1875], rel=0.03)
    assert best.fit.linear == pytest.approx([0.8, 0.03, 0.6], rel=0.1)
    assert best.test_rms < 1.1 * experiment.floor.rms


@pytest.mark.parametrize("form", ["dahl", "bouc_wen"])
def test_simple_loop_is_not_generalised(form):
    candidates = extended(experiment_of(form, 0.6))
    assert candidates[0].fit.structure.forms[0].name == form
    assert all(not item.fit.structure.forms[0].general for item in candidates)


def test_general_loop_with_a_small_gain_is_not_selected():
    experiment = experiment_of("elastoplastic", 0.6)
    simple, general = (extended(experiment, name)[0] for name in ("dahl", "bouc_wen_general"))
    noise = experiment.floor.rms
    assert (
        0.5 * (simple.train_rms**2 - noise**2) + noise**2 < general.train_rms**2 < 0.95 * simple.train_rms**2
    )
    assert {
        item.fit.structure.forms[0].name for item in extended(experiment, "dahl", "bouc_wen_general")
    } == {"dahl"}


def test_stribeck_friction_is_selected_if_it_is_visible():
    weak = extended(experiment_of("coulomb", 0.5), effect="coulomb_friction")
    assert weak[0].fit.structure.forms[0].name == "coulomb"
    assert all(not item.fit.structure.forms[0].general for item in weak)
    experiment = experiment_of("stribeck", 0.5, 8.0, linear=(0.5, 0.5))
    best = extended(experiment, effect="coulomb_friction")[0]
    assert best.fit.structure.forms[0].name == "stribeck"
    assert best.fit.linear[2:] == pytest.approx([0.5, 0.5], rel=0.1)
