"""The C sources of an FMU: the fixed files of this package, FMI's headers, and the numbers of one model."""

import hashlib
import re
import uuid
from functools import cache
from pathlib import Path

from lumbar import __version__
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.c import c_source

AUTHOR = "The lumbar developers"
C_FILES = ("sampled_force.c", "fmi2.c", "fmi3.c", "fmi3_unused.c")
"""Compiled files; ``sampled_force.c`` includes the model."""
_SIZES, _NUMBERS = "model_size.h", "model_data.h"
"""Files that are written for each model."""
_HEADERS = ("model.h", "sampled_force.h")
_FMI_HEADERS = (
    *("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    *("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
)
_AXES_VARIANTS = re.compile(
    r"#if MODEL_AXES > 1\n(.*?)#else /\* one axis \*/\n(.*?)#endif /\* MODEL_AXES \*/\n", re.DOTALL
)
"""Pattern of the parts of C files that differ between one axis and several axes."""


@cache
def _fixed_source(name: str, several: bool) -> str:
    import fmpy

    if name not in _FMI_HEADERS:
        return _AXES_VARIANTS.sub(lambda variants: variants[1 if several else 2], c_source(name))
    header = Path(fmpy.__file__).parent / "c-code" / name
    return header.read_text(encoding="utf-8").replace("\r\n", "\n")


def source_files(model: ExportModel, token: str | None = None) -> dict[str, str]:
    """Return all sources of a model's library by file name; the default token is `content_token`."""
    names = (*C_FILES, model.dynamics.c_source, *_HEADERS, *model.dynamics.headers, *_FMI_HEADERS)
    several = ("spatial_force.c",) * bool(model.axes)
    fixed = {name: _fixed_source(name, bool(model.axes)) for name in (*names, *several)}
    token = content_token(model) if token is None else token
    return {**fixed, _SIZES: _model_size(model), _NUMBERS: _model_data(model, token)}


def content_token(model: ExportModel) -> str:
    """Return FMI's GUID and instantiation token: a hash of all sources, the model's numbers and variables."""
    fixed = source_files(model, token="")
    written = (fixed.pop(_SIZES), fixed.pop(_NUMBERS))
    digest = hashlib.sha256()
    for name, text in sorted(fixed.items()):
        digest.update(f"{name}\0{text}\0".encode())
    names = (model.name, model.input.quantity, model.input.unit, model.output.quantity, model.output.unit)
    digest.update("\0".join((*names, *written)).encode())
    return str(uuid.UUID(bytes=digest.digest()[:16]))


def model_version(model: ExportModel) -> str:
    """Return the version of this software, a plus sign, and the version of the model: a hash of its sources."""
    return f"{__version__}+{content_token(model)[:8]}"


def _model_size(model: ExportModel) -> str:
    """Return model_size.h with the sizes of loops and memory; sizes of arrays are at least 1, as C requires."""
    sizes = {
        "MODEL_STATES": max(1, model.dynamics.states),
        "MODEL_PHASES": model.dynamics.phases,
        "MODEL_WINDOW": model.moving_average,
        "MODEL_DELAY": model.dynamics.delay,
        "MODEL_HISTORY": max(1, model.history),
        "MODEL_RINGS": len(model.dynamics.histories),
        "MODEL_RING": max(model.dynamics.histories, default=0),
        "MODEL_SOURCE": f'"{model.dynamics.c_source}"',
    }
    if model.axes:
        sizes["MODEL_AXES"] = len(model.axes)
        sizes["MODEL_REST"] = f"{{{', '.join(value.hex() for value in model.rest)}}}"
    lines = [f"#define {name} {size}" for name, size in sizes.items()]
    return "\n".join(["/* Sizes of a model, written at export. */", *lines, ""])


def _model_data(model: ExportModel, token: str) -> str:
    """Return model_data.h with the numbers as hexadecimal floats: exact, and the same text on every machine."""
    guards = model.guards
    constants = {
        "token": f'"{token}"',
        "sampling_time": model.sampling_time.hex(),
        "input_offset": model.input.offset.hex(),
        "output_offset": model.output.offset.hex(),
        "output_limit": model.output_limit.hex(),
        "gain_limit": float(model.settings.gain_limit).hex(),
        "rate_limit": guards.rate_limit.hex(),
        "device_damping": guards.device_damping.hex(),
        "energy_reserve": guards.energy_reserve.hex(),
        "input_unit": model.units.position.hex(),
        "output_unit": model.units.force.hex(),
        "resistance": model.resistance.hex(),
        "contact": str(int(guards.contact)),
        "guarded": str(int(guards.active)),
        "starts_at_rest": str(int(model.starts_at_rest)),
        "feedthrough": str(int(model.feedthrough)),
        "waits_for_input": str(int(model.dynamics.waits_for_input)),
    }
    entries = ", \\\n    ".join(f".{key} = {value}" for key, value in constants.items())
    lines = ["/* Numbers of one model, written at export. */", *model.dynamics.c_data()]
    return "\n".join([*lines, f"#define MODEL_CONSTANTS {{ \\\n    {entries}}}", ""])
