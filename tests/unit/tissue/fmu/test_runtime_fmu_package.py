"""Building FMUs: reproducible bytes, platforms, compiling, places that cannot be written, and checks of finished files."""

import re
import shutil
import struct
from contextlib import nullcontext
from types import SimpleNamespace

import fmpy
import numpy as np
import pytest
from c_programs import DAMPING, ON_LINUX, CModel
from effect_entries import COMBINATIONS, FIVE_EFFECTS, effect_entry
from runtime_models import (
    RANGE,
    SETTINGS,
    TARGET,
    contents,
    device_models,
    entry,
    export,
    exported,
    forces_of,
    models_json,
    selected,
)

import lumbar
from lumbar.base.errors import InputError
from lumbar.tissue.effects.catalogue import CATALOGUES
from lumbar.tissue.fmu.build import compiler, package
from lumbar.tissue.fmu.build.compiler import TARGETS, compile_library, host_target, resolve_targets
from lumbar.tissue.fmu.build.package import export_fmus, fmu_contents, universal_library, write_fmu
from lumbar.tissue.fmu.build.reference_response import reference_output
from lumbar.tissue.fmu.fmu_check import check_fmus, check_table, push, validate_new_files
from lumbar.tissue.models.fitted_model import models_document, read_models
from lumbar.tissue.models.model_data import identifier
from lumbar.tissue.signals.spectrum import motion_range
from lumbar.twin.examples import example_records
from study_settings import changed

EFFECTS = effect_entry(*COMBINATIONS[0])
pytestmark = ON_LINUX


def test_identifiers_are_c_names():
    assert identifier("KB+coulomb_friction") == "KB_coulomb_friction"
    assert identifier("2nd") == "_2nd"
    assert identifier("Kraft (Säge)") == "Kraft__S_ge_"


def test_valid_range_is_the_motion_of_the_training_record():
    """For a sine in closed form, and for a fit."""
    time = np.arange(4000) * 0.01
    covered = motion_range(1.0 + 2.0 * np.sin(2 * np.pi * 0.5 * time), 0.01)
    assert (covered.lowest, covered.highest) == pytest.approx((-1.0, 3.0))
    assert covered.speed == pytest.approx(2.0 * np.pi, rel=1e-2)
    assert (covered.lowest_Hz, covered.highest_Hz) == pytest.approx((0.5, 0.5))
    records = example_records()
    fitted = next(model for model in lumbar.identify(records) if model.name == "KB")
    position = records[fitted.trained_on]["input"]
    assert (fitted.valid_for.lowest, fitted.valid_for.highest) == (position.min(), position.max())
    (model,) = read_models(models_json(entry("KB", [1.9], [1.0], valid_for=RANGE)), CATALOGUES)
    assert models_document([model], "test")["models"][0]["valid_for"] == RANGE


def test_names_are_escaped_everywhere(fmu_folder):
    for version in (2, 3):
        path = fmu_folder / f"KB+coulomb_friction_fmi{version}.fmu"
        description = fmpy.read_model_description(str(path), validate=True)
        assert description.modelName == "KB+coulomb_friction"
        assert description.coSimulation.modelIdentifier == "KB_coulomb_friction"
        assert "A & B <lab>" in description.description
        assert b"A &amp; B &lt;lab&gt;" in contents(path)["documentation/index.html"]


@pytest.mark.nightly
def test_export_from_another_folder_and_cold_cache_gives_the_same_bytes(
    fmu_models, fmu_folder, zig_cache, tmp_path
):
    kb = next(model for model in fmu_models if model.name == "KB")
    models = [kb, exported(effect_entry(*COMBINATIONS[1]))]
    first, again = (
        export_fmus(models, tmp_path / folder, "synthetic twin", TARGET, cache)
        for folder, cache in (("one", zig_cache), ("another folder", tmp_path / "cold cache"))
    )
    for paths in (again, sorted(fmu_folder.glob("KB_fmi?.fmu"))):
        assert all(one.read_bytes() == other.read_bytes() for one, other in zip(first, paths, strict=False))


def test_libraries_need_an_old_c_library_only(fmu_folder):
    library = contents(fmu_folder / "KB_fmi3.fmu")["binaries/x86_64-linux/KB.so"]
    versions = {part.split(b"\0")[0] for part in library.split(b"GLIBC_")[1:]}
    assert versions
    assert max(tuple(map(int, version.split(b"."))) for version in versions) <= (2, 17)


def test_rejected_sources_show_the_compilers_output(fmu_models, zig_cache, tmp_path):
    (tmp_path / "broken.c").write_text("int f(void) { return nonsense; }\n")
    with pytest.raises(InputError, match=r"(?s)x86_64-linux.*exit code 1.*'nonsense'"):
        compile_library([tmp_path / "broken.c"], tmp_path / "broken.so", "x86_64-linux", zig_cache)
    with pytest.raises(InputError, match=r"runtime\.targets.*pdp11.*x86_64-linux"):
        export_fmus(fmu_models[:1], tmp_path, "", ["pdp11"], zig_cache)


@pytest.fixture
def nothing_compiled():
    """Let this process forget what it has compiled."""
    compiler.compile_sources.cache_clear()


@pytest.mark.usefixtures("nothing_compiled")
def test_compiler_that_fails_silently_is_an_error(fmu_models, zig_cache, tmp_path, monkeypatch):
    """Killed, or done without a library: both leave no FMU."""
    (tmp_path / "ziglang").mkdir()
    (tmp_path / "ziglang" / "__init__.py").touch()
    monkeypatch.setattr(
        compiler, "find_spec", lambda _: SimpleNamespace(origin=str(tmp_path / "ziglang" / "__init__.py"))
    )
    program = tmp_path / "ziglang" / "zig"
    for body, message in (("", "exit code 0"), ("kill -ABRT $$\n", "exit code -6")):
        program.write_text(f"#!/bin/sh\n{body}")
        program.chmod(0o755)
        with pytest.raises(
            InputError, match=rf"(?s)x86_64-linux.*{message}\b.*{re.escape(str(zig_cache))}.*no output"
        ):
            export_fmus(fmu_models[:1], tmp_path / "fmu", "", TARGET, zig_cache)
    assert not (tmp_path / "fmu").exists()


@pytest.mark.usefixtures("nothing_compiled")
def test_places_that_cannot_be_written_are_named(fmu_models, fmu_folder, zig_cache, tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(InputError, match=r"runtime\.compiler_cache: .*file/cache"):
        export_fmus(fmu_models[:1], tmp_path, "", TARGET, blocked / "cache")
    with pytest.raises(InputError, match=r"file/fmu/\w+_fmi2\.fmu: .*Not a directory"):
        export_fmus(fmu_models[:1], blocked / "fmu", "", TARGET, zig_cache)
    compiler.compile_sources.cache_clear()
    with monkeypatch.context() as within, pytest.raises(InputError, match="TMPDIR"):
        within.setattr(compiler.tempfile, "TemporaryDirectory", lambda **_: nullcontext(tmp_path / "absent"))
        compiler.compile_sources((("a.c", b""),), ("a.c",), "a.so", TARGET[0], zig_cache)
    monkeypatch.setattr("lumbar.tissue.fmu.build.compiler.find_spec", lambda _: None)
    with pytest.raises(InputError, match="ziglang"):
        export_fmus(fmu_models[:1], tmp_path, "", TARGET, zig_cache)


def test_no_half_written_fmu(tmp_path, monkeypatch):
    written = []

    def fail_at_second(self, entry, content, *compression):
        written.append(entry)
        if len(written) == 2:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(package.zipfile.ZipFile, "writestr", fail_at_second)
    with pytest.raises(InputError, match=r"KB_fmi2\.fmu: .*No space left on device"):
        write_fmu(tmp_path / "KB_fmi2.fmu", {"modelDescription.xml": b"x", "a": b"y", "b": b"z"})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(
    shutil.which("cmake") is None, reason="no CMake, with which fmpy compiles FMUs: apt-get install cmake"
)
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler: apt-get install gcc libc6-dev")
@pytest.mark.parametrize(("name", "version"), [("KB", 3), ("KB+coulomb_friction", 2)])
def test_fmpy_compiles_the_exported_sources(name, version, fmu_folder, fmu_positions, tmp_path):
    """Without binaries, with another compiler: the sources in the FMU are complete, and give the same bits."""
    from fmpy.build import build_platform_binary

    unzipped, shipped = tmp_path / "fmu", fmu_folder / f"{name}_fmi{version}.fmu"
    fmpy.extract(str(shipped), str(unzipped))
    shutil.rmtree(unzipped / "binaries")
    build_platform_binary(unzipped, generator="Unix Makefiles")
    files = {
        str(path.relative_to(unzipped)): path.read_bytes()
        for path in sorted(unzipped.rglob("*"))
        if path.is_file()
    }
    write_fmu(tmp_path / shipped.name, files)
    built = forces_of(tmp_path / shipped.name, fmu_positions)
    np.testing.assert_array_equal(built, forces_of(shipped, fmu_positions))


@pytest.mark.nightly
def test_all_platforms_fit_into_200_kilobytes(zig_cache, tmp_path):
    """A linear model, and the most effects that a diagnosis adds at the rate of a haptic loop."""
    chosen = changed(SETTINGS, models=[FIVE_EFFECTS["name"]], rate_Hz=1000, moving_average_ms=3.0)
    models = [selected(models_json(), changed(SETTINGS, models=["KB"]))[0]]
    models += selected(models_json(FIVE_EFFECTS), chosen)
    for path in export_fmus(models, tmp_path, "synthetic twin", list(TARGETS), zig_cache):
        assert path.stat().st_size <= 200_000, path.name


def test_folders_of_libraries_follow_each_standard(fmu_models):
    """FMI 2.0 has its own names of platforms and one macOS; FMI 3.0 names processor and system."""
    mach_o = struct.pack("<III", 0xFEEDFACF, 0x01000007, 3) + b"code"
    folders = {
        version: {
            name.split("/")[1]
            for name in fmu_contents(fmu_models[0], version, "", dict.fromkeys(TARGETS, mach_o))
            if "binaries" in name
        }
        for version in ("2.0", "3.0")
    }
    assert folders["2.0"] == {"linux64", "win64", "darwin64", "aarch64-linux"}
    processors = {"x86_64-linux", "x86_64-windows", "aarch64-linux", "x86_64-darwin", "aarch64-darwin"}
    assert folders["3.0"] == processors


def test_universal_library_is_read_back():
    """By the layout of mach-o/fat.h, written out here."""
    parts = [
        struct.pack("<III", 0xFEEDFACF, cpu, kind) + bytes([cpu & 255]) * 40_000
        for cpu, kind in ((7, 3), (12, 0))
    ]
    joined = universal_library(parts)
    assert struct.unpack_from(">II", joined) == (0xCAFEBABE, 2)
    for index, part in enumerate(parts):
        cpu, _, offset, size, align = struct.unpack_from(">IIIII", joined, 8 + 20 * index)
        assert cpu == part[4]
        assert offset % (1 << align) == 0
        assert joined[offset : offset + size] == part
    with pytest.raises(ValueError, match="Mach-O"):
        universal_library([b"\x7fELF" + bytes(20)])


def test_host_is_this_machine(monkeypatch):
    assert resolve_targets(["host"]) == [host_target()]
    assert resolve_targets(["x86_64-windows", "host", "x86_64-linux"])[0] == "x86_64-linux"
    monkeypatch.setattr(compiler, "machine", lambda: "ARM64")
    monkeypatch.setattr(compiler, "system", lambda: "Darwin")
    assert host_target() == "aarch64-darwin"
    monkeypatch.setattr(compiler, "machine", lambda: "riscv64")
    with pytest.raises(InputError, match=r"riscv64-darwin.*x86_64-linux"):
        host_target()
    with pytest.raises(InputError, match=r"runtime\.targets: .*host, x86_64-linux"):
        resolve_targets([])


def test_invalid_file_removes_its_export(fmu_folder, tmp_path):
    paths = [tmp_path / f"KB_fmi{version}.fmu" for version in (2, 3)]
    for path in paths:
        shutil.copy(fmu_folder / path.name, path)
    validate_new_files(paths)
    files = contents(paths[1])
    files["modelDescription.xml"] = files["modelDescription.xml"].replace(b"generationTool", b"generatedBy")
    write_fmu(paths[1], files)
    with pytest.raises(InputError, match=r"KB_fmi3\.fmu: .*generatedBy"):
        validate_new_files(paths)
    assert not any(path.exists() for path in paths)


def test_check_rejects_an_fmu_of_other_numbers(fmu_models, tmp_path):
    other = models_json(entry("KB", [1.9 * (1 + 1e-11), -1.2], [1.0, -0.45]))
    export(selected(other, changed(SETTINGS, models=["KB"])), tmp_path)
    valid = [model for model in fmu_models if model.name == "KB"]
    with pytest.raises(InputError, match=r"KB_fmi2\.fmu: .*\boutput\b.*1e-12"):
        check_fmus(valid, tmp_path, samples=200, seed=3)


def test_unstable_model_runs_into_its_limit_and_passes(tmp_path):
    settings = changed(SETTINGS, models=["MW"], unstable="export")
    unstable = selected(models_json(entry("MW", [0.0, 1.0], [1.0, -1.04])), settings)
    paths = export(unstable, tmp_path)
    checks = check_fmus(unstable, tmp_path, samples=1000, seed=3)
    assert max(check.largest_error for check in checks) < 1e-9
    assert b"UNSTABLE" in contents(paths[0])["modelDescription.xml"]


def test_table_names_the_delay_of_the_feedthrough(fmu_models, fmu_folder, tmp_path):
    table = check_table(check_fmus(fmu_models, fmu_folder, 100, 3), "synthetic twin", 3)
    feedthrough = dict(zip(table.frame["file"], table.frame["feedthrough"], strict=True))
    assert feedthrough["KB_fmi2.fmu"] == "one sample late"
    assert feedthrough["KB_fmi3.fmu"] == "at once"
    assert feedthrough["MW_fmi2.fmu"] == feedthrough["MW_fmi3.fmu"] == "none"
    table.write(tmp_path / "fmu_check")
    assert "Data: synthetic twin" in (tmp_path / "fmu_check.html").read_text(encoding="utf-8")


def test_push_is_followed_by_every_model(fmu_models, fmu_folder):
    outputs = push(fmu_models, fmu_folder)
    rest = {model.name: model.output.offset for model in fmu_models}
    for (name, version), forces in outputs.outputs.items():
        assert len(forces) == len(outputs.time), version
        assert abs(forces[:5] - rest[name]).max() < 0.5
    stiffest = max(np.abs(forces).max() for forces in outputs.outputs.values())
    assert 0.3 * 15 < stiffest < 15
    assert outputs.most_delayed in {"KB", "HO"}


def test_twenty_thousand_steps_differ_in_no_bit(fmu_models, zig_cache, tmp_path):
    """C code against Eqs 3.17 and 3.18 with lists in Python, states included."""
    model = next(model for model in fmu_models if model.name == "HO")
    system = model.dynamics.state_space
    matrix, column, row = system.A.tolist(), system.B[:, 0].tolist(), system.C[0].tolist()
    inputs = np.random.default_rng(11).standard_normal(20_000)
    state, expected = [0.0] * system.nstates, np.empty(len(inputs))
    for k, u in enumerate(inputs.tolist()):
        output, following = float(system.D[0, 0]) * u, []
        for i in range(system.nstates):
            output += row[i] * state[i]
            total = column[i] * u
            for j in range(system.nstates):
                total += matrix[i][j] * state[j]
            following.append(total)
        state, expected[k] = following, output
    compiled = CModel(model, tmp_path, zig_cache)
    np.testing.assert_array_equal(compiled.response(inputs), expected)
    assert compiled.state[: system.nstates] == state


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
def test_fmus_at_1_khz_pass_all_checks(guards, names, tmp_path):
    """Delays, models with several phases, effects and every guard: FMU against Python, in both versions."""
    models = device_models(*names, **guards)
    export(models, tmp_path)
    for check in check_fmus(models, tmp_path, 1500, seed=4):
        # An inverted model that cannot pull gives no force.
        has_force = check.model.name != "IL" or not guards.get("contact", False)
        assert (check.largest_output > 0.05) == has_force, check.file


@pytest.mark.parametrize("rate", [None, 1000.0])
def test_model_starts_at_rest_at_its_first_position(rate, tmp_path):
    """From the thesis's start, the offset, a first position of 3 mm is a jump."""
    settings = {"rate_Hz": rate, "moving_average_ms": 30.0}
    models = device_models("KB", "HO", EFFECTS["name"], **settings)
    export(models, tmp_path)
    for model in models:
        for version in (2, 3):
            forces = forces_of(tmp_path / f"{model.name}_fmi{version}.fmu", np.full(60, 3.0))
            np.testing.assert_allclose(forces, forces[0], atol=1e-12)
            if model.name in ("KB", "HO"):
                gain = sum(model.dynamics.numerator) / sum(model.dynamics.denominator)
                assert forces[0] == pytest.approx(3.0 * gain, rel=1e-12)
    (jumping,) = device_models("HO", start="offset", **settings)
    assert np.ptp(reference_output(jumping, np.full(60, 3.0), "3.0")) > 5.0


@pytest.mark.parametrize("name", ["IL", "KB", EFFECTS["name"]])
def test_contact_does_not_pull(name):
    """A tool lifted to −2 mm and brought back; the inverted model, displayed like the others, would draw it in."""
    motion = np.concatenate(
        [np.linspace(0, 3, 200), np.linspace(3, -2, 200), np.full(200, -2.0), np.linspace(-2, 0, 50)]
    )
    free, touched = (
        reference_output(device_models(name, **guards)[0], motion, "3.0")
        for guards in ({}, {"contact": True})
    )
    assert free.min() < -0.2
    lifted = int(np.argmax(motion < 0))
    np.testing.assert_array_equal(touched[:lifted], np.where(free < 0, 0.0, free)[:lifted])
    assert np.abs(touched[lifted + 3 :]).max() == 0.0  # no force before it is touched again
