"""The C sources of an FMU: the fixed files of this package, FMI's headers, and the numbers of one model."""

from __future__ import annotations

import hashlib
import uuid
from functools import cache
from pathlib import Path

import numpy as np

from lumbar.runtime.export_model import ExportModel

C_FILES = ("model_linear.c", "sampled_force.c", "fmi2.c", "fmi3.c", "fmi3_unused.c")
"""What is compiled."""
_HEADERS = ("model.h", "sampled_force.h")
_FMI_HEADERS = (
    "fmi2Functions.h",
    "fmi2FunctionTypes.h",
    "fmi2TypesPlatform.h",
    "fmi3Functions.h",
    "fmi3FunctionTypes.h",
    "fmi3PlatformTypes.h",
)


@cache
def _fixed_sources() -> dict[str, str]:
    import fmpy

    here = Path(__file__).parent
    fmi = Path(fmpy.__file__).parent / "c-code"
    files = [here / name for name in (*C_FILES, *_HEADERS)] + [fmi / name for name in _FMI_HEADERS]
    return {path.name: path.read_text(encoding="utf-8").replace("\r\n", "\n") for path in files}


def source_files(model: ExportModel) -> dict[str, str]:
    """Return all sources of a model's library by file name; ``model_data.h`` holds the numbers."""
    return {**_fixed_sources(), "model_data.h": _model_data(model, content_token(model))}


def content_token(model: ExportModel) -> str:
    """FMI's GUID and instantiation token: a hash of all sources, the model's numbers and variables."""
    digest = hashlib.sha256()
    for name, text in sorted(_fixed_sources().items()):
        digest.update(f"{name}\0{text}\0".encode())
    names = (model.name, model.input.quantity, model.input.unit, model.output.quantity, model.output.unit)
    digest.update("\0".join((*names, _model_data(model, ""))).encode())
    return str(uuid.UUID(bytes=digest.digest()[:16]))


def _row(values: np.ndarray) -> str:
    return "{" + ", ".join(float(value).hex() for value in values) + "}"


def _model_data(model: ExportModel, token: str) -> str:
    """Numbers as hexadecimal floats: exact, and the same text on every machine."""
    system = model.state_space
    # C has no arrays of length 0: a static gain gets one unused element.
    size = max(system.states, 1)
    matrix, column, row = np.zeros((size, size)), np.zeros(size), np.zeros(size)
    matrix[: system.states, : system.states] = system.A
    column[: system.states], row[: system.states] = system.B, system.C
    constants = {
        "token": f'"{token}"',
        "sampling_time": model.sampling_time.hex(),
        "input_offset": model.input.offset.hex(),
        "output_offset": model.output.offset.hex(),
        "output_limit": model.output_limit.hex(),
        "gain_limit": model.gain_limit.hex(),
        "states": str(system.states),
        "window": str(model.moving_average),
        "feedthrough": str(int(model.feedthrough)),
    }
    entries = ", \\\n    ".join(f".{key} = {value}" for key, value in constants.items())
    return "\n".join(
        [
            "/* Numbers of one model, written at export. */",
            f"#define MODEL_STATES {system.states}",
            f"static const double MODEL_A[{size}][{size}] = {{{', '.join(map(_row, matrix))}}};",
            f"static const double MODEL_B[{size}] = {_row(column)};",
            f"static const double MODEL_C[{size}] = {_row(row)};",
            f"#define MODEL_D {float(system.D).hex()}",
            f"#define MODEL_CONSTANTS {{ \\\n    {entries}}}",
            "",
        ]
    )
