"""Forces made to be felt: start at rest, contact, rate limit and passivity, in Python and C alike."""

import zipfile

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
    SETTINGS,
    TARGET,
    entry,
    get,
    models_json,
    put,
    random_motion,
    selected,
)

from lumbar.base.errors import InputError
from lumbar.tissue.fmu.build.package import export_fmus
from lumbar.tissue.fmu.build.reference_response import reference_output
from lumbar.tissue.fmu.conventions import slow_push
from lumbar.tissue.fmu.fmu_check import check_fmus, simulate_fmu
from study_settings import changed

pytestmark = ON_LINUX
DEVICE = changed(
    SETTINGS, models=["IL", "MW", "KB", "HO"], rate_Hz=1000.0, moving_average_ms=3.0, start="first_position"
)
"""What is exported by default."""
EFFECTS = effect_entry(*COMBINATIONS[0])
HIGH_ORDER = entry("HO", [0.0, 5.0, -8.0, 3.5], [1.0, 0.1, -0.2, 0.05])
"""As in the default study: a sample late, and with poles that no continuous model has."""


def models(settings, *entries):
    """Models of the shared entries, one of high order and one with effects."""
    content = models_json()["models"]
    content = [item for item in content if item["name"] != "HO"] + [HIGH_ORDER, EFFECTS, *entries]
    names = [item["name"] for item in content]
    return selected(models_json(*content), changed(settings, models=names))


def exported(settings, folder, cache, *names):
    chosen = [model for model in models(settings) if not names or model.name in names]
    export_fmus(chosen, folder, "synthetic twin", TARGET, cache)
    return chosen


@pytest.mark.parametrize(
    ("guards", "names"),
    [
        ({}, ("HO", EFFECTS["name"])),
        ({"moving_average_ms": 30.0}, ("HO",)),
        ({"contact": True}, (EFFECTS["name"],)),
        ({"output_rate_limit": 200.0}, ("HO",)),
        ({"device_damping": DAMPING}, (EFFECTS["name"],)),
        pytest.param(
            {"contact": True, "output_rate_limit": 300.0, "device_damping": DAMPING, "start": "offset"},
            ("IL", "MW", "HO", EFFECTS["name"]),
            marks=pytest.mark.nightly,
        ),
    ],
    ids=["default", "30 ms", "contact", "rate", "passive", "all"],
)
def test_fmus_at_1_khz_pass_all_checks(guards, names, zig_cache, tmp_path):
    """Delays, models several times over, effects and every guard: FMU against Python, in both versions."""
    chosen = exported(changed(DEVICE, **guards), tmp_path, zig_cache, *names)
    for check in check_fmus(chosen, tmp_path, 1500, seed=4):
        # An inverted model that cannot pull gives no force at all.
        assert (check.largest_output > 0.05) != (check.model.name == "IL" and guards.get("contact", False)), (
            check.file
        )


@pytest.mark.parametrize("rate", [None, 1000.0])
def test_a_model_starts_at_rest_where_it_is_first_touched(rate, zig_cache, tmp_path):
    """Thesis's start for comparison: from the offset, where a first position of 3 mm is a jump."""
    settings = changed(DEVICE, rate_Hz=rate, moving_average_ms=30.0)
    chosen = exported(settings, tmp_path, zig_cache, "KB", "HO", EFFECTS["name"])
    for model in chosen:
        for version in ("2.0", "3.0"):
            path = tmp_path / f"{model.name}_fmi{version[0]}.fmu"
            forces = simulate_fmu(path, np.full(60, 3.0))
            np.testing.assert_allclose(forces, forces[0], atol=1e-12)
            if model.name in ("KB", "HO"):
                gain = sum(model.dynamics.numerator) / sum(model.dynamics.denominator)
                assert forces[0] == pytest.approx(3.0 * gain, rel=1e-12)
    thesis = models(changed(settings, start="offset"))
    jumping = next(model for model in thesis if model.name == "HO")
    assert np.ptp(reference_output(jumping, np.full(60, 3.0), "3.0")) > 5.0


def test_an_integrator_rests_nowhere_else():
    integrator = entry("KB", [1.0, -0.5], [1.0, -1.0])
    with pytest.raises(InputError, match=r"runtime\.start.*a pole at 1.*offset"):
        selected(models_json(integrator), changed(DEVICE, models=["KB"], unstable="export"))


@pytest.mark.parametrize("name", ["IL", "KB", EFFECTS["name"]])
def test_contact_does_not_pull(name):
    """A tool lifted to −2 mm and brought back; the inverted model, displayed like the others, would draw it in."""
    motion = np.concatenate(
        [np.linspace(0, 3, 200), np.linspace(3, -2, 200), np.full(200, -2.0), np.linspace(-2, 0, 50)]
    )
    free, touched = (
        reference_output(model, motion, "3.0")
        for settings in (DEVICE, changed(DEVICE, contact=True))
        for model in models(settings)
        if model.name == name
    )
    assert free.min() < -0.2
    lifted = int(np.argmax(motion < 0))
    np.testing.assert_array_equal(touched[:lifted], np.where(free < 0, 0.0, free)[:lifted])
    assert np.abs(touched[lifted + 3 :]).max() == 0.0  # not felt before it is touched again


@pytest.mark.parametrize("version", [2, 3])
def test_the_force_changes_no_faster_than_its_limit(version, zig_cache, tmp_path):
    chosen = exported(changed(DEVICE, output_rate_limit=300.0), tmp_path, zig_cache, "KB", EFFECTS["name"])
    for model in chosen:
        jumps = np.repeat([0.0, 6.0, -6.0, 1.0], 100)
        path = tmp_path / f"{model.name}_fmi{version}.fmu"
        forces = simulate_fmu(path, jumps)
        assert np.abs(np.diff(forces, prepend=0.0)).max() <= 0.3 * (1 + 1e-12)
    with zipfile.ZipFile(tmp_path / f"KB_fmi{version}.fmu") as archive:
        text = archive.read("modelDescription.xml").decode()
    assert 'name="force_rate_limit"' in text
    assert 'unit="N/s" min="0.0" max="300.0" nominal="300.0" start="300.0"' in text


@pytest.mark.parametrize(
    ("settings", "names"),
    [
        pytest.param(DEVICE, ("IL", "KB", "HO", EFFECTS["name"]), marks=pytest.mark.nightly),
        (changed(SETTINGS, start="first_position"), ("HO", EFFECTS["name"])),
    ],
    ids=["1 kHz", "100 Hz"],
)
def test_device_and_fmu_never_give_out_more_than_they_took_in(settings, names, zig_cache, tmp_path):
    """A hand that means harm takes a hundred thousand steps; the energies are those that it counts itself.

    Then it also switches the tissue, scales it, and moves where it rests.
    """
    chosen = exported(changed(settings, device_damping=DAMPING), tmp_path, zig_cache, *names)
    client = loader_program(CLIENT, TARGET[0], tmp_path, zig_cache)
    for model in chosen:
        for gain in (0.0, model.settings.gain_limit):
            found = energies(client, model, tmp_path, 100_000, gain)
            assert min(found[:3]) >= -1e-12, model.name
            assert min(found[3:]) > 0.01, model.name
    unguarded = [model for model in models(settings) if model.name == "HO"]
    export_fmus(unguarded, tmp_path / "free", "synthetic twin", TARGET, zig_cache)
    assert max(energies(client, unguarded[0], tmp_path / "free", 100_000)[:3]) < -0.1


def test_guards_can_be_lowered_while_the_model_runs(zig_cache, tmp_path, fmu_instance):
    settings = changed(DEVICE, models=["KB"], output_rate_limit=300.0, device_damping=DAMPING)
    export_fmus(selected(models_json(), settings), tmp_path, "synthetic twin", TARGET, zig_cache)
    slave = fmu_instance("KB", 3, event_mode=True, folder=tmp_path)
    slave.exitInitializationMode()
    assert [get(slave, reference) for reference in (7, 8, 9, 10)] == [300.0, DAMPING, 0.2, 0.0]
    for reference, value in ((FORCE_RATE_LIMIT, 301.0), (8, -1.0), (9, 2000.0), (ENERGY, 1.0)):
        with pytest.raises(Exception, match="SetFloat64"):
            put(slave, reference, value)
    put(slave, 8, 0.0)  # a device without damping: no force can be held without risk
    for k in range(50):
        put(slave, 1, 0.1 * k)
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
        put(slave, GAIN, gain)
        put(slave, POSITION, position)
        forces[k] = get(slave)
        slave.enterStepMode()
        if "passive" in slave.unzipDirectory:
            energies[k] = get(slave, ENERGY)
        slave.doStep(k * 1e-3, 1e-3)
        slave.enterEventMode()
    return forces, energies


@pytest.fixture(scope="module")
def kelvin(zig_cache, tmp_path_factory):
    """KB of 0.9 N/mm, and as much again that relaxes: as it is, and passive on a device with damping."""
    content = models_json(entry("KB", [1.9, -1.2], [1.0, -0.2], valid_for={**RANGE, "highest": 4.0}))
    found = {}
    for name, damping in (("free", None), ("passive", DAMPING)):
        settings = changed(DEVICE, models=["KB"], device_damping=damping, moving_average_ms=0)
        found[name] = tmp_path_factory.mktemp("gain") / name
        (model,) = selected(content, settings)
        export_fmus([model], found[name], "synthetic twin", TARGET, zig_cache)
    return found, model


def test_what_a_rise_gives_out_is_said(kelvin, fmu_instance):
    """Pushed in while the tissue is off, let out while it is on: force and energy are those of the file's own page."""
    folders, model = kelvin
    way = 4.0 * slow_push(model.sampling_time)
    off = np.zeros(len(way))
    positions, gains = np.concatenate([way, way[::-1]]), np.concatenate([off, off + 1])
    forces, _ = switching(folders["free"], fmu_instance, positions, gains)
    given = -1000 * 1e-3 * float(forces[:-1] @ np.diff(positions))
    with zipfile.ZipFile(folders["free"] / "KB_fmi3.fmu") as archive:
        page = archive.read("documentation/index.html").decode()
    assert f" {forces[len(way)]:.2g} N " in page and f" {given:.2g} mJ" in page
    assert given > 5.0


def test_a_tissue_that_is_switched_on_begins_with_nothing(kelvin, fmu_instance):
    """Nothing of what was dissipated before pushes the tool out; it is all there a millimetre deeper, and at the next touch."""
    folders, _ = kelvin
    shaken = 2.0 + 2.0 * np.cos(np.pi * np.arange(2000) / 50)
    held, deeper, out = np.full(500, 4.0), np.linspace(4.0, 5.0, 200), np.linspace(5.0, 0.0, 200)
    again = np.linspace(0.0, 4.0, 400)
    positions = np.concatenate([shaken, held, held, deeper, out, again])
    gains = np.where((np.arange(len(positions)) >= 2000) & (np.arange(len(positions)) < 2500), 0.0, 1.0)
    free, _ = switching(folders["free"], fmu_instance, positions, gains)
    found, energies = switching(folders["passive"], fmu_instance, positions, gains)
    assert energies[1900] > 0.01
    assert np.abs(free[2500:3000]).min() > 3.0
    assert not found[2500:3000].any()
    touched = slice(3000 + 200 + 200 + 5, None)
    np.testing.assert_allclose(found[3199], free[3199], rtol=1e-12)
    np.testing.assert_allclose(found[touched], free[touched], rtol=1e-12)


def test_the_account_is_exact_whatever_the_gain_does(kelvin, fmu_instance):
    """The FMU's energy against one counted from forces and positions alone, less what rises take of it."""
    folders, _ = kelvin
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
    with pytest.raises(InputError, match="device_damping"):
        selected(models_json(odd), changed(DEVICE, models=["KB"], device_damping=1.0))
