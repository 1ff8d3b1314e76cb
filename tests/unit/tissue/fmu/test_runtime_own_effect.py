"""An effect of a user's own in one Python file becomes an FMU, or the message says what its file lacks."""

from __future__ import annotations

import re

import numpy as np
import pytest
from c_programs import ON_LINUX, CModel
from effect_entries import entry_of_effects
from runtime_models import SETTINGS, TARGET, models_json, selected

from lumbar.base.errors import InputError
from lumbar.tissue.effects.catalogue import catalogue_with
from lumbar.tissue.fmu.build.package import export_fmus
from lumbar.tissue.fmu.check.fmu_check import check_fmus
from study_settings import changed

WRITTEN = """
import numpy as np
from scipy.signal import lfilter
from lumbar.tissue.models.equation import CStep
from lumbar.tissue.models.form import LinearParameter, Effect, Form, HandWritten, Place, NonlinearParameter


def smoothed(motion, nonlinear):
    pole = np.exp(-motion.sampling_time / nonlinear[0])
    start = [pole * motion.position[0]]
    return motion.with_position(lfilter([1 - pole], [1, -pole], motion.position, zi=start)[0])


LAG = Effect("lag", "The mount is soft.", (Form("first_order", r"T \\dot z + z", Place.INPUT,
    nonlinear=(NonlinearParameter("lag_time", "s", "time", 0.01, 1.0, 3),), hand_written=HandWritten(
    input_transform=smoothed,
    c_step=CStep("next[0]", "next[0] = first ? position : pole * memory[0] + (1.0 - pole) * position;", memory=1,
        constants=lambda given, T: {"pole": float(np.exp(-T / given["lag_time"]))}))),), "own")
CREEP = Effect("creep", "Force follows the mean position.", (Form("mean", "c m", Place.PARALLEL,
    (LinearParameter("creep_stiffness", "{y}/{x}"),),
    hand_written=HandWritten(
    columns=lambda motion, _: [np.cumsum(motion.position) / np.arange(1, len(motion) + 1)],
    c_step=CStep("creep_stiffness * (next[1] / next[0])",
        "next[0] = memory[0] + 1.0;\\nnext[1] = memory[1] + position;", memory=2))),), "own")
RECTIFIED = Effect("rectified", "The sensor shows no sign.", (Form("size", "|F| */ ??/\\n|F|", Place.OUTPUT,
    hand_written=HandWritten(
    output_transform=lambda force, motion, _: np.abs(force), c_step=CStep("fabs(force)"))),), "own")
"""
"""Effects at all three places, with memory and constants; one equation that would end the comment it stands in."""


def exported(catalogue, *effects, **settings):
    added = {f"{effect}/{form}": numbers for effect, form, *numbers in effects}
    content = models_json({**entry_of_effects("KB", added, catalogue), "name": "KB+own"})
    chosen = changed(SETTINGS, models=["KB+own"], moving_average_ms=0, **settings)
    return selected(content, chosen, catalogue)[0]


def held_to_its_simulation(model, folder, cache) -> None:
    """C code sample by sample against the file's own simulation; then both FMUs through fmpy."""
    walk = np.cumsum(np.random.default_rng(3).standard_normal(800)) * 0.1
    expected = model.dynamics.response(walk)
    found = CModel(model, folder / "c", cache).response(walk)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    export_fmus([model], folder, "own", TARGET, cache)
    for check in check_fmus([model], folder, 200, seed=5):
        assert check.largest_output > 0.1


@ON_LINUX
@pytest.mark.parametrize(("form", "amplitude", "nonlinear"), [("sphere", 0.7, []), ("power", 0.4, [1.7])])
@pytest.mark.usefixtures("without_plots")
def test_the_example_becomes_an_fmu(form, amplitude, nonlinear, project, zig_cache, tmp_path):
    catalogue = catalogue_with([project / "examples" / "own_effect" / "hertzian_contact.py"])
    model = exported(catalogue, ("hertzian_contact", form, [amplitude], nonlinear))
    held_to_its_simulation(model, tmp_path, zig_cache)
    depth = np.array([0.0, -2.0, 0.5])
    bare = exported(catalogue).dynamics.response(depth)
    added = amplitude * np.array([0.0, 0.0, 0.5 ** (nonlinear or [1.5])[0]])
    np.testing.assert_allclose(model.dynamics.response(depth) - bare, added, atol=1e-14)


@ON_LINUX
@pytest.mark.parametrize("rate", [None, 1000])
@pytest.mark.usefixtures("without_plots")
def test_effects_with_memory_at_every_place_become_an_fmu(rate, zig_cache, tmp_path):
    (tmp_path / "own.py").write_text(WRITTEN, encoding="utf-8")
    catalogue = catalogue_with([tmp_path / "own.py"])
    effects = (
        ("lag", "first_order", [], [0.05]),
        ("creep", "mean", [0.3], []),
        ("coulomb_friction", "coulomb", [0.8], [0.7]),
        ("rectified", "size", [], []),
    )
    held_to_its_simulation(exported(catalogue, *effects, rate_Hz=rate), tmp_path, zig_cache)


def rewritten(tmp_path, old: str, new: str):
    assert old in WRITTEN
    (tmp_path / "own.py").write_text(WRITTEN.replace(old, new), encoding="utf-8")
    return catalogue_with([tmp_path / "own.py"])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            ', c_step=CStep("fabs(force)")',
            "",
            r"rectified/size: has no C code; .*c_step=CStep.*without this effect",
        ),
        ("fabs(force)", "atan2(force, exp (1.0))", r"calls atan2, exp; .*portable_tanh\(double x\)"),
        ('"creep_stiffness", "', '"force", "', "parameter 'force' cannot be a name in C code"),
        ('"creep_stiffness", "', '"double", "', "parameter 'double' cannot be a name"),
        ('"creep_stiffness", "', '"shared_0", "', "parameter 'shared_0' cannot be a name"),
        ('"creep_stiffness", "', '"portable_tanh", "', "parameter 'portable_tanh' cannot be a name"),
        ('"creep_stiffness", "', '"k; #include", "', "parameter 'k; #include' cannot be a name"),
        ('"creep_stiffness", "', '"Steifigkeit_ä", "', "parameter 'Steifigkeit_ä' cannot be a name"),
        ("memory=2", "memory=257", "creep/mean: keeps 257 numbers at 100 Hz; at most 256"),
        ("memory=2", "memory=-1", "creep/mean: keeps -1 numbers"),
        ('given["lag_time"]', 'given["tau"]', r"lag/first_order: .*c_step fail \(KeyError: 'tau'\)"),
        (
            '{"pole": float(',
            '{"lag_time": float(',
            "ValueError: constants have names of parameters: lag_time",
        ),
        ("float(np.exp(-T", "float(np.inf * np.exp(-T", "lag/first_order: pole becomes inf"),
    ],
)
def test_what_the_file_lacks_is_named(old, new, words, tmp_path):
    catalogue = rewritten(tmp_path, old, new)
    effects = (
        ("lag", "first_order", [], [0.05]),
        ("creep", "mean", [0.3], []),
        ("rectified", "size", [], []),
    )
    with pytest.raises(InputError, match=re.compile(words, re.DOTALL)):
        exported(catalogue, *effects)


@ON_LINUX
@pytest.mark.usefixtures("without_plots")
def test_c_code_that_says_something_else_than_the_simulation_is_refused(zig_cache, tmp_path):
    catalogue = rewritten(tmp_path, "creep_stiffness * (next[1] / next[0])", "creep_stiffness * next[1]")
    model = exported(catalogue, ("creep", "mean", [0.3], []))
    export_fmus([model], tmp_path, "own", TARGET, zig_cache)
    with pytest.raises(InputError, match="simulated output is off by"):
        check_fmus([model], tmp_path, 200, seed=5)


def test_a_comment_may_name_functions_that_code_may_not_call(tmp_path):
    catalogue = rewritten(tmp_path, '"fabs(force)"', '"fabs(force)", "// not tanh(force) /* sin(x) */"')
    assert exported(catalogue, ("rectified", "size", [], []))


def test_code_that_does_not_compile_leaves_no_fmu(zig_cache, tmp_path):
    catalogue = rewritten(tmp_path, "fabs(force)", "fabs(strength)")
    model = exported(catalogue, ("rectified", "size", [], []))
    folder = tmp_path / "fmu"
    folder.mkdir()
    with pytest.raises(InputError, match=r"(?s)compiling for x86_64-linux failed.*strength"):
        export_fmus([model], folder, "own", TARGET, zig_cache)
    assert not list(folder.iterdir())


def test_an_equation_that_cannot_be_set_is_named(zig_cache, tmp_path):
    catalogue = rewritten(tmp_path, '"|F| */ ??/\\n|F|"', '"\\\\nonsense{F"')
    model = exported(catalogue, ("rectified", "size", [], []))
    with pytest.raises(InputError, match=r"equation .*nonsense.* LaTeX that can be set"):
        export_fmus([model], tmp_path / "fmu", "own", TARGET, zig_cache)
