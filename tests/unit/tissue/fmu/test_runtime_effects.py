"""Models with effects, of the catalogue and of users: every form sample by sample, finished FMUs, what cannot be exported."""

import math
import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from c_programs import ON_LINUX
from effect_entries import BASE_NUMBERS, FORM_NUMBERS, effect_entry, entry_of_effects, parameter
from runtime_models import SETTINGS, check_simulation, export, exported, models_json, selected

from case_tables import cases
from lumbar.base.errors import InputError, NumericalError
from lumbar.tissue.effects.catalogue import CATALOGUES, TISSUE, catalogue_with
from lumbar.tissue.fmu.build.effect_model import effect_model
from lumbar.tissue.models import bases as base_models
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.structure import Structure
from study_settings import changed


@ON_LINUX
def test_elementary_functions_are_those_of_the_c_library(functions):
    """To two units in the last place, against Python's math (the platform's C library)."""
    generator = np.random.default_rng(1)
    values = np.concatenate(
        [generator.uniform(-40, 40, 4000), generator.normal(0, 1e-3, 4000), [0.0, 700.0, -700.0]]
    )
    standard = {"expm1": math.expm1, "tanh": math.tanh, "sinh": math.sinh, "arctan": math.atan}
    for (name, function), value in product(standard.items(), values.tolist()):
        expected = function(value)
        assert abs(functions[f"portable_{name}"](value) - expected) <= 2.5 * math.ulp(expected), (name, value)
    for value in values.tolist():
        expected, turn = (
            max(value, 0.0) + math.log1p(math.exp(-abs(value))),
            math.tau * (value - round(value)),
        )
        assert functions["portable_softplus"](value) == pytest.approx(expected, rel=4e-16, abs=2e-16)
        assert functions["portable_sine"](value) == pytest.approx(math.sin(turn), abs=5e-16)
        assert functions["portable_cosine"](value) == pytest.approx(math.cos(turn), abs=5e-16)
    for value in (10.0 ** generator.uniform(-6, 12, 4000)).tolist():
        assert functions["portable_log"](value) == pytest.approx(math.log(value), rel=5e-16, abs=1e-16)
    bases, exponents = 10.0 ** generator.uniform(-6, 4, 3000), generator.uniform(1, 4, 3000)
    for base, exponent in zip(bases, exponents, strict=True):
        assert functions["portable_power"](base, exponent) == pytest.approx(base**exponent, rel=1e-14)
    assert functions["portable_power"](0.0, 1.5) == 0.0
    assert functions["portable_expm1"](800.0) == math.inf
    assert functions["portable_expm1"](-800.0) == -1.0
    assert math.isnan(functions["portable_expm1"](math.nan))


def response(structure, inputs, sampling_time=0.01):
    model = FittedModel.from_json(effect_entry(*structure), CATALOGUES)
    return effect_model(model, sampling_time).response(np.asarray(inputs, dtype=float))


def entry_with(effect: str, form: str) -> dict:
    return {"structure": {"effects": [{"effect": effect, "form": form}]}}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        *cases(__file__, "not_exported"),
        (entry_with("inertia", "mass"), r"models\.KB: parameters\.inertia\.mass: "),
        (
            entry_with("ageing", "log"),
            "models.KB: structure.effects: .*'ageing'.*coulomb_friction.*improvement.effect_files",
        ),
        (entry_with("hysteresis", "preisach"), "structure.effects.hysteresis: .*'preisach'.*dahl, bouc_wen"),
        (entry_with("base", "KB"), "structure.effects: .*'base'.*coulomb_friction"),
        (
            {"parameters": [parameter("spring_stiffness", 1.0)] * 2},
            r"parameters\.spring_stiffness: .*parameters\.branch_stiffness: ",
        ),
    ],
)
def test_entries_that_cannot_be_exported_are_rejected(change, message):
    with pytest.raises(InputError, match=re.compile(message, re.DOTALL)):
        exported({**effect_entry("KB"), **change})


def test_numbers_that_cannot_run_are_rejected():
    with pytest.raises(InputError, match=r"models\.KB\+delay: parameters\.delay\.\w+: 0\b"):
        exported(entry_of_effects("KB", {"delay/pure": ([], [0.0])}, TISSUE))
    with pytest.raises(InputError, match=r"delay/pure: .*\b901\b.*100 Hz.*\b256\b.*runtime\.rate_Hz"):
        exported(entry_of_effects("KB", {"delay/pure": ([], [9.0])}, TISSUE))


def test_overflow_is_an_error():
    with pytest.raises(NumericalError, match=r"\bLE\b.*overflow"):
        response(("LE", "hardening_stiffness/exponential"), [0.0, 1e6])


SAMPLING_TIME = 0.001
FROM = 500
"""First sample compared: 0.5 s."""
ACCURACY = {
    r"coulomb_friction/(coulomb|arctangent|stribeck)": 0.15,
    r".*damping/.*|inertia/mass|hardening_stiffness/viscoelastic": 0.05,
    r"hysteresis/.*": 1e-4,
    r"(contact_loss|saturation)/.*|second_relaxation/maxwell_branch|relaxation_spectrum/power_law": 1e-3,
    r"delay/pure|backlash/play|softening/whole_force": 1e-3,
    r".*": 1e-9,
}
"""Difference as a share of the largest force that the effect adds, at 1 kHz and up to 4 Hz; the first pattern counts.
At a reversal half a sample of 150 mm/s² is 0.075 mm/s, a tenth of the smoothing speed.
A backward difference is half a sample late; relaxations, the delay, play and hysteresis see straight lines between samples,
where the catalogue has a spline through all samples, later ones included; output forms see that difference in the base."""


@pytest.fixture(scope="module")
def motion():
    time = np.arange(4000) * SAMPLING_TIME
    waves = ((1.0, 0.5, 0.3), (0.4, 1.7, 1.1), (0.15, 4.0, 2.0))
    position = sum(size * np.sin(2 * np.pi * frequency * time + phase) for size, frequency, phase in waves)
    return Motion(time, position, SAMPLING_TIME)


@pytest.mark.parametrize("key", FORM_NUMBERS)
def test_forces_are_those_of_the_catalogue(key, motion):
    bare, base_numbers = Structure(base_models.BASES["KB"]), BASE_NUMBERS["KB"]
    form = next(form for effect in TISSUE.values() for form in effect.forms if form.key == key)
    numbers = [np.array([*base, *added]) for base, added in zip(base_numbers, FORM_NUMBERS[key], strict=True)]
    bare_force = bare.simulate(motion, *map(np.array, base_numbers))
    expected = bare.with_form(form).simulate(motion, *numbers) - bare_force
    forces, bare_forces = (response(("KB", *keys), motion.position, SAMPLING_TIME) for keys in ((key,), ()))
    np.testing.assert_allclose(bare_forces[FROM:], bare_force[FROM:], atol=1e-4 * np.abs(bare_force).max())
    share = np.abs(expected)[FROM:].max()
    assert share > 1e-3, "the effect must be perceptible in this motion"
    error = np.abs(forces - bare_forces - expected)[FROM:].max()
    accuracy = next(value for pattern, value in ACCURACY.items() if re.fullmatch(pattern, key))
    assert error <= accuracy * share, (error, share)


WRITTEN = Path(__file__).with_name("written_effects.txt").read_text(encoding="utf-8")
"""Effects at all three places, with memory and constants; one equation that would end the comment around it."""


def exported_with(catalogue, *effects, **settings):
    added = {f"{effect}/{form}": numbers for effect, form, *numbers in effects}
    content = models_json({**entry_of_effects("KB", added, catalogue), "name": "KB+own"})
    chosen = changed(SETTINGS, models=["KB+own"], moving_average_ms=0, **settings)
    return selected(content, chosen, catalogue)[0]


@ON_LINUX
@pytest.mark.parametrize(("form", "amplitude", "nonlinear"), [("sphere", 0.7, []), ("power", 0.4, [1.7])])
def test_example_becomes_an_fmu(form, amplitude, nonlinear, project, zig_cache, tmp_path):
    catalogue = catalogue_with([project / "examples" / "own_effect" / "hertzian_contact.py"])
    model = exported_with(catalogue, ("hertzian_contact", form, [amplitude], nonlinear))
    check_simulation(model, tmp_path, zig_cache)
    depth = np.array([0.0, -2.0, 0.5])
    bare = exported_with(catalogue).dynamics.response(depth)
    added = amplitude * np.array([0.0, 0.0, 0.5 ** (nonlinear or [1.5])[0]])
    np.testing.assert_allclose(model.dynamics.response(depth) - bare, added, atol=1e-14)


@ON_LINUX
@pytest.mark.parametrize("rate", [None, 1000])
def test_effects_with_memory_at_every_place_become_an_fmu(rate, zig_cache, tmp_path):
    (tmp_path / "own.py").write_text(WRITTEN, encoding="utf-8")
    catalogue = catalogue_with([tmp_path / "own.py"])
    effects = (
        ("lag", "first_order", [], [0.05]),
        ("creep", "mean", [0.3], []),
        ("coulomb_friction", "coulomb", [0.8], [0.7]),
        ("rectified", "size", [], []),
    )
    check_simulation(exported_with(catalogue, *effects, rate_Hz=rate), tmp_path, zig_cache)


def rewritten(tmp_path, old: str, new: str):
    assert old in WRITTEN
    (tmp_path / "own.py").write_text(WRITTEN.replace(old, new), encoding="utf-8")
    return catalogue_with([tmp_path / "own.py"])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    cases(__file__, "lacking"),
)
def test_incomplete_files_are_rejected(old, new, message, tmp_path):
    catalogue = rewritten(tmp_path, old, new)
    effects = (
        ("lag", "first_order", [], [0.05]),
        ("creep", "mean", [0.3], []),
        ("rectified", "size", [], []),
    )
    with pytest.raises(InputError, match=re.compile(message, re.DOTALL)):
        exported_with(catalogue, *effects)


def test_comment_may_name_functions_that_code_may_not_call(tmp_path):
    catalogue = rewritten(tmp_path, '"fabs(force)"', '"fabs(force)", "// not tanh(force) /* sin(x) */"')
    assert exported_with(catalogue, ("rectified", "size", [], []))


def test_code_that_does_not_compile_leaves_no_fmu(tmp_path):
    catalogue = rewritten(tmp_path, "fabs(force)", "fabs(strength)")
    model = exported_with(catalogue, ("rectified", "size", [], []))
    folder = tmp_path / "fmu"
    folder.mkdir()
    with pytest.raises(InputError, match=r"(?s)x86_64-linux.*exit code 1.*'strength'"):
        export([model], folder)
    assert not list(folder.iterdir())
