"""Defects in what calls mean: time, refused steps, bytes, slopes, energy; and which of several libraries is to blame."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from runtime_models import SETTINGS, TARGET, models_json, selected
from test_runtime_defects import BINARY, contents, edited
from test_runtime_file_check import CORE, defective, played_here  # noqa: F401 - a fixture

from lumbar import __version__
from lumbar.tissue.fmu.build.package import export_fmus, write_fmu
from lumbar.tissue.fmu.check.file_check import check_file, checked
from study_settings import changed

pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="runs x86_64 Linux code: use such a machine"
)
ENDS = "    double end = from + step;"
LIBRARY = {
    "one sample a call, whatever its step": (
        {
            "        if (!(instant <= end + tolerance())) break;": "        if (state->pending) break;",
            "        if (instant >= end - tolerance()) break;": "        break;",
        },
        "played in 2 steps a sample",
    ),
    "a clock that begins at 0": ({"state->start_time = start_time;": "state->start_time = 0.0;"}, "from 1000 s on"),
    "steps back in time": ({"!(step > 0.0) || ": ""}, "takes a step back in time"),
    "steps from elsewhere": (
        {"!(fabs(from - state->time) <= tolerance())": "0"},
        "that does not begin where the last one ended",
    ),
    "bytes without a checksum": (
        {"if (sum != checksum(bytes, size - sizeof sum)) return false;": ""},
        "takes the bytes of a state with byte",
    ),
    "twice the slope": (
        {"by_input = state->gain * output_slope": "by_input = 2.0 * state->gain * output_slope"},
        "the library's derivative by position",
    ),
    "0.1 N more after a while": (
        {"y + state->output_offset;": "y + state->output_offset + (state->next_sample > 5000 ? 0.1 : 0.0);"},
        "at sample 5001",
    ),
}  # fmt: skip
"""What is replaced in the library's source, words of the sentence."""
PASSIVE = {
    "damping counted twice": (
        {"double damped = state->device_damping": "double damped = 2.0 * state->device_damping"},
        "energy: ",
    ),
    "a bound twice as large": (
        {"? sqrt(energy / worst)": "? 2.0 * sqrt(energy / worst)"},
        "more out of FMU and device than it gives",
    ),
}
TEXTS = {
    "a force that pulls in its own words": (
        edited("where positive it resists", "where negative it resists"),
        "its description says",
    ),
    "version of another model": (
        edited(f'version="{__version__}+', f'version="{__version__}+f'),
        "it must end with +",
    ),
}


@pytest.fixture(scope="module")
def workshop(tmp_path_factory):
    """Return a folder for all libraries: the compiler does what they have in common once."""
    return tmp_path_factory.mktemp("libraries")


@pytest.fixture(scope="module")
def passive_model():
    """Return a model that is passive on a device."""
    settings = changed(SETTINGS, models=["KB"], rate_Hz=1000.0, moving_average_ms=3.0, device_damping=2.75)
    return selected(models_json(), settings)[0]


@pytest.fixture(scope="module")
def passive_folder(passive_model, tmp_path_factory, zig_cache):
    """Return a folder with its FMUs."""
    folder = tmp_path_factory.mktemp("passive")
    export_fmus([passive_model], folder, "test", TARGET, zig_cache)
    return folder


def put_in(path: Path, library: bytes, version: int, folder: Path) -> Path:
    """FMU with another library."""
    folder.mkdir(exist_ok=True)
    changed_file = folder / path.name
    write_fmu(changed_file, {**contents(path), BINARY[version]: library})
    return changed_file


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("name", LIBRARY)
@pytest.mark.usefixtures("played_here")
def test_calls_must_mean_what_they_say(name, version, fmu_models, fmu_folder, zig_cache, workshop, tmp_path):
    changes, words = LIBRARY[name]
    model = next(model for model in fmu_models if model.name == "KB")
    library = defective(model, CORE, changes, zig_cache, workshop)
    path = put_in(fmu_folder / f"KB_fmi{version}.fmu", library, version, tmp_path)
    found = check_file(path, zig_cache).problems
    assert any(words in text for text in found), found


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("name", PASSIVE)
@pytest.mark.usefixtures("played_here")
def test_energy_must_be_what_is_taken_in(
    name, version, passive_model, passive_folder, zig_cache, workshop, tmp_path
):
    changes, words = PASSIVE[name]
    library = defective(passive_model, CORE, changes, zig_cache, workshop)
    path = put_in(passive_folder / f"KB_fmi{version}.fmu", library, version, tmp_path)
    found = check_file(path, zig_cache).problems
    assert any(words in text for text in found), found


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("name", TEXTS)
def test_words_must_be_the_numbers(name, version, fmu_folder, zig_cache, tmp_path):
    change, words = TEXTS[name]
    files = contents(fmu_folder / f"KB_fmi{version}.fmu")
    change(files, version)
    write_fmu(tmp_path / f"KB_fmi{version}.fmu", files)
    found = check_file(tmp_path / f"KB_fmi{version}.fmu", zig_cache).problems
    assert any(words in text for text in found), found


def test_sources_need_no_options(fmu_folder, zig_cache, tmp_path):
    files = contents(fmu_folder / "KB_fmi3.fmu")
    options = edited(
        'language="C99"', 'language="C99" compilerOptions="-ffast-math"', "sources/buildDescription.xml"
    )
    options(files, 3)
    write_fmu(tmp_path / "KB_fmi3.fmu", files)
    assert any(
        "compiler options" in text for text in check_file(tmp_path / "KB_fmi3.fmu", zig_cache).problems
    )


def test_of_several_libraries_the_right_one_is_to_blame(
    fmu_models, fmu_folder, zig_cache, workshop, tmp_path
):
    """They share a process: one that crashes, or ends it, takes no other with it."""
    model = next(model for model in fmu_models if model.name == "KB")
    crashes, ends = (
        defective(model, CORE, {ENDS: f"{ENDS}\n    {how}", "#include <string.h>": "#include <stdlib.h>\n#include <string.h>"},
                  zig_cache, workshop)
        for how in ("abort();", "exit(0);")
    )  # fmt: skip
    sound = fmu_folder / "KB_fmi3.fmu"
    paths = [
        sound,
        put_in(sound, crashes, 3, tmp_path / "one"),
        fmu_folder / "MW_fmi2.fmu",
        put_in(sound, ends, 3, tmp_path / "two"),
        fmu_folder / "HO_fmi3.fmu",
    ]
    found = [check.problems for check in checked(paths, zig_cache)]
    assert [bool(problems) for problems in found] == [False, True, False, True, False]
    assert "crashes with signal" in found[1][0]
    assert "ends the program" in found[3][0]
