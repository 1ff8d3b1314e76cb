"""Building FMU files, the same bytes at every build: model, sources, libraries, documentation, reference signals.

FMI Layered Standard References, 1.0.0-beta.1, and the experiments format of the Modelica Association that it names define which
files are stimulus, reference result and experiment; both are drafts, and an importer does not need them to play the FMU.
"""

import csv
import hashlib
import io
import json
import struct
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lumbar import __version__
from lumbar.base.errors import InputError
from lumbar.base.files import replacing
from lumbar.base.progress import track
from lumbar.base.templates import template
from lumbar.tissue.fmu.build.compiler import TARGETS, library_of, resolve_targets, warm_cache
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
from lumbar.tissue.fmu.conventions import (
    EXPERIMENTS,
    LAYERED_STANDARD,
    MANIFEST,
    RECORD,
    REFERENCE,
    ROLES,
    WITHOUT_EVENT_MODE,
    along_axes,
    element_names,
)
from lumbar.tissue.models.fitted_model import models_document

_TYPES = {".csv": "text/csv", ".exp": "application/x-ma-hs-experiments"}
_OF_THE_STUDY = {
    *("models", "trained_on", "estimator", "unstable"),
    *("targets", "compiler_cache", "check_samples", "device"),
}
"""Settings that choose, build or judge models; all others decide how one is run."""


def related_files(model: ExportModel, signals: dict[str, str]) -> dict[str, str]:
    """Return manifest and experiments by their paths in the FMU.

    Parameters
    ----------
    signals : dict of str to str
        Reference signals by their paths, see `resources`.
    """

    def source(path: str) -> str:
        """Return a path relative to the folder of the layered standard."""
        folder = MANIFEST[: MANIFEST.rindex("/") + 1]
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
        experiments=[(title, words, source(output)) for title, words, output in modes],
        input=source(REFERENCE[0]),
        stop=signals[REFERENCE[0]].splitlines()[-1].split(",")[0],
        step=float(model.sampling_time),
    )
    files = [
        {
            "source": source(path),
            "type": _TYPES[path[path.rindex(".") :]],
            "checksum": hashlib.sha3_256(text.encode()).hexdigest(),
            **dict(zip(("label", "role", "description"), ROLES[path], strict=True)),
        }
        for path, text in (signals | {EXPERIMENTS: experiments}).items()
    ]
    manifest = template("tissue/fmu/build/manifest.xml.jinja").render(
        files=files, name=LAYERED_STANDARD, version="1.0.0-beta.1"
    )
    return {MANIFEST: manifest, EXPERIMENTS: experiments}


_MAGIC = 0xCAFEBABE
_MACH_O_64 = 0xFEEDFACF
_ALIGNMENT = 14
"""Exponent of 2: pages of 16 KiB, the largest of Apple's processors."""


def universal_library(libraries: list[bytes]) -> bytes:
    """Join Mach-O libraries of 64-bit processors, as Apple's ``lipo`` does (``mach-o/fat.h``).

    Raises
    ------
    ValueError
        If one is not a 64-bit little-endian Mach-O file.
    """
    head = struct.pack(">II", _MAGIC, len(libraries))
    page = 1 << _ALIGNMENT
    body = b""
    for library in libraries:
        magic, processor, variant = struct.unpack_from("<III", library)
        if magic != _MACH_O_64:
            raise ValueError(f"not a 64-bit Mach-O library: it begins with {magic:#x}")
        body += b"\0" * (-len(body) % page)
        head += struct.pack(">IIIII", processor, variant, page + len(body), len(library), _ALIGNMENT)
        body += library
    return head + b"\0" * (page - len(head)) + body


_HERE = Path(__file__).parent


def attachments(model: ExportModel, version: str) -> dict[str, bytes]:
    """Return icon, terminals (FMI 3.0) and licence by their paths in the FMU."""
    icon = (_HERE / "icon.png").read_bytes()
    licence = (_HERE / "license.txt").read_bytes().replace(b"\r\n", b"\n")
    files = {"documentation/licenses/license.txt": licence}
    if version == "2.0":
        return {**files, "model.png": icon}
    # One terminal, the tool: its position goes in, the force on it comes out.
    terminals = template("tissue/fmu/build/terminals.xml.jinja")
    names = model.input.variable, model.output.variable
    return {
        **files,
        "terminalsAndIcons/icon.png": icon,
        "terminalsAndIcons/terminalsAndIcons.xml": terminals.render(names=names).encode("utf-8"),
    }


def resources(model: ExportModel, version: str) -> dict[str, str]:
    """Return the reference signals by their paths in the FMU: one push, or its beginning in a fast loop, and the response.

    For FMI 3.0 there is a second response, for importers without event mode.
    """
    time, profile = push_profile(model.sampling_time)
    samples = samples_within_range(model, min(len(time), MAX_EMBEDDED))
    time, way = time[:samples], along_axes(profile[:samples], len(model.axes))
    inputs = model.rest + push_depth(model, profile) * way
    played = {REFERENCE[1]: version, **({WITHOUT_EVENT_MODE: "2.0"} if version == "3.0" else {})}
    return {
        REFERENCE[0]: _signal(time, inputs, model.input.variable, version),
        **{
            path: _signal(time, reference_output(model, inputs, read), model.output.variable, version)
            for path, read in played.items()
        },
    }


def _signal(time: np.ndarray, values: np.ndarray, name: str, version: str) -> str:
    """Return time and values as CSV; vectors as an array in a cell (FMI 3.0) or in columns (FMI 2.0)."""
    names, rows = (name,), values.reshape(len(time), -1).tolist()
    if values.ndim > 1 and version == "3.0":
        rows = [[" ".join(map(repr, row))] for row in rows]
    elif values.ndim > 1:
        names = element_names(name, values.shape[1])
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("time", *names))
    writer.writerows([moment, *row] for moment, row in zip(time.tolist(), rows, strict=True))
    return text.getvalue()


_COMPRESSION = 9
_EARLIEST = (1980, 1, 1, 0, 0, 0)
"""The earliest date a ZIP file can hold: FMUs carry no date."""


def compile_model(model: ExportModel, targets: Sequence[str], cache: Path) -> dict[str, bytes]:
    """Compile one library per target, contents by target; it serves both FMI versions.

    Parameters
    ----------
    targets : list of str
        Platforms, keys of `lumbar.tissue.fmu.build.compiler.TARGETS`, or ``"host"``.

    Raises
    ------
    InputError
        Unknown target, no compiler, no room for the sources, or sources that do not compile.
    """
    sources = tuple(sorted((file, text.encode("utf-8")) for file, text in source_files(model).items()))
    return {
        target: library_of(sources, C_FILES, f"{model.identifier}{TARGETS[target].suffix}", target, cache)
        for target in resolve_targets(targets)
    }


def fmu_contents(
    model: ExportModel, version: str, source_label: str, libraries: dict[str, bytes]
) -> dict[str, bytes]:
    """Return the files of an FMU by their path in the archive."""
    contents = {f"sources/{name}": text for name, text in source_files(model).items()}
    contents["modelDescription.xml"] = model_description(model, version, source_label)
    contents["documentation/index.html"] = documentation_html(model, version, source_label)
    contents[RECORD] = _record_text(model, source_label)
    if version == "3.0":
        build = template("tissue/fmu/build/buildDescription.xml.jinja")
        contents["sources/buildDescription.xml"] = build.render(model=model, files=C_FILES)
    signals = resources(model, version)
    contents.update({**signals, **related_files(model, signals)})
    files = {path: text.encode("utf-8") for path, text in contents.items()}
    return {**files, **attachments(model, version), **_binaries(model, version, libraries)}


def _record_text(model: ExportModel, source_label: str) -> str:
    """Return the record, from which all else in the FMU follows.

    It is a file of models that holds this one, the settings that shape the FMU, and what wrote it.
    """
    content = {
        **models_document([model.identified], source_label),
        "runtime": {name: value for name, value in model.settings if name not in _OF_THE_STUDY},
        "on_device": list(model.on_device),
        "written_by": f"lumbar {__version__}",
    }
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _binaries(model: ExportModel, version: str, libraries: dict[str, bytes]) -> dict[str, bytes]:
    files = {}
    for target, library in libraries.items():
        platform = TARGETS[target]
        folder = platform.fmi2 if version == "2.0" else platform.fmi3
        files[f"binaries/{folder}/{model.identifier}{platform.suffix}"] = library
    macs = [target for target in ("x86_64-darwin", "aarch64-darwin") if target in libraries]
    if version == "2.0" and len(macs) == 2:
        # FMI 2.0 has one folder for macOS and all processors.
        for target in macs:
            del files[f"binaries/{TARGETS[target].fmi2}/{model.identifier}.dylib"]
        both = universal_library([libraries[target] for target in macs])
        files[f"binaries/darwin64/{model.identifier}.dylib"] = both
    return files


def write_fmu(path: Path, files: dict[str, bytes]) -> None:
    """Write an FMU, whole or not at all.

    Entries are sorted and undated; the same library of compression gives the same bytes. Another version of it may
    pack the same contents differently: the model's token does not depend on that.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    try:
        with replacing(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
            # The model description comes first: tools that stream an FMU find it at once.
            for name in sorted(files, key=lambda item: (item != "modelDescription.xml", item)):
                entry = zipfile.ZipInfo(name, _EARLIEST)
                entry.create_system = 3
                entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
                archive.writestr(entry, files[name], zipfile.ZIP_DEFLATED, _COMPRESSION)
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

    For targets see `compile_model`, for errors also `write_fmu`.
    """
    written = []
    warm_cache(targets, cache)
    for model in track(models, "FMUs compiled"):
        libraries = compile_model(model, targets, cache)
        for version in versions:
            path = folder / fmu_name(model.name, version)
            write_fmu(path, fmu_contents(model, version, source_label, libraries))
            written.append(path)
    return written


def fmu_name(model: str, version: str) -> str:
    """File name of a model's FMU: ``KB_fmi2.fmu`` for FMI 2.0."""
    return f"{model}_fmi{version[0]}.fmu"
