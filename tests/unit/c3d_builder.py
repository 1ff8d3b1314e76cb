"""Writes C3D files byte by byte after the C3D user guide, independent of every library: for tests alone."""

import math
import struct

import numpy as np

INTEL, DEC, MIPS = 84, 85, 86


def build_c3d(
    points,
    labels,
    *,
    rate=100.0,
    unit="mm",
    processor=INTEL,
    scale=-1.0,
    residuals=None,
    analog=None,
    analog_per_frame=1,
    first_frame=1,
    trial=False,
    long_frames=False,
    extra=None,
    omit=(),
    replace=None,
):
    """Bytes of a C3D file of `points`, shape (n_frames, n_points, 3); `scale` > 0 stores integers.

    `analog`, shape (n_frames, samples), `trial` and `long_frames` add the fields for long recordings, `extra`
    adds parameters ``{"GROUP:NAME": values}``, `omit` leaves parameters out, `replace` sets others' values.
    """
    points = np.asarray(points, dtype=float)
    n_frames, n_points = points.shape[:2]
    samples = 0 if analog is None else analog.shape[1]
    last = first_frame + n_frames - 1
    clipped = min(last, 65535)
    parameters = {
        "POINT:USED": ("i", [n_points]),
        "POINT:FRAMES": ("i", [min(n_frames, 65535)]),
        "POINT:SCALE": ("f", [scale]),
        "POINT:RATE": ("f", [rate]),
        "POINT:DATA_START": ("i", [0]),
        "POINT:UNITS": ("s", [unit]),
        **{f"POINT:LABELS{part or ''}": ("s", chunk) for part, chunk in _label_lists(labels)},
        "ANALOG:USED": ("i", [samples // analog_per_frame]),
        "ANALOG:RATE": ("f", [rate * analog_per_frame]),
    }
    if trial:
        parameters["TRIAL:ACTUAL_START_FIELD"] = ("i", [first_frame % 65536, first_frame // 65536])
        parameters["TRIAL:ACTUAL_END_FIELD"] = ("i", [last % 65536, last // 65536])
    if long_frames:
        parameters["POINT:LONG_FRAMES"] = ("f", [float(n_frames)])
    for name, values in (extra or {}).items():
        parameters[name] = ("s" if isinstance(values[0], str) else "f", values)
    for name, values in (replace or {}).items():
        parameters[name] = (parameters[name][0], values)
    for name in omit:
        del parameters[name]
    size = len(_section(parameters, processor))
    data_block = 2 + math.ceil((size + 4) / 512)
    if "POINT:DATA_START" in parameters and "POINT:DATA_START" not in (replace or {}):
        parameters["POINT:DATA_START"] = ("i", [data_block])
    section = bytes([1, 0x50, data_block - 2, processor]) + _section(parameters, processor)
    head = bytes([2, 0x50]) + _words([n_points, samples, first_frame, clipped, 10], processor)
    head += (
        _reals([scale], processor)
        + _words([data_block, analog_per_frame], processor)
        + _reals([rate], processor)
    )
    content = head.ljust(512, b"\0") + section.ljust(512 * (data_block - 2), b"\0")
    return content + _frames(points, residuals, analog, scale, processor)


def _label_lists(labels):
    for part in range(max(1, math.ceil(len(labels) / 255))):
        yield (part + 1 if part else 0), list(labels[255 * part : 255 * part + 255])


def _words(values, processor):
    return np.asarray(values).astype(">u2" if processor == MIPS else "<u2").tobytes()


def _reals(values, processor):
    if processor == MIPS:
        return np.asarray(values, dtype=">f4").tobytes()
    if processor == INTEL:
        return np.asarray(values, dtype="<f4").tobytes()
    halves = (np.asarray(values, dtype="<f4") * np.float32(4)).view("<u2").reshape(-1, 2)
    return np.ascontiguousarray(halves[:, ::-1]).tobytes()


def _section(parameters, processor):
    order = ">h" if processor == MIPS else "<h"
    groups = {}
    for name in parameters:
        groups.setdefault(name.partition(":")[0], len(groups) + 1)
    content = b""
    for group, number in groups.items():
        content += struct.pack("bb", len(group), -number) + group.encode() + struct.pack(order, 3) + b"\0"
    for name, (kind, values) in parameters.items():
        group, _, short = name.partition(":")
        if kind == "s":
            width = max(map(len, values))
            dimensions = [width, len(values)]
            payload, code = "".join(value.ljust(width) for value in values).encode(), -1
        else:
            dimensions = [] if len(values) == 1 else [len(values)]
            payload = _words(values, processor) if kind == "i" else _reals(values, processor)
            code = 2 if kind == "i" else 4
        body = struct.pack("bB", code, len(dimensions)) + bytes(dimensions) + payload + b"\0"
        content += struct.pack("bb", len(short), groups[group]) + short.encode()
        content += struct.pack(order, len(body) + 2) + body
    return content + b"\0\0"


def _frames(points, residuals, analog, scale, processor):
    n_frames, n_points = points.shape[:2]
    residuals = np.zeros((n_frames, n_points)) if residuals is None else residuals
    analog = np.zeros((n_frames, 0)) if analog is None else analog
    quads = np.concatenate((points / scale if scale > 0 else points, residuals[..., None]), axis=2)
    rows = np.concatenate((quads.reshape(n_frames, -1), analog), axis=1)
    if scale > 0:
        return np.round(rows).astype(">i2" if processor == MIPS else "<i2").tobytes()
    return _reals(rows.ravel(), processor)


def read_c3d(path):
    """Markers of a C3D file as the file states them, read in this process."""
    from lumbar.records.c3d_file import c3d_content, c3d_markers

    return c3d_markers(c3d_content(path), str(path))
