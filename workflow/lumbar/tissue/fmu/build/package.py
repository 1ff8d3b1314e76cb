"""Building FMU files (model, sources, libraries, documentation, reference signals); every build gives the same bytes.

The drafts FMI Layered Standard References, 1.0.0-beta.1, and the experiments format of the Modelica Association define
stimulus, reference result and experiment; an importer does not need these files to run the FMU.
"""

import csv
import hashlib
import io
import json
import struct
import zipfile
from collections.abc import Sequence
from pathlib import Path

from lumbar import __version__
from lumbar.base.errors import InputError
from lumbar.base.files import replacing
from lumbar.base.progress import track
from lumbar.base.templates import template
from lumbar.tissue.fmu.build.compiler import TARGETS, compile_sources, resolve_targets, warm_cache
from lumbar.tissue.fmu.build.description import FMI_VERSIONS, model_description
from lumbar.tissue.fmu.build.documentation import documentation_html
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.build.reference_response import (
    MAX_EMBEDDED,
    push_depth,
    push_profile,
    reference_output,
    samples_within_range,
)
from lumbar.tissue.fmu.build.sources import C_FILES, source_files
from lumbar.tissue.fmu.conventions import REFERENCE, WITHOUT_EVENT_MODE, along_axes, element_names
from lumbar.tissue.models.fitted_model import models_document

_FOLDER = Path(__file__).parent
_MODEL_FILE = "resources/model.json"
"""File with the identified model and its runtime settings; all other files of an FMU follow from it."""
_STANDARD = "org.fmi-standard.fmi-ls-ref"
"""Name of the layered standard FMI-LS-REF and of its folder below ``extra/``; it defines the roles of the reference files."""
_MANIFEST = f"extra/{_STANDARD}/fmi-ls-manifest.xml"
"""Manifest: the files of the reference signals, with their roles."""
_EXPERIMENTS = f"extra/{_STANDARD}/reference.exp"
"""File with the experiments for the reference signals."""
_ROLES = {
    REFERENCE[0]: ("stimulus", "testcase", "Stimulus: one push into the model"),
    REFERENCE[1]: ("reference result", "result", "Reference result of the push"),
    WITHOUT_EVENT_MODE: ("reference result", "result", "Reference result where event mode is not used"),
    _EXPERIMENTS: ("experiment", "experiment/smoke-test", "The push as an experiment"),
}
"""Label, role and description of each file in the manifest."""
_TYPES = {".csv": "text/csv", ".exp": "application/x-ma-hs-experiments"}
_STUDY_SETTINGS = {
    *("models", "trained_on", "estimator", "unstable"),
    *("targets", "compiler_cache", "check_samples", "device"),
}
"""Settings that choose, build or judge models; all other settings decide how a model runs."""
_EARLIEST_DATE = (1980, 1, 1, 0, 0, 0)
"""The earliest date of an entry in a ZIP file: FMUs have no date."""


def _related_files(model: ExportModel, signals: dict[str, str]) -> dict[str, str]:
    """Return manifest and experiments for the reference signals, by path in the FMU."""

    def source(path: str) -> str:
        """Return a path relative to the folder of the layered standard."""
        folder = _MANIFEST[: _MANIFEST.rindex("/") + 1]
        return path.removeprefix(folder) if path.startswith(folder) else f"../../{path}"

    # The push, with event mode and without if there are both.
    modes = [("push", "", REFERENCE[1])]
    if WITHOUT_EVENT_MODE in signals:
        modes = [
            ("push, event mode", "eventModeUsed is true", REFERENCE[1]),
            ("push, no event mode", "eventModeUsed is false", WITHOUT_EVENT_MODE),
        ]
    experiments = template("tissue/fmu/build/experiments.xml.jinja").render(
        name=model.name,
        push=f"One push into the model, a step per sample: every importer should read this {model.output.quantity}",
        experiments=[(title, description, source(output)) for title, description, output in modes],
        input=source(REFERENCE[0]),
        stop=signals[REFERENCE[0]].splitlines()[-1].split(",")[0],
        step=float(model.sampling_time),
    )
    files = [
        {
            "source": source(path),
            "type": _TYPES[path[path.rindex(".") :]],
            "checksum": hashlib.sha3_256(text.encode()).hexdigest(),
            **dict(zip(("label", "role", "description"), _ROLES[path], strict=True)),
        }
        for path, text in (signals | {_EXPERIMENTS: experiments}).items()
    ]
    manifest = template("tissue/fmu/build/manifest.xml.jinja").render(
        files=files, name=_STANDARD, version="1.0.0-beta.1"
    )
    return {_MANIFEST: manifest, _EXPERIMENTS: experiments}


def universal_library(libraries: list[bytes]) -> bytes:
    """Join Mach-O libraries of 64-bit processors, as Apple's ``lipo`` does (``mach-o/fat.h``)."""
    alignment = 14  # exponent of 2: pages of 16 KiB, the largest of Apple's processors
    head, body, page = struct.pack(">II", 0xCAFEBABE, len(libraries)), b"", 1 << alignment
    for library in libraries:
        magic, processor, variant = struct.unpack_from("<III", library)
        if magic != 0xFEEDFACF:
            raise ValueError(f"not a 64-bit Mach-O library: it begins with {magic:#x}")
        body += b"\0" * (-len(body) % page)
        head += struct.pack(">IIIII", processor, variant, page + len(body), len(library), alignment)
        body += library
    return head + b"\0" * (page - len(head)) + body


def _reference_signals(model: ExportModel, version: str) -> dict[str, str]:
    """Return the reference signals by path in the FMU: a push (in a fast loop only its beginning) and the response.

    For FMI 3.0 there is a second response, for importers without event mode.
    """
    time, profile = push_profile(model.sampling_time)
    samples = samples_within_range(model, min(len(time), MAX_EMBEDDED))
    path = along_axes(profile[:samples], len(model.axes))
    inputs = model.rest + push_depth(model, profile) * path
    signals = {REFERENCE[0]: (model.input.variable, inputs)}
    signals[REFERENCE[1]] = (model.output.variable, reference_output(model, inputs, version))
    if version == "3.0":
        signals[WITHOUT_EVENT_MODE] = (model.output.variable, reference_output(model, inputs, "2.0"))
    texts = {}
    for file, (name, values) in signals.items():
        names, rows = (name,), values.reshape(samples, -1).tolist()
        if values.ndim > 1 and version == "3.0":  # an array in a cell
            rows = [[" ".join(map(repr, row))] for row in rows]
        elif values.ndim > 1:
            names = element_names(name, values.shape[1])
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(("time", *names))
        writer.writerows([moment, *row] for moment, row in zip(time[:samples].tolist(), rows, strict=True))
        texts[file] = text.getvalue()
    return texts


def fmu_contents(
    model: ExportModel, version: str, source_label: str, libraries: dict[str, bytes]
) -> dict[str, bytes]:
    """Return the files of an FMU by path in the archive; `libraries` are the compiled libraries of all targets."""
    # The record, from which all else in the FMU follows: the model, the settings that shape the FMU, and the program.
    record = {
        **models_document([model.identified], source_label),
        "runtime": {name: value for name, value in model.settings if name not in _STUDY_SETTINGS},
        "on_device": list(model.on_device),
        "written_by": f"lumbar {__version__}",
    }
    signals = _reference_signals(model, version)
    texts = {
        **{f"sources/{name}": text for name, text in source_files(model).items()},
        "modelDescription.xml": model_description(model, version, source_label),
        "documentation/index.html": documentation_html(model, version, source_label),
        _MODEL_FILE: json.dumps(record, indent=1, ensure_ascii=False, allow_nan=False) + "\n",
        **signals,
        **_related_files(model, signals),
    }
    icon = "model.png"
    if version == "3.0":
        build = template("tissue/fmu/build/buildDescription.xml.jinja")
        texts["sources/buildDescription.xml"] = build.render(model=model, files=C_FILES)
        # One terminal, the tool, with its position and the force on it.
        terminals = template("tissue/fmu/build/terminals.xml.jinja")
        names = model.input.variable, model.output.variable
        texts["terminalsAndIcons/terminalsAndIcons.xml"] = terminals.render(names=names)
        icon = "terminalsAndIcons/icon.png"
    files = {path: text.encode("utf-8") for path, text in texts.items()}
    files[icon] = (_FOLDER / "icon.png").read_bytes()
    licence = (_FOLDER / "license.txt").read_bytes().replace(b"\r\n", b"\n")
    files["documentation/licenses/license.txt"] = licence
    for target, library in libraries.items():
        platform = TARGETS[target]
        folder = platform.fmi2 if version == "2.0" else platform.fmi3
        files[f"binaries/{folder}/{model.identifier}{platform.suffix}"] = library
    macs = [libraries[target] for target in ("x86_64-darwin", "aarch64-darwin") if target in libraries]
    if version == "2.0" and len(macs) == 2:
        # FMI 2.0 has one folder for macOS and all processors.
        del files[f"binaries/{TARGETS['aarch64-darwin'].fmi2}/{model.identifier}.dylib"]
        files[f"binaries/darwin64/{model.identifier}.dylib"] = universal_library(macs)
    return files


def write_fmu(path: Path, files: dict[str, bytes]) -> None:
    """Write an FMU completely, or leave no file.

    Entries are sorted and undated, so that the same version of the compression library gives the same bytes.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    try:
        with replacing(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
            # The model description comes first, for tools that stream an FMU.
            for name in sorted(files, key=lambda item: (item != "modelDescription.xml", item)):
                entry = zipfile.ZipInfo(name, _EARLIEST_DATE)
                entry.create_system = 3
                entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
                archive.writestr(entry, files[name], zipfile.ZIP_DEFLATED, 9)
    except OSError as error:
        raise InputError(
            f"{path}: the FMU cannot be written ({error.strerror}); check the folder's rights and free space"
        ) from error


def export_fmus(
    models: list[ExportModel],
    folder: Path,
    source_label: str,
    targets: Sequence[str],
    cache: Path,
    versions: Sequence[str] = FMI_VERSIONS,
) -> list[Path]:
    """Compile each model once, write its FMUs, ``<name>_fmi2.fmu`` and ``<name>_fmi3.fmu``, and return their paths.

    Targets are keys of `lumbar.tissue.fmu.build.compiler.TARGETS` or ``"host"``.

    Raises
    ------
    InputError
        If a target is unknown, no compiler is installed, or the sources or an FMU cannot be written or compiled.
    """
    written = []
    warm_cache(targets, cache)
    for model in track(models, "FMUs compiled"):
        sources = tuple(sorted((file, text.encode("utf-8")) for file, text in source_files(model).items()))
        libraries = {
            target: compile_sources(
                sources, C_FILES, f"{model.identifier}{TARGETS[target].suffix}", target, cache
            )
            for target in resolve_targets(targets)
        }
        for version in versions:
            path = folder / fmu_name(model.name, version)
            write_fmu(path, fmu_contents(model, version, source_label, libraries))
            written.append(path)
    return written


def fmu_name(model: str, version: str) -> str:
    """Return the file name of a model's FMU: ``KB_fmi2.fmu`` for FMI 2.0."""
    return f"{model}_fmi{version[0]}.fmu"
