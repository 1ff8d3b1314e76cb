"""FMUs of models of several axes: every form, both versions of FMI against an integration of its own, vectors as FMI has them."""

from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest
from c_programs import CLIENT, DAMPING, ON_LINUX, energies, loader_program
from driven_fmu import DrivenFmu, DrivenInstance
from effect_entries import FORM_NUMBERS
from fmpy.fmi1 import FMICallException
from fmu_behaviour import problems_of
from runtime_models import TARGET, export, forces_of, unzipped
from spatial_models import FIVE, FRAME, STIFFNESS, integrated, spatial_export, spatial_model

from lumbar.base.errors import InputError
from lumbar.settings.runtime import RuntimeSettings
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.fmu.build.export_model import export_models
from lumbar.tissue.fmu.fmu_check import check_fmus

pytestmark = ON_LINUX
AXES = ("x", "y", "z")


def numbers_in_space(key: str) -> tuple[list, list] | None:
    """Numbers of a form in space; None where it has no meaning there."""
    effect, name = key.split("/")
    form = next(item for item in TISSUE[effect].forms if item.name == name)
    try:
        linear = form.to_space(AXES).linear
    except InputError:
        return None
    given, nonlinear = FORM_NUMBERS[key]
    return [value for value in given for _ in range(len(linear) // len(given))] if given else [], nonlinear


def combinations() -> list[dict]:
    """Every form in space once, no two of one effect together."""
    forms: dict[int, dict] = defaultdict(dict)
    counts: dict[str, int] = defaultdict(int)
    for key in FORM_NUMBERS:
        if (numbers := numbers_in_space(key)) is not None:
            effect = key.split("/")[0]
            forms[counts[effect]][key] = numbers
            counts[effect] += 1
    alone = {"drift/linear": ([0.4] * 3, []), "saturation/sharp_y": ([], [0.5])}
    return [*forms.values(), alone, {"saturation/sharp_xz": ([], [0.5, 0.3])}]


@pytest.mark.parametrize("effects", combinations(), ids=lambda effects: f"{len(effects)} effects")
def test_forms_in_space_agree_with_the_catalogue(effects, tmp_path):
    model = spatial_export(effects)
    export([model], tmp_path)
    for check in check_fmus([model], tmp_path, 400, seed=5):
        assert check.largest_output > 0.1


def test_model_of_two_axes_with_every_guard_agrees_with_its_description(tmp_path):
    """Moving average, limits of the vector's length, passivity: the library does what description and reference say."""
    guards = {"moving_average_ms": 3.0, "output_rate_limit": 300.0, "device_damping": 2.75}
    model = spatial_export({"delay/pure": FIVE["delay/pure"]}, ("x", "z"), **guards)
    export([model], tmp_path)
    check_fmus([model], tmp_path, 1500, seed=4)
    for version in (2, 3):
        assert problems_of(fmu_of(tmp_path, version)) == []


def test_model_counts_from_the_rest_of_its_tissue(tmp_path):
    """A robot's foot elsewhere: every start value and offset along its own axis, and the force that of the way from there."""
    rests = (300.0, -450.0, 120.0)
    settings = RuntimeSettings(rate_Hz=1000.0, moving_average_ms=0, start="offset")
    (model,) = export_models([replace(spatial_model({}), rests=rests)], settings)
    export([model], tmp_path)
    check_fmus([model], tmp_path, 300, seed=4)
    for version in (2, 3):
        fmu = fmu_of(tmp_path, version)
        assert problems_of(fmu) == []
        assert [fmu.numbered("start")[f"position_offset[{row}]"] for row in (1, 2, 3)] == list(rests)
    still = DrivenInstance(fmu).play(np.repeat([rests], 5, axis=0))
    np.testing.assert_allclose(still, 0.0, atol=1e-12)
    assert np.linalg.norm(DrivenInstance(fmu).play(np.repeat([np.add(rests, 1.0)], 5, axis=0))[-1]) > 0.5


@pytest.fixture(scope="module")
def five(tmp_path_factory):
    """Folder of the FMUs of KB with five effects, at 1 kHz."""
    folder = tmp_path_factory.mktemp("five")
    export([spatial_export(FIVE)], folder)
    return folder


def fmu_of(folder, version: int) -> DrivenFmu:
    (path,) = folder.glob(f"*_fmi{version}.fmu")
    return DrivenFmu(unzipped(path, folder / str(version)))


@pytest.mark.parametrize("version", [2, 3])
def test_forces_agree_with_an_independent_integration(version, five):
    generator = np.random.default_rng(8)
    walk = np.cumsum(generator.standard_normal((3000, 3)), axis=0) * 0.02
    walk[1000:1200] = walk[1000]  # at rest, without a direction of travel
    walk -= walk[0]
    expected = integrated(walk, 1e-3)
    if version == 2:
        expected = np.concatenate([expected[:1], expected[:-1]])
    (path,) = five.glob(f"*_fmi{version}.fmu")
    assert np.abs(expected).max(axis=0).min() > 0.5
    assert np.abs(forces_of(path, walk) - expected).max() <= 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("version", [2, 3])
def test_vectors_are_set_or_rejected_as_a_whole(version, five):
    """FMI 2.0 has scalars with names of elements, FMI 3.0 arrays; no longer force than its limit, in its direction."""
    fmu = fmu_of(five, version)
    assert fmu.parts("force_offset") == [f"force_offset[{k}]" for k in (1, 2, 3)]
    assert ("position" in fmu.variables) == (version == 3)
    page = (fmu.folder / "documentation" / "index.html").read_text(encoding="utf-8")
    assert f"spring_stiffness = {((FRAME * STIFFNESS) @ FRAME.T)[0, 0]:.6g} " in page
    instance = DrivenInstance(fmu, event_mode=version == 3)
    instance.write("position", [1.0, -2.0, 0.5])
    force = np.array(instance.read("force"))
    slopes = [[instance.derivative(f"force[{i}]", f"position[{j}]") for j in (1, 2, 3)] for i in (1, 2, 3)]
    np.testing.assert_allclose(slopes, np.transpose(slopes), atol=1e-6)
    assert np.abs(slopes[0][1]) > 0.05
    instance.set("force_limit", 0.5)
    np.testing.assert_allclose(instance.read("force"), 0.5 * force / np.linalg.norm(force), rtol=1e-14)
    assert not instance.accepts("force_offset[2]", 16.0)
    if version == 3:
        vector = [fmu.variables["position"].valueReference]
        for wrong in ([1.0], [1.0] * 4):
            with pytest.raises(FMICallException):
                instance.slave.setFloat64(vector, wrong)
        instance.slave.setFloat64(vector, [9.0, np.nan, 9.0])
        assert instance.read("position") == [1.0, -2.0, 0.5]


def test_contact_and_crosstalk_are_not_exported_in_space():
    with pytest.raises(InputError, match=r"runtime\.contact.*x, y, z"):
        spatial_export({}, contact=True)
    turned = spatial_export({"crosstalk/couplings": ([], [0.1] * 6)})
    assert "crosstalk" in turned.runtime
    moved = np.cumsum(np.ones((5, 3)), axis=0)
    np.testing.assert_array_equal(
        turned.dynamics.response(moved), spatial_export({}).dynamics.response(moved)
    )
    assert spatial_model(FIVE).to_json()["structure"]["space"]["axes"] == list(AXES)


@pytest.mark.parametrize("steps", [100_000, pytest.param(10_000_000, marks=pytest.mark.nightly)])
def test_device_and_fmu_never_release_more_than_they_received(steps, zig_cache, tmp_path):
    """An adversarial hand in three axes; then it also switches the tissue, scales it, and moves where it rests."""
    model = spatial_export(FIVE, device_damping=DAMPING)
    export([model], tmp_path)
    client = loader_program(CLIENT, TARGET[0], tmp_path, zig_cache)
    for gain in (0.0, model.settings.gain_limit):
        least = energies(client, model, tmp_path, steps, gain)
        assert min(least[:3]) >= -1e-12
        assert min(least[3:]) > 0.01
