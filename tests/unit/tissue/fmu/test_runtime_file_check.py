"""``lumbar check FILE.fmu``: defects that only show where description, library, reference and sources are held together."""

import json
from contextlib import nullcontext
from pathlib import Path

import pytest
from c_programs import ON_LINUX
from effect_entries import entry_of_effects
from runtime_models import SETTINGS, TARGET, models_json, selected
from test_runtime_defects import BINARY, binary, contents, edited

import lumbar
from case_tables import cases
from lumbar.base import landlock
from lumbar.base.errors import InputError
from lumbar.cli.command import main
from lumbar.settings.runtime import DeviceSettings, RuntimeSettings
from lumbar.tissue.effects.catalogue import catalogue_with
from lumbar.tissue.fmu.build.compiler import compile_library
from lumbar.tissue.fmu.build.package import export_fmus, write_fmu
from lumbar.tissue.fmu.build.sources import C_FILES, source_files
from lumbar.tissue.fmu.check import file_check, playing
from lumbar.tissue.fmu.check.agreement import Agreement
from lumbar.tissue.fmu.check.file_check import check_files
from lumbar.tissue.fmu.conventions import REFERENCE, WITHOUT_EVENT_MODE
from lumbar.tissue.models.fitted_model import read_models
from running import python
from study_settings import changed

pytestmark = ON_LINUX
PAGE = "documentation/index.html"
NUMBERS = "sources/model_data.h"


def scaled(path: str, factor: float):
    """Return a defect that multiplies a reference signal."""

    def change(files: dict[str, bytes], version: int) -> None:
        head, *rows = files[path].decode().splitlines()
        cells = [row.split(",") for row in rows]
        changed = [f"{time},{float(value) * factor!r}" for time, value in cells]
        files[path] = ("\n".join([head, *changed]) + "\n").encode()

    return change


def of_another_machine(data: bytes) -> bytes:
    """The same ELF file, for ARM."""
    return data[:18] + b"\xb7\x00" + data[20:]


def attribute(name: str, before: str, after: str):
    """Return a defect of one attribute."""
    return edited(f'{name}="{before}"', f'{name}="{after}"')


def told(name: str, before, after):
    """Return a defect of the annotation: JSON in FMI 3.0, attributes in FMI 2.0."""

    def change(files: dict[str, bytes], version: int) -> None:
        words = [
            f'{name}="{value}"' if version == 2 else json.dumps({name: value})[1:-1]
            for value in (before, after)
        ]
        edited(*words)(files, version)

    return change


WRITTEN = {
    "gain of 2": (
        attribute("start", "1.0", "2.0"),
        "gain: the library starts with 1.0; modelDescription.xml says 2.0",
    ),
    "lower bound that the library refuses": (
        attribute("min", "0.0", "-1.0"),
        "gain: the library refuses -1.0",
    ),
    "upper bound that the library passes": (attribute("max", "10.0", "5.0"), "gain: the library takes"),
    "reference output × 1.1": (scaled(REFERENCE[1], 1.1), f"{REFERENCE[1]} says"),
    "missing dependency": (
        attribute("dependencies", "1 3 4 5 6", "3 4 5 6"),
        "position: force depends on it at once; the dependencies in modelDescription.xml leave it out",
    ),
    "binary of another processor": (binary(of_another_machine), "is no library for x86_64-linux"),
    "inverted": (
        told("resisting_sign", 1, -1),
        "by modelDescription.xml the force that resists has the sign of -1",
    ),
    "sources of another model": (
        edited((1.9).hex(), (1.8).hex(), NUMBERS),
        "built from the FMU's own sources",
    ),
    "sources that do not compile": (
        edited("return y;", "return z;", "sources/model_linear.c"),
        "sources: compiling for",
    ),
}
"""Defects of what is written, with words of the sentence that tells them."""
ONLY_FMI3 = {
    "reference without event mode × 1.1": (
        scaled(WITHOUT_EVENT_MODE, 1.1),
        "without event mode the library gives",
    ),
    "sources that refuse to initialise": (
        edited("    self->state.mode = MODE_INITIALIZATION;", "    return fmi3Error;", "sources/fmi3.c"),
        "built from the FMU's own sources it fails",
    ),
}
CASES = [(name, version, *case) for name, case in WRITTEN.items() for version in (2, 3)]
CASES += [(name, 3, *case) for name, case in ONLY_FMI3.items()]

CORE = "sampled_force.c"
ENDS, STRINGS = "    double end = from + step;", "#include <string.h>"
READ = 'return failed(self, "fmi3GetFloat64: unknown value reference.");\n        }'


def read_as(changed: str) -> dict[str, str]:
    """Return the change of a source file that alters the force where it is read."""
    return {READ: f"{READ}\n        if (vr[i] == VR_OUTPUT) {changed};"}


COMPILED = {
    **cases(__file__, "compiled"),
    "5 N more": ("fmi3.c", read_as("value[i] += 5.0"), "of the reference"),
    "force without a limit": (
        "fmi3.c",
        read_as("value[i] *= value[i] * value[i] < MODEL.output_limit * MODEL.output_limit ? 1.0 : 2.0"),
        "built from the FMU's own sources it gives [15.0",
    ),
    "limit that cannot be lowered": (
        "fmi3.c",
        read_as("value[i] *= MODEL.output_limit / self->state.output_limit"),
        "with force_limit set to",
    ),
}
"""Defects of the library alone: file, what is replaced in it, words of the sentence."""
PASSIVE = {
    "a bound twice as large": (
        CORE,
        {"? sqrt(energy / worst_case": "? 2.0 * sqrt(energy / worst_case"},
        "built from the FMU's own sources",
    ),
}
"""Those of a model that is passive on a device."""
BY_VERSION = [
    pytest.param(name, version, marks=[pytest.mark.nightly] * (version == 2))
    for name, (file, *_) in {**COMPILED, **PASSIVE}.items()
    for version in ((2, 3) if file == CORE else (3,))
]


@pytest.fixture(scope="module")
def workshop(tmp_path_factory):
    """Return a folder for all libraries: the compiler does what they have in common once."""
    return tmp_path_factory.mktemp("libraries")


def defective(model, file: str, changes: dict[str, str], cache: Path, folder: Path) -> bytes:
    """Library of a model whose sources were changed."""
    sources = source_files(model)
    for before, after in changes.items():
        assert before in sources[file], before
        sources[file] = sources[file].replace(before, after)
    for name, text in sources.items():
        # The compiler knows a C file again by its date: only what the defect changes is compiled.
        if not (folder / name).is_file() or (folder / name).read_text(encoding="utf-8") != text:
            (folder / name).write_text(text, encoding="utf-8")
    library = folder / f"{model.identifier}.so"
    compile_library([folder / name for name in C_FILES], library, "x86_64-linux", cache)
    return library.read_bytes()


@pytest.fixture
def played_here(monkeypatch):
    """Play libraries that crash nothing in this process: to start one for each takes longer than all that is tested."""

    monkeypatch.setattr(file_check, "play_library", playing.problems_played)


@pytest.fixture
def of_another_release(played_here, monkeypatch):
    """Take FMUs for what another release wrote: what they say is not compared, but what they do is."""
    monkeypatch.setattr(file_check, "hold_together", lambda *_: Agreement())


def problems(files: dict[str, bytes], version: int, folder: Path, cache: Path) -> tuple[str, ...]:
    """What the check says of an FMU of these files."""
    path = folder / f"KB_fmi{version}.fmu"
    write_fmu(path, files)
    return check_files([path], cache)[0].problems


@pytest.mark.parametrize(
    ("name", "version", "change", "words"), CASES, ids=[f"{n}-fmi{v}" for n, v, *_ in CASES]
)
@pytest.mark.usefixtures("of_another_release")
def test_what_is_written_must_be_what_is_done(name, version, change, words, fmu_folder, zig_cache, tmp_path):
    files = contents(fmu_folder / f"KB_fmi{version}.fmu")
    change(files, version)
    found = problems(files, version, tmp_path, zig_cache)
    assert any(words in text for text in found), found


@pytest.fixture(scope="module")
def passive(tmp_path_factory, zig_cache):
    """Return a model that is passive on a device, and a folder with its FMUs."""
    settings = changed(SETTINGS, models=["KB"], rate_Hz=1000.0, moving_average_ms=3.0, device_damping=2.75)
    (model,) = selected(models_json(), settings)
    folder = tmp_path_factory.mktemp("passive")
    export_fmus([model], folder, "test", TARGET, zig_cache)
    return model, folder


@pytest.mark.parametrize(("name", "version"), BY_VERSION)
def test_what_the_library_does_must_be_what_is_written(
    name, version, fmu_models, fmu_folder, zig_cache, workshop, tmp_path, request
):
    """The sources in the FMU are left as they were."""
    file, changes, words = {**COMPILED, **PASSIVE}[name]
    if "crashes" not in name:
        request.getfixturevalue("played_here")
    model, folder = next(model for model in fmu_models if model.name == "KB"), fmu_folder
    if name in PASSIVE:
        model, folder = request.getfixturevalue("passive")
    library = defective(model, file, changes, zig_cache, workshop)
    files = contents(folder / f"KB_fmi{version}.fmu")
    found = problems({**files, BINARY[version]: library}, version, tmp_path, zig_cache)
    assert any(words in text for text in found), found


@pytest.mark.usefixtures("of_another_release")
def test_defects_that_the_sources_have_too_are_found(fmu_models, fmu_folder, zig_cache, workshop, tmp_path):
    """Built anew they give the same forces: only the reference tells."""
    model = next(model for model in fmu_models if model.name == "KB")
    source, changes = "fmi3.c", read_as("value[i] += 5.0")
    library = defective(model, source, changes, zig_cache, workshop)
    files = contents(fmu_folder / "KB_fmi3.fmu")
    for before, after in changes.items():
        edited(before, after, f"sources/{source}")(files, 3)
    found = problems({**files, BINARY[3]: library}, 3, tmp_path, zig_cache)
    assert any("of the reference" in text for text in found), found


@pytest.mark.parametrize("name", ["IL", "MW", "KB", "HO", "KB+coulomb_friction"])
@pytest.mark.parametrize("version", [2, 3])
def test_an_untouched_export_gives_no_finding(name, version, fmu_folder, zig_cache):
    check = check_files([fmu_folder / f"{name}_fmi{version}.fmu"], zig_cache)[0]
    assert check.problems == ()
    assert check.played
    assert check.same_bytes


@pytest.mark.usefixtures("played_here")
def test_other_flags_give_other_bytes_and_the_same_forces(
    fmu_models, fmu_folder, zig_cache, workshop, tmp_path, monkeypatch
):
    """Sources decide, not the compiler's choices: a library of another optimisation passes."""
    from lumbar.tissue.fmu.build import compiler

    model = next(model for model in fmu_models if model.name == "HO")
    monkeypatch.setattr(compiler, "FLAGS", (*compiler.FLAGS, "-O0"))
    library = defective(model, CORE, {}, zig_cache, workshop)
    monkeypatch.undo()
    files = contents(fmu_folder / "HO_fmi3.fmu")
    place = BINARY[3].replace("KB", "HO")
    assert library != files[place]
    write_fmu(tmp_path / "HO_fmi3.fmu", {**files, place: library})
    check = check_files([tmp_path / "HO_fmi3.fmu"], zig_cache)[0]
    assert (check.problems, check.played, check.same_bytes) == ((), True, False)


def test_without_a_library_for_this_machine_the_file_alone_is_checked(
    fmu_folder, zig_cache, tmp_path, monkeypatch
):
    monkeypatch.setattr(file_check, "host_target", lambda: "aarch64-darwin")
    check = check_files([fmu_folder / "KB_fmi3.fmu"], zig_cache)[0]
    assert (check.problems, check.played) == ((), False)
    assert "no library for this machine" in str(check)


def test_the_command_checks_files_and_folders(run, fmu_folder, tmp_path):
    status, out, _ = run("check", fmu_folder / "KB_fmi3.fmu")
    assert (status, out) == (
        0,
        "runtime: KB_fmi3.fmu: sound; plays its reference, and its sources give the same library\n",
    )
    files = contents(fmu_folder / "KB_fmi3.fmu")
    scaled(REFERENCE[1], 1.1)(files, 3)
    write_fmu(tmp_path / "KB_fmi3.fmu", files)
    status, out, err = run("check", tmp_path)
    assert (status, out) == (1, "")
    assert "KB_fmi3.fmu: 1 problem" in err
    assert "Traceback" not in err
    assert run("check", tmp_path / "absent.fmu")[0] == 1


def test_export_keeps_no_file_that_fails_its_check(tmp_path, zig_cache, monkeypatch):
    from lumbar.base.files import write_json
    from lumbar.tissue.fmu.build import package

    write_json(tmp_path / "models.json", models_json())
    settings = RuntimeSettings(compiler_cache=str(zig_cache), models=("KB",), trained_on="multisine")
    sound = lumbar.export_fmu(tmp_path / "models.json", tmp_path / "sound", settings=settings)
    assert all(path.is_file() for path in sound)
    original = package.resources

    def wrong(*arguments):
        return {path: text.replace(",0.", ",0.1") for path, text in original(*arguments).items()}

    monkeypatch.setattr(package, "resources", wrong)
    with pytest.raises(InputError, match="must not be used"):
        lumbar.export_fmu(tmp_path / "models.json", tmp_path / "wrong", settings=settings)
    assert list((tmp_path / "wrong").iterdir()) == []


@pytest.mark.parametrize("kind", ["py", "yaml"])
@pytest.mark.usefixtures("played_here")
def test_an_effect_of_ones_own_is_held_together_with_its_file_or_carried(kind, project, zig_cache, tmp_path):
    """The FMU carries it as data; in Python it is a program, which no file carries."""
    own = project / "examples" / "own_effect" / f"hertzian_contact.{kind}"
    catalogue = catalogue_with([own])
    content = models_json(entry_of_effects("LE", {"hertzian_contact/sphere": ([0.4], [])}, catalogue))
    models = read_models(content, {"tissue": catalogue})
    settings = RuntimeSettings(compiler_cache=str(zig_cache), device=DeviceSettings(hands=0))
    made = lumbar.export_fmu(models, tmp_path, settings=settings)
    assert lumbar.check_fmu(made, effect_files=[own], settings=settings)[0].same_bytes
    with (
        nullcontext()
        if kind == "yaml"
        else pytest.raises(InputError, match="unknown effect 'hertzian_contact'")
    ):
        lumbar.check_fmu(made, settings=settings)


def test_a_library_that_nobody_vouches_for_is_not_run(
    fmu_models, fmu_folder, zig_cache, workshop, tmp_path, capsys
):
    """Loading it is running it: this one writes a file when it is loaded, where it may; checked or rendered it may not."""
    model, sound = next(item for item in fmu_models if item.name == "KB"), fmu_folder / "KB_fmi3.fmu"
    sign = tmp_path / "ran"
    begun = f'__attribute__((constructor)) static void begun(void) {{ FILE *f = fopen("{sign}", "w"); if (f) fclose(f); }}'
    changes = {"#include <float.h>": f"#include <float.h>\n#include <stdio.h>\n{begun}"}
    library = defective(model, CORE, changes, zig_cache, workshop)
    foreign = tmp_path / sound.name
    write_fmu(foreign, {**contents(sound), BINARY[3]: library})
    settings = tmp_path / "settings.yaml"
    settings.write_text(f"runtime: {{compiler_cache: {zig_cache}}}", encoding="utf-8")
    configured = ["--config", str(settings)]
    assert main(["check", str(foreign), *configured]) == 0
    assert "nobody vouches for it" in capsys.readouterr().out
    assert main(["render", str(foreign), *configured]) == 0
    by_record = capsys.readouterr().out
    assert "was judged by its record" in by_record
    assert not sign.exists()
    assert main(["render", str(sound), *configured]) == 0
    played = capsys.readouterr().out
    assert played.split("; simulated")[0].split("largest")[1] in by_record
    assert main(["check", str(foreign), "--trust", *configured]) == 0
    assert "the program in KB_fmi3.fmu is run, whoever made it" in capsys.readouterr().err
    assert not (landlock.version() and sign.exists())
    assert main(["render", str(foreign), "--trust", *configured]) == 0
    assert not (landlock.version() and sign.exists())
    (tmp_path / "library.so").write_bytes(library)
    python("-c", "import ctypes, sys; ctypes.CDLL(sys.argv[1])", tmp_path / "library.so")
    assert sign.exists(), "it would have"
    outside = tmp_path / "outside.fmu"
    described = contents(sound)["modelDescription.xml"].replace(
        b'modelIdentifier="KB"', b'modelIdentifier="../../KB"'
    )
    write_fmu(outside, {**contents(sound), "modelDescription.xml": described})
    assert main(["render", str(outside), "--trust", *configured]) == 1
    assert "modelIdentifier '../../KB' is no C identifier" in capsys.readouterr().err


def test_of_several_libraries_the_right_one_is_to_blame(
    fmu_models, fmu_folder, zig_cache, workshop, tmp_path
):
    """They share a process: one that crashes, or ends it, takes no other with it."""
    model = next(model for model in fmu_models if model.name == "KB")
    crashes, ends = (
        defective(model, CORE, {ENDS: f"{ENDS}\n    {how}", STRINGS: f"#include <stdlib.h>\n{STRINGS}"},
                  zig_cache, workshop)
        for how in ("abort();", "exit(0);")
    )  # fmt: skip
    sound = fmu_folder / "KB_fmi3.fmu"

    def with_library(library: bytes, name: str) -> Path:
        (tmp_path / name).mkdir()
        path = tmp_path / name / sound.name
        write_fmu(path, {**contents(sound), BINARY[3]: library})
        return path

    paths = [
        sound,
        with_library(crashes, "one"),
        fmu_folder / "MW_fmi2.fmu",
        with_library(ends, "two"),
        fmu_folder / "HO_fmi3.fmu",
    ]
    found = [check.problems for check in check_files(paths, zig_cache)]
    assert [bool(problems) for problems in found] == [False, True, False, True, False]
    assert "crashes with SIG" in found[1][0]
    assert "ends the program" in found[3][0]
