"""The messages on the page of marker files are those that files with these faults end in."""

import gzip
import re

import numpy as np
import pytest
from c3d_builder import build_c3d

import lumbar
from lumbar.base.errors import InputError
from lumbar.records.markers import read_markers
from lumbar.settings.layout import MarkerLayout

POINTS = np.random.default_rng(5).normal(0, 3, (40, 3, 3))
POINTS += np.array([[300, -200, 900], [0, 0, 400], [200, 300, 10]])
LABELS = ["C7", "SACRUM", "L_TOE"]
HEAD = "PathFileType\t4\tX\nDataRate\tNumFrames\tNumMarkers\tUnits\n{rate}\t{frames}\t{markers}\tmm\nFrame#\tTime\t{names}\n\n"
BVH = b"HIERARCHY\nROOT A\n{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n}\nMOTION\nFrames: 21\nFrame Time: 0.01\n"
TABLE = "time_s,C7_x,C7_y,C7_z\n0.00,1,2,1450\n0.01,2,3,1451\n0.02,3,4,1452\n"


def c3d(points=POINTS, labels=LABELS, cut=0, more=0, layout=None, **change):
    content = build_c3d(points, labels, **change)
    return "lift.c3d", content[: len(content) - cut] + bytes(more), layout


def trc(layout=None, lose=False, rate=100, frames=12, markers=2, names="C7\t\t\tSACRUM\t\t"):
    rows = [f"{n}\t{n / 100:.2f}\t{n}\t2\t1450\t4\t{-n}\t1000" for n in range(12)]
    rows[4] = rows[4].replace("\t1450", "") if lose else rows[4]
    head = HEAD.format(rate=rate, frames=frames, markers=markers, names=names)
    return "lift.trc", (head + "\n".join(rows) + "\n").encode(), layout


def table(text=TABLE, unit="mm"):
    return "lift.csv", text.encode(), MarkerLayout(unit=unit)


def shifted(inserted=b"\x7e", stop=-1):
    name, content, layout = c3d()
    return name, content[:-700] + inserted + content[-700:stop], layout


def corrupt():
    name, content, layout = c3d()
    return name, content.replace(b"UNITS", b"UN\x01TS"), layout


FILES = {
    "not a C3D file": ("lift.c3d", b"<html>" * 400, None),
    "frames of": c3d(cut=100),
    "the number of frames is": c3d(replace={"POINT:FRAMES": [38]}, more=3000),
    "scale factor:": c3d(scale=0.05, replace={"POINT:SCALE": [0.04]}),
    "number of points:": c3d(replace={"POINT:USED": [4]}, more=3000),
    "analog samples per frame:": c3d(replace={"ANALOG:USED": [3]}),
    "POINT:LABELS:": c3d(omit=["POINT:LABELS"]),
    "the parameter section is corrupt": corrupt(),
    "no points,": c3d(points=np.zeros((40, 0, 3)), labels=[""], analog=np.zeros((40, 6))),
    "bytes follow the last": shifted(b"inserted", None),
    "m away, first in frame": shifted(),
    "1 frame;": c3d(points=POINTS[:1]),
    "the file states no unit": table(unit="file"),
    "the file states 'mm'": c3d(layout=MarkerLayout(unit="m")),
    "m apart,": c3d(points=1000 * POINTS),
    "markers.up:": c3d(
        points=POINTS[..., [0, 2, 1]], labels=["C7", "SACRUM", "L_TOE"], layout=MarkerLayout(up="+z")
    ),
    "but the toes are ahead": c3d(
        points=np.add(POINTS, [[0, 0, 0], [0, 0, 0], [0, -300, 390]]), labels=["C7", "L_HEEL", "L_TOE"]
    ),
    "stands for several subjects": c3d(labels=["ann:C7", "bob:C7", "ann:SACRUM"]),
    "cells;": trc(lose=True),
    "NumFrames:": trc(frames=40),
    "line 4 names": trc(markers=4, names="\tC7\t\tSACRUM"),
    "the clock is not even": trc(rate=60),
    "no column of times": table(TABLE.replace("time_s", "frame")),
    "C7: has the columns": table(TABLE.replace("C7_z", "height")),
    "Frames: 21;": ("lift.bvh", BVH + b"0\n" * 20, None),
    "unpacks to more than": ("bomb.csv.gz", gzip.compress(b"0" * 1_000_000) * 201, None),
}
"""A file with the fault, by the beginning of the page's message: name, content, layout."""


def messages(project):
    page = (project / "docs" / "lifting" / "marker_files.md").read_text(encoding="utf-8")
    section = page.split("## Your file says …\n")[1]
    return re.findall(r"^\| `(.+?)` \|", section, flags=re.MULTILINE)


def test_every_message_has_a_file(project):
    assert len(messages(project)) == len(FILES)
    for start in FILES:
        assert sum(text.startswith(start) for text in messages(project)) == 1, start


@pytest.mark.parametrize("start", FILES)
def test_a_file_with_the_fault_ends_in_the_message(project, tmp_path, start):
    name, content, layout = FILES[start]
    path = tmp_path / name
    path.write_bytes(content)
    text = next(text for text in messages(project) if text.startswith(start))
    pattern = ".*".join(map(re.escape, text.split("…")))
    with pytest.raises(InputError, match=f"(?s){pattern}"):
        if name.endswith(".gz"):
            lumbar.read(path)
        else:
            read_markers(path, layout)
