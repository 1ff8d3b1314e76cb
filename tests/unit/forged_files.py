"""Files as an attacker writes them: they lead to other files, ask to be run, or stand for far more than they are."""

import gzip
import io
import json
import os
import struct
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path

import h5py
import numpy as np
from c3d_builder import build_c3d
from scipy.io import savemat

import lumbar
from lumbar.base.errors import InputError, Problems
from lumbar.base.yaml_file import read_yaml
from lumbar.records.markers import read_markers
from lumbar.settings.layout import MarkerLayout
from lumbar.tissue.models.fitted_model import FittedModel, models_document
from lumbar.tissue.models.model_data import Port
from lumbar.tissue.models.transfer_function import TransferFunction

SECRET = b"4711.0815 -1234.5678\n" * 60
"""What a file that is not given holds: numbers, so that a reader of a table would take them."""
_SIZE = 60_000_000
"""Bytes to which a bomb grows at least where nothing stops it."""


def attacks(canary: Path, marker: Path) -> dict[str, Callable[[], bytes]]:
    """Makers of contents by name; `canary` is a file that none may read, `marker` one that none may make."""
    lines = b"0.00,1.000,2.000\n" * 60_000
    return {
        "external.h5": lambda: _hdf5(lambda file: _external(file, canary)),
        "pipe.h5": lambda: _hdf5(lambda file: _external(file, canary.with_name("pipe"))),
        "virtual.h5": lambda: _hdf5(lambda file: _virtual(file, canary)),
        "linked.h5": lambda: _hdf5(lambda file: file.update({"x": h5py.ExternalLink(str(canary), "/")})),
        "deep_link.h5": lambda: _hdf5(lambda file: file.update({"a/b/c": h5py.ExternalLink(str(canary), "/")})),
        "many_sets.h5": lambda: _hdf5(lambda file: [_empty(file, f"x{n}", 999) for n in range(40)]),
        "large_piece.h5": lambda: _hdf5(lambda file: _empty(file, "x", _SIZE)),
        "many_groups.h5": lambda: _hdf5(lambda file: [file.create_group(f"g{n}") for n in range(3000)]),
        "external.mat": lambda: _hdf5(lambda file: _external(file, canary)),
        "shape.mat": lambda: _matlab(x=np.zeros(500)).replace(_shape(500), _shape(500_000_000)),
        "negative.mat": lambda: _matlab(x=np.zeros(500)).replace(_shape(500), _shape(-5)),
        "cells.mat": lambda: _matlab(x=np.full((300_000, 1), 0.0, object)),
        "many.mat": lambda: _matlab(**{f"x{n}": np.zeros((2_000_000, 2), np.int8) for n in range(20)}),
        "nested.mat": lambda: _matlab(x=_nested(200)),
        "entity.xlsx": lambda: workbook(CELLS.replace(">1<", ">&e;<", 1), f'<!ENTITY e SYSTEM "{canary.as_uri()}">'),
        "laughs.xlsx": lambda: workbook(CELLS.replace(">1<", ">&e9;<", 1), _laughs()),
        "far.xlsx": lambda: workbook("".join(row(n, "XFD", 1) for n in range(1, 9000))),
        "last_row.xlsx": lambda: workbook(row(1_048_576, "XFD", 1)),
        "declared.xlsx": lambda: workbook("<row/>" * (_SIZE // 2)),
        "letters.xlsx": lambda: workbook("".join(row(n, "A", "1" * 30_000) for n in range(1, 5000))),
        "outside.xlsx": lambda: workbook(CELLS).replace(b"xl/worksheets/a.xml", b"../../../../a/b.xml"),
        "bomb.csv.gz": lambda: gzip.compress(lines) * 250,
        "bomb.c3d.gz": lambda: gzip.compress(bytes(1_000_000)) * 250,
        "cut.trc.gz": lambda: gzip.compress(lines)[:-9],
        "twice.csv.gz": lambda: gzip.compress(gzip.compress(lines) * 100),
        "frames.c3d": lambda: _c3d({"POINT:FRAMES": [65535.0]}),
        "points.c3d": lambda: _c3d({"POINT:USED": [32767.0]}),
        "dimensions.c3d": lambda: _c3d({}).replace(b"LABELS", b"LABEL\xff"),
        "one_line.trc": lambda: b"PathFileType" + b"\t" * _SIZE,
        "columns.csv": lambda: b"a_x,a_y,a_z," * 400_000 + b"\n" + b"1," * 1_200_000 + b"\n" * 3,
        "blanks.csv": lambda: b"time_s," + b"_ " * 60_000 + b",C7_x\n" + b"1,2,3\n" * 9,
        "joints.bvh": lambda: b"HIERARCHY\nROOT A\n{\n" + b"JOINT B\n{\nOFFSET 0 0 0\n" * 50_000 + b"MOTION\n",
        "frames.bvh": lambda: b"HIERARCHY\nROOT A\n{\nOFFSET 0 0 0\n}\nMOTION\nFrames: 999999999\nFrame Time: 1e-9\n",
        "zeros.txt": lambda: b"0\n" * 1_000_000,
        "nul.txt": lambda: bytes(3_000_000),
        "quotes.txt": lambda: b'time_s,position_mm,force_N\n"' + b"1,2\n" * 400_000,
        "sampling.dat": lambda: b"sampl" * 50_000 + b"\n" + b"1;2;3\n" * 50,
        "deep_models.json": lambda: b"[" * 1_000_000,
        "many_models.json": lambda: b'{"schema": "lumbar.models/2", "models": [' + b"{}," * 30_000 + b"{}]}",
        "order_models.json": lambda: _models(100_000),
        "number_models.json": lambda: b'{"schema": ' + b"9" * 100_000 + b"}",
        "lists_models.json": lambda: b"[" + b"[[[[[]]]]]," * 1_360_000 + b"1]",
        "tags.yaml": lambda: b"a: !!bool maybe\nb: !!int ''\nc: !!timestamp x\n",
        "hours.yaml": lambda: b"a: 1:" + b"59:" * 330_000 + b"59\n",
        "list.yaml": lambda: b"a: [" + b"a," * 499_000 + b"a]",
        "merged.yaml": lambda: b"<<: " + _merged(7),
        "run.yaml": lambda: b"a: !!python/object/apply:os.system ['touch %s']\n" % str(marker).encode(),
        "include.yaml": lambda: b"a: !include %s\n" % str(canary).encode(),
        "laughs.yaml": lambda: b"".join(b"a%d: &a%d [*a%d, *a%d]\n" % (n, n, *[max(n - 1, 0)] * 2) for n in range(60)),
        "deep.yaml": lambda: b"a: " + b"[" * 50_000,
    }  # fmt: skip


def _hdf5(forge: Callable[[h5py.File], object]) -> bytes:
    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        file["force_N"] = np.arange(1000.0)
        forge(file)
    return content.getvalue()


def _external(file: h5py.File, canary: Path) -> None:
    file.create_dataset("position_mm", 1000, "u1", external=[(str(canary), 0, 1000)])


def _empty(file: h5py.File, name: str, piece: int) -> None:
    file.create_dataset(name, (_SIZE // 8,), "f4", maxshape=(None,), chunks=(piece,))


def _virtual(file: h5py.File, canary: Path) -> None:
    layout = h5py.VirtualLayout((1000,), "f8")
    layout[:] = h5py.VirtualSource(canary, "x", (1000,))
    file.create_virtual_dataset("position_mm", layout)


def _shape(count: int) -> bytes:
    return struct.pack("<2i", count, 1)


def _matlab(**variables) -> bytes:
    content = io.BytesIO()
    savemat(content, variables, do_compression="x0" in variables, oned_as="column")
    return content.getvalue()


def _nested(depth: int) -> dict:
    found: dict = {"x": 1.0}
    for _ in range(depth):
        found = {"x": found}
    return found


def _c3d(change: dict) -> bytes:
    return build_c3d(np.ones((30, 2, 3)), ["A", "B"], replace=change)


def _merged(depth: int) -> bytes:
    """A mapping that stands for thirty times as many of the one within."""
    found = b"{x: 1}"
    for number in range(depth):
        found = b"{<<: [&a%d %s%s]}" % (number, found, b", *a%d" % number * 29)
    return found


def _models(order: int) -> bytes:
    ports = Port("position", "mm"), Port("force", "N")
    model = FittedModel("KB", TransferFunction((0.5,), (1.0,)), 0.01, *ports, "KB")
    document = json.dumps(models_document([model], "forged"))
    forged = document.replace("[0.5]", str([1.0] * order))
    assert forged != document
    return forged.encode()


def row(number: int, columns: str, *values: object) -> str:
    """A row of a sheet: a value for each letter, or one below all of them."""
    places = columns if len(values) > 1 else [columns]
    cells = zip(places, values, strict=True)
    return f'<row r="{number}">' + "".join(f'<c r="{a}{number}"><v>{v}</v></c>' for a, v in cells) + "</row>"


CELLS = "".join(row(n, "ABC", n, n % 7, n % 5) for n in range(1, 60))


def _laughs() -> str:
    return '<!ENTITY e0 "ha">' + "".join(f'<!ENTITY e{n} "{f"&e{n - 1};" * 20}">' for n in range(1, 10))


def workbook(rows: str, entities: str = "") -> bytes:
    """A workbook of one sheet of these rows, without the dimension that programs write."""
    kind = "http://schemas.openxmlformats.org"
    office = f"{kind}/officeDocument/2006/relationships"
    book = "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet.main+xml"
    main, package = f"{kind}/spreadsheetml/2006/main", f"{kind}/package/2006"
    related = (
        f'<Relationships xmlns="{package}/relationships"><Relationship Id="a" Type="{office}/%s" Target="%s"/>'
        "</Relationships>"
    )
    parts = {
        "[Content_Types].xml": f'<Types xmlns="{package}/content-types"><Override PartName="/xl/workbook.xml" '
        f'ContentType="{book}"/></Types>',
        "_rels/.rels": related % ("officeDocument", "xl/workbook.xml"),
        "xl/workbook.xml": f'<workbook xmlns="{main}" xmlns:r="{office}"><sheets><sheet name="a" sheetId="1" r:id="a"/>'
        "</sheets></workbook>",
        "xl/_rels/workbook.xml.rels": related % ("worksheet", "worksheets/a.xml"),
        "xl/worksheets/a.xml": f'<!DOCTYPE w [{entities}]><worksheet xmlns="{main}"><sheetData>{rows}</sheetData></worksheet>',
    }
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in parts.items():
            archive.writestr(zipfile.ZipInfo(name), text, zipfile.ZIP_DEFLATED)
    return content.getvalue()


def valid_files() -> dict[str, bytes]:
    """Contents by name; the ending says which reader they are meant for."""
    time = np.arange(300) / 100
    columns = {"time_s": time, "position_mm": np.sin(time), "force_N": np.cos(time)}
    rows = [b"%.2f\t%.3f\t%.3f\n" % row for row in zip(*columns.values(), strict=True)]

    def packed(file: h5py.File) -> None:
        for name, values in columns.items():
            file.create_dataset(f"trial/{name}", data=values, chunks=(50,), compression="gzip")

    markers = np.cumsum(np.random.default_rng(3).normal(0, 3, (30, 4, 3)), axis=0) + np.array(
        [300, -200, 900]
    )
    numbers = ["\t".join(f"{value:.3f}" for value in values) for values in markers.reshape(30, -1)]
    header = ",".join(f"{name}_{axis}" for name in "ABCD" for axis in "xyz")
    names = "A\t\t\tB\t\t\tC\t\t\tD"
    record = "".join(
        ",".join(f"{value:.3f}" for value in values) + "\n" for values in zip(*columns.values(), strict=True)
    )
    return {
        "integer.c3d": build_c3d(markers, list("ABCD"), scale=0.05),
        "real.c3d": build_c3d(markers, list("ABCD"), scale=-1.0),
        "cortex.trc": (
            "PathFileType\t4\t(X/Y/Z)\tlift.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n60\t60\t30\t4\tmm\n"
            f"Frame#\tTime\t{names}\t\t\n\t\tX1\tY1\tZ1\n\n"
            + "".join(f"{n}\t{n / 60:.3f}\t{text}\t\n" for n, text in enumerate(numbers))
        ).encode(),
        "table.csv": (
            f"time_s,{header}\n"
            + "".join(f"{n / 60:.4f},{text}\n" for n, text in enumerate(numbers)).replace("\t", ",")
        ).encode(),
        "record.txt": f"{','.join(columns)}\n{record}".encode(),
        "record.txt.gz": gzip.compress(f"{','.join(columns)}\n{record}".encode(), mtime=0),
        "sound.mat": _matlab(**columns),
        "packed.mat": _matlab(x0=1.0, **columns),
        "sound.h5": _hdf5(
            lambda file: file.update(
                {"time_s": np.arange(1000) / 100, "position_mm": np.sin(np.arange(1000))}
            )
        ),
        "packed.h5": _hdf5(packed),
        "sound.xlsx": workbook(CELLS),
        "sound.dat": b"Time (s)\tPosition (mm)\tLoad (N)\n" + b"".join(rows),
        "models.json": _models(3),
    }


def changed(content: bytes, generator: np.random.Generator) -> bytes:
    """Change one or two places: other bytes, bytes removed, a piece repeated, or the end cut off."""
    for _ in range(int(generator.integers(1, 3))):
        # Every second place is one of the first 1500 bytes, where a binary file says what it is.
        at = int(
            generator.integers(max(1, min(len(content), 1500) if generator.random() < 0.5 else len(content)))
        )
        length = int(generator.integers(1, 4))
        piece, rest = content[at : at + length], content[at + length :]
        kind = int(generator.integers(4))
        digits = bytes(generator.choice(list(b"0123456789.,-e"), length).tolist())
        other = generator.bytes(length) if generator.random() < 0.3 else digits
        middle = (other, b"", piece * int(generator.integers(2, 50)), b"")[kind]
        content = content[:at] + middle + rest * (kind < 3)
    return content


def drawn(count: int, seed: int) -> Iterator[tuple[str, bytes]]:
    """Names and contents of files that are changed at random, every kind in turn."""
    generator = np.random.default_rng(seed)
    valid = list(valid_files().items())
    for number in range(count):
        name, content = valid[number % len(valid)]
        yield f"{number}_{name}", changed(content, generator)


def shows(found: object, canary: bytes) -> bool:
    """Whether a result holds what stands in another file: as text, as numbers or as bytes."""
    if isinstance(found, Mapping):
        return any(shows(item, canary) for pair in found.items() for item in pair)
    if isinstance(found, list | tuple | set):
        return any(shows(item, canary) for item in found)
    if is_dataclass(found):
        return any(shows(getattr(found, item.name), canary) for item in fields(found))
    if not isinstance(found, np.ndarray):
        return canary[:9].decode() in str(found)
    numbers = set(np.frombuffer(canary[: len(canary) // 8 * 8]).tolist()) | {4711.0815, -1234.5678}
    values = found.astype(float).ravel()
    with np.errstate(invalid="ignore"):
        as_bytes = np.clip(np.nan_to_num(values), 0, 255).astype(np.uint8).tobytes()
    return canary[:20] in as_bytes or canary[:16] in found.tobytes() or bool(numbers & set(values.tolist()))


def write_forged(folder: Path, drawn_too: int, seed: int) -> list[Path]:
    """Write what attacks, and so many files that are changed at random; return them."""
    (folder / "canary").write_bytes(SECRET)
    os.mkfifo(folder / "pipe")
    files = folder / "files"
    files.mkdir()
    for name, make in attacks(folder / "canary", folder / "marker").items():
        (files / name).write_bytes(make())
    for name, content in drawn(drawn_too, seed):
        (files / name).write_bytes(content)
    return sorted(files.iterdir())


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


def read_forged(path: Path) -> str | None:
    """Read a file: why it is refused, None where it is read.

    Raises
    ------
    AssertionError
        What is read or said shows another file, or the refusal does not name this one.
    """
    try:
        found = read_any(path)
    except InputError as error:
        assert path.name in str(error), path
        assert SECRET[:9].decode() not in str(error), path
        return str(error)
    assert not shows(found, SECRET), path
    return None
