"""FMUs as files: reproducible bytes, lint, escaping, compiling, places that cannot be written."""

import hashlib
import shutil
import zipfile
from contextlib import nullcontext
from types import SimpleNamespace

import fmpy
import numpy as np
import pytest
from c_programs import ON_LINUX
from effect_entries import COMBINATIONS, effect_entry
from runtime_models import SETTINGS, TARGET, models_json, selected

from lumbar.base.errors import InputError
from lumbar.tissue.fmu.build import compiler, package
from lumbar.tissue.fmu.build.compiler import compile_library
from lumbar.tissue.fmu.build.package import export_fmus, write_fmu
from lumbar.tissue.fmu.fmu_check import simulate_fmu
from study_settings import changed

pytestmark = ON_LINUX


def test_names_are_escaped_everywhere(fmu_folder):
    for version in (2, 3):
        path = fmu_folder / f"KB+coulomb_friction_fmi{version}.fmu"
        description = fmpy.read_model_description(str(path), validate=True)
        assert description.modelName == "KB+coulomb_friction"
        assert description.coSimulation.modelIdentifier == "KB_coulomb_friction"
        assert "A & B <lab>" in description.description
        with zipfile.ZipFile(path) as archive:
            assert "A &amp; B &lt;lab&gt;" in archive.read("documentation/index.html").decode()


@pytest.mark.nightly
def test_the_same_bytes_from_another_folder_and_a_cold_cache(fmu_models, fmu_folder, zig_cache, tmp_path):
    chosen = [model for model in fmu_models if model.name == "KB"]
    export_fmus(chosen, tmp_path / "elsewhere", "synthetic twin", TARGET, tmp_path / "cold cache")
    for name in ("KB_fmi2.fmu", "KB_fmi3.fmu"):
        first, second = ((place / name).read_bytes() for place in (fmu_folder, tmp_path / "elsewhere"))
        assert hashlib.sha256(first).hexdigest() == hashlib.sha256(second).hexdigest()
    with_effects = effect_entry(*COMBINATIONS[1])
    models = selected(models_json(with_effects), changed(SETTINGS, models=[with_effects["name"]]))
    first, again = (
        export_fmus(models, tmp_path / folder, "synthetic twin", TARGET, cache)
        for folder, cache in (("one", zig_cache), ("another folder", tmp_path / "cold cache"))
    )
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in again]


def test_libraries_need_an_old_c_library_only(fmu_folder):
    with zipfile.ZipFile(fmu_folder / "KB_fmi3.fmu") as archive:
        library = archive.read("binaries/x86_64-linux/KB.so")
    versions = {part.split(b"\0")[0] for part in library.split(b"GLIBC_")[1:]}
    assert versions
    assert max(tuple(map(int, version.split(b"."))) for version in versions) <= (2, 17)


def test_a_refused_compilation_says_what_the_compiler_said(fmu_models, zig_cache, tmp_path):
    (tmp_path / "broken.c").write_text("int f(void) { return nonsense; }\n")
    with pytest.raises(InputError, match="nonsense"):
        compile_library([tmp_path / "broken.c"], tmp_path / "broken.so", "x86_64-linux", zig_cache)
    with pytest.raises(InputError, match=r"runtime\.targets.*pdp11.*x86_64-linux"):
        export_fmus(fmu_models[:1], tmp_path, "", ["pdp11"], zig_cache)


@pytest.fixture
def nothing_compiled():
    """Let this process forget what it has compiled."""
    compiler.compile_sources.cache_clear()


@pytest.mark.usefixtures("nothing_compiled")
def test_a_compiler_that_fails_without_a_word_is_an_error(fmu_models, zig_cache, tmp_path, monkeypatch):
    """Killed, or done without a library: both leave no FMU."""
    (tmp_path / "ziglang").mkdir()
    (tmp_path / "ziglang" / "__init__.py").touch()
    monkeypatch.setattr(
        compiler, "find_spec", lambda _: SimpleNamespace(origin=str(tmp_path / "ziglang" / "__init__.py"))
    )
    program = tmp_path / "ziglang" / "zig"
    for body, words in (("", "exit code 0"), ("kill -ABRT $$\n", "exit code -6")):
        program.write_text(f"#!/bin/sh\n{body}")
        program.chmod(0o755)
        with pytest.raises(InputError, match=rf"{words}(?s:.*)remove its cache(?s:.*)no output"):
            export_fmus(fmu_models[:1], tmp_path / "fmu", "", TARGET, zig_cache)
    assert not (tmp_path / "fmu").exists()


@pytest.mark.usefixtures("nothing_compiled")
def test_places_that_cannot_be_written_are_named(fmu_models, fmu_folder, zig_cache, tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(InputError, match="compiler_cache"):
        export_fmus(fmu_models[:1], tmp_path, "", TARGET, blocked / "cache")
    with pytest.raises(InputError, match="cannot be written"):
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
    with pytest.raises(InputError, match="No space left"):
        write_fmu(tmp_path / "KB_fmi2.fmu", {"modelDescription.xml": b"x", "a": b"y", "b": b"z"})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(
    shutil.which("cmake") is None, reason="no CMake, with which fmpy compiles FMUs: apt-get install cmake"
)
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler: apt-get install gcc libc6-dev")
@pytest.mark.parametrize(("name", "version"), [("KB", 3), ("KB+coulomb_friction", 2)])
def test_fmpy_compiles_the_sources_alone(name, version, fmu_folder, fmu_positions, tmp_path):
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
    built = simulate_fmu(tmp_path / shipped.name, fmu_positions)
    np.testing.assert_array_equal(built, simulate_fmu(shipped, fmu_positions))
