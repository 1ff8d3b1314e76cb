"""Sound files of every kind, ways to change them at random, and the reader that each is meant for."""

import gzip
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from c3d_builder import DEC, INTEL, MIPS, build_c3d

import lumbar
from lumbar.base.errors import Problems
from lumbar.base.yaml_file import read_yaml
from lumbar.records.markers import read_markers
from lumbar.settings.layout import MarkerLayout

_LABELS = ["ann:C7", "ann:SACR", "ann:LTOE", "*4"]
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?")
_WORDS = [
    b"",
    b"nan",
    b"-inf",
    b"1e400",
    b"1_000",
    b"9" * 400,
    b"-0",
    b"\t",
    b",",
    b'"',
    b"\0",
    b"\xff\xfe",
    b"x" * 3000,
]
_WORDS += [
    b"1e11",
    b"0x10",
    b"*a",
    b"&a [",
    b"<<: *a",
    b"{",
    b"- - - -",
    b"? ",
    b"!!python/object:os.system",
    b"\r",
    b"0",
]
_BYTES = [0, 1, 2, 4, 80, 84, 85, 86, 127, 128, 254, 255]


def sound_files() -> dict[str, bytes]:
    """Contents by name; the ending says which reader they are meant for."""
    generator = np.random.default_rng(3)
    points = (
        np.cumsum(generator.normal(0, 3, (30, 4, 3)), axis=0)
        + np.array([300, -200, 900])
        + 400 * generator.normal(size=(4, 3))
    )
    files = {}
    for processor in (INTEL, DEC, MIPS):
        for scale in (-1.0, 0.05):
            files[f"{processor}_{'real' if scale < 0 else 'integer'}.c3d"] = build_c3d(
                points, _LABELS, processor=processor, scale=scale, analog=generator.integers(-900, 900, (30, 24)).astype(float),
                analog_per_frame=4, extra=_parameters(), trial=processor == DEC, long_frames=processor == MIPS,
            )  # fmt: skip
    numbers = ["\t".join(f"{value:.3f}" for value in row) for row in points.reshape(30, -1)]
    names = "\t\t\t".join(_LABELS)
    files["cortex.trc"] = (
        "PathFileType\t4\t(X/Y/Z)\tlift.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n60\t60\t30\t4\tmm\n"
        f"Frame#\tTime\t{names}\t\t\n\t\tX1\tY1\tZ1\n\n"
        + "".join(f"{n}\t{n / 60:.3f}\t{row}\t\n" for n, row in enumerate(numbers))
    ).encode()
    header = ",".join(f"{name}_{axis}" for name in "ABCD" for axis in "xyz")
    commas = [row.replace("\t", ",") for row in numbers]
    table = "".join(f"{n / 60:.4f},{row}\n" for n, row in enumerate(commas))
    files["table.csv"] = f"time_s,{header}\n{table}".encode()
    nine = ["\t".join(row.split("\t")[:9]) for row in numbers]
    files["suit.bvh"] = (
        "HIERARCHY\nROOT A\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n"
        "JOINT B\n{\nOFFSET 0 40 0\nCHANNELS 3 Zrotation Xrotation Yrotation\nEnd Site\n{\nOFFSET 0 20 0\n}\n}\n}\n"
        "MOTION\nFrames: 30\nFrame Time: 0.01\n" + "".join(row.replace("\t", " ") + "\n" for row in nine)
    ).encode()
    record = "time_s,position_mm,force_N\n" + "".join(
        f"{n / 100:.2f},{n % 7}.5,{n % 5}.25\n" for n in range(60)
    )
    files["record.txt"] = record.encode()
    files["record.txt.gz"] = gzip.compress(record.encode(), mtime=0)
    files["study.yaml"] = (
        b"seed: 4\nbase: &a {rate_Hz: 100, list: [1, 2, 3]}\nother: {<<: *a, name: 'x', path: a/b.csv}\n"
        b"deep: [[1], {a: {b: [2]}}]\n"
    )
    return files


def _parameters() -> dict[str, list]:
    return {
        "ANALOG:UNITS": ["N"] * 6,
        "ANALOG:LABELS": [f"F{number}" for number in range(6)],
        "ANALOG:GEN_SCALE": [1.0],
        "FORCE_PLATFORM:ZERO": [1.0, 3],
        "EVENT:USED": [2.0],
        "EVENT:TIMES": [0.0, 0.1, 0.0, 0.2],
        "EVENT:LABELS": ["Foot Off", "Foot Strike"],
        "EVENT:CONTEXTS": ["Left", "Right"],
    }


def changed(content: bytes, generator: np.random.Generator, text: bool) -> bytes:
    """Change a content in one or several ways; a text, of which a reader trusts little, in fewer."""
    for _ in range(1 + int(generator.integers(2 if text else 4))):
        content = _CHANGES[int(generator.integers(len(_CHANGES)))](content, generator, text)
    return content


def _place(content: bytes, generator: np.random.Generator) -> int:
    """Any byte; every second time one of the first 1500, where a binary file says what it is."""
    size = max(len(content), 1)
    return int(generator.integers(min(size, 1500) if generator.random() < 0.5 else size))


def _byte(content: bytes, generator: np.random.Generator, text: bool) -> bytes:
    at = _place(content, generator)
    value = int(generator.choice(_BYTES)) if generator.random() < 0.5 else int(generator.integers(256))
    return content[:at] + bytes([value]) + content[at + 1 :]


def _word(content: bytes, generator: np.random.Generator, text: bool) -> bytes:
    if not text:
        at = _place(content, generator)
        return content[:at] + bytes(generator.choice(_BYTES, 4).tolist()) + content[at + 4 :]
    found = list(_NUMBER.finditer(content))
    word = _WORDS[int(generator.integers(len(_WORDS)))]
    if found and generator.random() < 0.5:
        word = f"{10 ** generator.uniform(-3, 6):.3f}".encode()
    if not found or generator.random() < 0.3:
        at = _place(content, generator)
        return content[:at] + word + content[at:]
    match = found[int(generator.integers(len(found)))]
    return content[: match.start()] + word + content[match.end() :]


def _cut(content: bytes, generator: np.random.Generator, text: bool) -> bytes:
    return content[: _place(content, generator)]


def _removed(content: bytes, generator: np.random.Generator, text: bool) -> bytes:
    at = _place(content, generator)
    return content[:at] + content[at + int(generator.integers(1, 80)) :]


def _repeated(content: bytes, generator: np.random.Generator, text: bool) -> bytes:
    at = _place(content, generator)
    piece = content[at : at + int(generator.integers(1, 200))]
    return content[:at] + piece * int(generator.integers(2, 200)) + content[at:]


_CHANGES: list[Callable[[bytes, np.random.Generator, bool], bytes]] = [
    _byte,
    _byte,
    _word,
    _word,
    _cut,
    _removed,
    _repeated,
]


def read_any(path: Path):
    """Read a file with everything that reads its kind; return what was found."""
    layout = MarkerLayout(unit="mm" if path.suffix in (".csv", ".bvh") else "file", check_axes=False)
    if path.suffix == ".yaml":
        problems = Problems(str(path))
        found = read_yaml(path, problems, str(path))
        problems.raise_if_any()
        return found.content
    if path.suffix == ".json":
        return [str(model) for model in lumbar.load_models(path)]
    if path.suffix in (".h5", ".xlsx", ".dat", ".mat"):
        return [item.record for item in lumbar.import_recordings(path)]
    if path.name.endswith((".txt", ".txt.gz")):
        return list(lumbar.read(path))
    return read_markers(path, layout)
