"""Guards of the force: start at rest, rate limit, passivity, and changes of the gain."""

import numpy as np
import pytest
from c_programs import CLIENT, DAMPING, ON_LINUX, energies, loader_program
from effect_entries import COMBINATIONS, effect_entry
from runtime_models import (
    ENERGY,
    FORCE_RATE_LIMIT,
    GAIN,
    POSITION,
    RANGE,
    TARGET,
    contents,
    device_models,
    entry,
    export,
    exported,
    forces_of,
    get,
    random_motion,
    set_variable,
)

import lumbar

pytestmark = ON_LINUX
EFFECTS = effect_entry(*COMBINATIONS[0])["name"]


def test_integrator_cannot_start_at_rest():
    integrator = entry("KB", [1.0, -0.5], [1.0, -1.0])
    with pytest.raises(lumbar.InputError, match=r"runtime\.start\b.*\bpole\b.*\b1\b.*\boffset\b"):
        exported(integrator, start="first_position", unstable="export")


@pytest.mark.parametrize("version", [2, 3])
def test_force_changes_no_faster_than_its_limit(version, tmp_path):
    models = device_models("KB", EFFECTS, output_rate_limit=300.0)
    export(models, tmp_path)
    for model in models:
        jumps = np.repeat([0.0, 6.0, -6.0, 1.0], 100)
        forces = forces_of(tmp_path / f"{model.name}_fmi{version}.fmu", jumps)
        assert np.abs(np.diff(forces, prepend=0.0)).max() <= 0.3 * (1 + 1e-12)
    text = contents(tmp_path / f"KB_fmi{version}.fmu")["modelDescription.xml"].decode()
    assert 'name="force_rate_limit"' in text
    assert 'unit="N/s" min="0.0" max="300.0" nominal="300.0" start="300.0"' in text


@pytest.mark.parametrize(
    ("settings", "names"),
    [
        pytest.param({}, ("IL", "KB", "HO", EFFECTS), marks=pytest.mark.nightly),
        ({"rate_Hz": None, "moving_average_ms": 30.0}, ("HO", EFFECTS)),
    ],
    ids=["1 kHz", "100 Hz"],
)
def test_device_and_fmu_never_release_more_than_they_received(settings, names, zig_cache, tmp_path):
    """An adversarial hand takes a hundred thousand steps; the energies are those that it counts itself.

    Then it also switches the tissue, scales it, and moves where it rests.
    """
    models = device_models(*names, device_damping=DAMPING, **settings)
    export(models, tmp_path)
    client = loader_program(CLIENT, TARGET[0], tmp_path, zig_cache)
    for model in models:
        for gain in (0.0, model.settings.gain_limit):
            least = energies(client, model, tmp_path, 100_000, gain)
            assert min(least[:3]) >= -1e-12, model.name
            assert min(least[3:]) > 0.01, model.name
    (unguarded,) = device_models("HO", **settings)
    export([unguarded], tmp_path / "free")
    assert max(energies(client, unguarded, tmp_path / "free", 100_000)[:3]) < -0.1


def test_guards_can_be_lowered_while_the_model_runs(tmp_path, fmu_instance):
    export(device_models("KB", output_rate_limit=300.0, device_damping=DAMPING), tmp_path)
    slave = fmu_instance("KB", 3, event_mode=True, folder=tmp_path)
    slave.exitInitializationMode()
    assert [get(slave, reference) for reference in (7, 8, 9, 10)] == [300.0, DAMPING, 0.2, 0.0]
    for reference, value in ((FORCE_RATE_LIMIT, 301.0), (8, -1.0), (9, 2000.0), (ENERGY, 1.0)):
        with pytest.raises(Exception, match="SetFloat64"):
            set_variable(slave, reference, value)
    set_variable(slave, 8, 0.0)  # a device without damping: no force can be held without risk
    for k in range(50):
        set_variable(slave, 1, 0.1 * k)
        assert get(slave) == 0.0
        slave.enterStepMode()
        slave.doStep(k * 1e-3, 1e-3)
        slave.enterEventMode()


def switching(folder, fmu_instance, positions, gains) -> tuple[np.ndarray, np.ndarray]:
    """Forces and, where there is one, energies at these positions and gains, sample by sample in event mode."""
    slave = fmu_instance("KB", 3, event_mode=True, folder=folder)
    slave.exitInitializationMode()
    forces, energies = np.zeros((2, len(positions)))
    for k, (position, gain) in enumerate(zip(positions, gains, strict=True)):
        set_variable(slave, GAIN, gain)
        set_variable(slave, POSITION, position)
        forces[k] = get(slave)
        slave.enterStepMode()
        if "passive" in slave.unzipDirectory:
            energies[k] = get(slave, ENERGY)
        slave.doStep(k * 1e-3, 1e-3)
        slave.enterEventMode()
    return forces, energies


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """KB of 0.9 N/mm, and as much again that relaxes: without guards, and passive on a device with damping."""
    relaxing = entry("KB", [1.9, -1.2], [1.0, -0.2], valid_for={**RANGE, "highest": 4.0})
    folders = {}
    for name, damping in (("free", None), ("passive", DAMPING)):
        settings = {
            "rate_Hz": 1000.0,
            "start": "first_position",
            "moving_average_ms": 0,
            "device_damping": damping,
        }
        folders[name] = tmp_path_factory.mktemp("gain") / name
        export([exported(relaxing, **settings)], folders[name])
    return folders


def test_page_states_the_energy_of_a_rise_of_the_gain(folders, fmu_instance):
    """Pushed in while the tissue is off, let out while it is on: force and energy are those of the file's page."""
    path = 4.0 * np.linspace(0.0, 1.0, 200)
    off = np.zeros(len(path))
    positions, gains = np.concatenate([path, path[::-1]]), np.concatenate([off, off + 1])
    forces, _ = switching(folders["free"], fmu_instance, positions, gains)
    released = -1000 * 1e-3 * float(forces[:-1] @ np.diff(positions))
    page = contents(folders["free"] / "KB_fmi3.fmu")["documentation/index.html"].decode()
    assert f" {forces[len(path)]:.2g} N " in page and f" {released:.2g} mJ" in page
    assert released > 5.0


def test_tissue_that_is_switched_on_begins_without_energy(folders, fmu_instance):
    """No energy of before pushes the tool out; the whole force is there a millimetre deeper, and at the next touch."""
    shaken = 2.0 + 2.0 * np.cos(np.pi * np.arange(2000) / 50)
    held, deeper, out = np.full(500, 4.0), np.linspace(4.0, 5.0, 200), np.linspace(5.0, 0.0, 200)
    again = np.linspace(0.0, 4.0, 400)
    positions = np.concatenate([shaken, held, held, deeper, out, again])
    gains = np.where((np.arange(len(positions)) >= 2000) & (np.arange(len(positions)) < 2500), 0.0, 1.0)
    free, _ = switching(folders["free"], fmu_instance, positions, gains)
    forces, energies = switching(folders["passive"], fmu_instance, positions, gains)
    assert energies[1900] > 0.01
    assert np.abs(free[2500:3000]).min() > 3.0
    assert not forces[2500:3000].any()
    touched = slice(3000 + 200 + 200 + 5, None)
    np.testing.assert_allclose(forces[3199], free[3199], rtol=1e-12)
    np.testing.assert_allclose(forces[touched], free[touched], rtol=1e-12)


def test_energy_is_exact_at_any_change_of_the_gain(folders, fmu_instance):
    """The FMU's energy against one counted from forces and positions, less the part that rises take of it."""
    generator = np.random.default_rng(3)
    positions = random_motion(3000, seed=9)
    gains = np.repeat(generator.choice([0.0, 0.5, 1.0, 1.2, 10.0], 300), 10)
    forces, energies = switching(folders["passive"], fmu_instance, positions, gains)
    moved = 1e-3 * np.diff(positions)
    energy, expected = 0.0, [0.0]
    for k, (force, step) in enumerate(zip(forces[:-1], moved, strict=True)):
        energy = min(energy + force * step + DAMPING * step**2 / 1e-3, 0.2)
        energy *= min(1.0, gains[k] / gains[k + 1]) if gains[k + 1] else 1.0
        expected.append(energy)
    np.testing.assert_allclose(energies, expected, rtol=0, atol=1e-15)
    assert min(expected) >= 0.0


def test_energies_need_units_of_work():
    odd = entry("KB", [1.9, -1.2], [1.0, -0.45], input={"quantity": "angle", "unit": "deg", "offset": 0.0})
    with pytest.raises(lumbar.InputError, match="device_damping"):
        exported(odd, device_damping=1.0)
