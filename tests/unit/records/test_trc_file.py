"""TRC: irregular real files, and text built line by line."""

import numpy as np
import pytest

import lumbar
from refusing import has_tokens, refusal


def read_trc(path):
    """Read the markers in the file's axes, in metres."""
    return lumbar.read(path, "markers", layout=lumbar.MarkerLayout(check_axes=False))


def trc(
    tmp_path,
    rows=None,
    *,
    names="C7\t\t\tSACR\t\t\t",
    header=None,
    first="Frame#\tTime\t",
    axes=True,
    tabs="\t",
    between="\t",
):
    """Write a TRC file of two markers; `rows` are the data lines, `between` parts the keys, `tabs` all else."""
    rows = rows if rows is not None else regular_rows(12)
    keys = {"DataRate": "100.00", "CameraRate": "100.00", "NumFrames": str(len(rows)), "NumMarkers": "2"}
    keys |= {"Units": "mm", **(header or {})}
    lines = [
        "PathFileType\t4\t(X/Y/Z)\tC:\\lift.trc",
        between.join(keys),
        "\t".join(keys.values()),
        first + names,
        "\t\tX1\tY1\tZ1\tX2\tY2\tZ2" if axes else "",
        "",
        *rows,
    ]
    path = tmp_path / "lift.trc"
    path.write_bytes("\r\n".join(lines).replace("\t", tabs).encode("cp1252"))
    return path


def regular_rows(count, start=17.5, rate=100.0, digits=3):
    return [
        f"{6116 + frame}\t{start + frame / rate:.{digits}f}\t{frame}\t2\t1450\t4\t{-frame}\t1000"
        for frame in range(count)
    ]


def test_values_clock_and_unit(tmp_path):
    file = read_trc(trc(tmp_path))
    np.testing.assert_allclose(file["C7"], [[0.001 * frame, 0.002, 1.45] for frame in range(12)])
    np.testing.assert_allclose(file["SACR"], [[0.004, -0.001 * frame, 1] for frame in range(12)])
    np.testing.assert_allclose(file.time, 17.5 + np.arange(12) / 100)
    assert file.rate == 100


@pytest.mark.parametrize(
    "irregular",
    [
        {"names": "C7\t\tSACR"},
        {"names": "C7\t\t\t\t\t\tSACR\t\t\t\t\t\t"},
        {"first": "Frame#\t\tTime\t\t"},
        {"names": "\tC7\t\tSACR\t\t"},
        {"first": "Frame#\tTimes\t"},
        {"axes": False},
        {"tabs": ","},
        {"between": "\t\t"},
        {"rows": ["\t" + row for row in regular_rows(12)]},
        {"rows": [row + "\t\t" for row in regular_rows(12)]},
        {"rows": ["", *regular_rows(12), "", ""], "header": {"NumFrames": "12"}},
    ],
)
def test_irregular_files_have_equal_values(tmp_path, irregular):
    (tmp_path / "regular").mkdir()
    expected = read_trc(trc(tmp_path / "regular"))
    file = read_trc(trc(tmp_path, **irregular))
    assert list(file.positions) == ["C7", "SACR"]
    for label, values in expected.positions.items():
        np.testing.assert_array_equal(file.positions[label], values)


@pytest.mark.parametrize("names", ["C7\t\t\tSACR\t\t\t", "C7\t\t\tSACR", "C7\t\t\t\t\t\tSACR\t\t\t"])
def test_trajectories_without_label_are_dropped(tmp_path, names):
    """Cortex counts them in NumMarkers and leaves their names out."""
    rows = [row + "\t7\t8\t9" for row in regular_rows(12)]
    file = read_trc(trc(tmp_path, rows, names=names, header={"NumMarkers": "3"}))
    gap = names.count("\t") == 9
    assert list(file.positions) == ["C7", "SACR"]
    np.testing.assert_allclose(1e3 * file["SACR"][0], [7, 8, 9] if gap else [4, 0, 1000])
    assert [has_tokens(reason, "label") for reason in file.dropped.values()] == [True]


@pytest.mark.parametrize("end", ["", "\t", "\t\t"])
@pytest.mark.parametrize("lost", [0, 1, 3, 6])
def test_lost_cell_is_rejected(tmp_path, end, lost):
    """Rows that end in a tab have a spare empty cell, which must not replace the lost one."""
    rows = [row + end for row in regular_rows(12)]
    cells = rows[4].split("\t")
    rows[4] = "\t".join(cells[:lost] + cells[lost + 1 :])
    message = refusal(read_trc, trc(tmp_path, rows))
    assert has_tokens(message, f"line 11: {len(cells) - 1} cells … {len(cells)}")


def test_lost_column_is_rejected(tmp_path):
    rows = ["\t".join([*row.split("\t")[:3], *row.split("\t")[4:], ""]) for row in regular_rows(12)]
    assert has_tokens(refusal(read_trc, trc(tmp_path, rows)), "lift.trc … marker 2 … column")


def test_clock_with_two_digits_is_even(tmp_path):
    rows = regular_rows(300, rate=120.0, digits=2)
    file = read_trc(trc(tmp_path, rows, header={"DataRate": "120"}))
    np.testing.assert_allclose(file.time, 17.5 + np.arange(300) / 120)


def test_rate_of_zero_is_taken_from_the_times(tmp_path):
    file = read_trc(trc(tmp_path, regular_rows(12, rate=90.0, digits=6), header={"DataRate": "0"}))
    assert file.rate == 90
    assert has_tokens(" ".join(file.notes), "DataRate … 90 Hz")
    uneven = regular_rows(12, rate=90.0, digits=6)
    del uneven[5]
    assert has_tokens(refusal(read_trc, trc(tmp_path, uneven, header={"DataRate": "0"})), "frame … clock")


def test_missing_samples(tmp_path):
    rows = regular_rows(6)
    rows[2] = "6118\t17.520\t0\t0\t0\t4\t-2\t1000"
    rows[3] = "6119\t17.530\t\t\t\t4\t-3\t1000"
    rows[4] = "6120\t17.540\t4\t2\t1450\tNaN\tNaN\tNaN"
    rows[5] = "6121\t17.550\t5\t2\t1450\t\t\t"
    file = read_trc(trc(tmp_path, rows))
    assert np.flatnonzero(np.isnan(file.positions["C7"]).all(axis=1)).tolist() == [2, 3]
    assert np.flatnonzero(np.isnan(file.positions["SACR"]).all(axis=1)).tolist() == [4, 5]


def test_more_frames_than_stated_are_read_with_a_note(tmp_path):
    file = read_trc(trc(tmp_path, header={"NumFrames": "9"}))
    assert len(file) == 12
    assert has_tokens(" ".join(file.notes), "NumFrames … 9 … 12")


def changed(row, text):
    rows = regular_rows(12)
    rows[row] = text
    return rows


@pytest.mark.parametrize(
    ("options", "tokens"),
    [
        ({"header": {"NumMarkers": "3"}}, "8 cells … 11 … 3 markers"),
        ({"header": {"NumMarkers": "1"}}, "NumMarkers: 1 … line 4 … 2 markers"),
        ({"header": {"DataRate": "-1"}}, "DataRate: -1 … positive"),
        ({"header": {"DataRate": "inf"}}, "DataRate: inf … 0.001 … 1e+06"),
        ({"header": {"NumFrames": "1e999"}}, "NumFrames: 1e999"),
        ({"rows": changed(4, "6120\t17.54\t1_000\t2\t1450\t4\t-4\t1000")}, "line 11: column 3 … '1_000'"),
        ({"header": {"DataRate": "fast"}}, "DataRate: 'fast'"),
        ({"rows": [row + "\t3" for row in regular_rows(12)]}, "line 7: 9 cells … 8"),
        ({"names": "C7 SACR", "first": "Frame# Time "}, "line 4 … tabs … commas"),
        ({"rows": changed(4, "6120\t17.54\t4\tx\t1450\t4\t-4\t1000")}, "line 11: column 4 … 'x'"),
        ({"rows": changed(4, "6120\t\t4\t2\t1450\t4\t-4\t1000")}, "line 11: … time"),
        ({"rows": changed(4, "6120\t17.54\t4\t1e308\t1450\t4\t-4\t1000")}, "line 11: 1e+308 … column 4"),
        ({"rows": [*regular_rows(6), *regular_rows(6, start=17.6)]}, "rate … frames"),
        ({"header": {"DataRate": "50"}}, "DataRate: 50 … 100 Hz"),
        ({"header": {"NumFrames": "13"}}, "NumFrames: 13 … 12"),
        ({"header": {"Units": "m"}}, "'m' … markers.scale … 0.001"),
        ({"rows": [], "header": {"NumFrames": "1"}}, "no … rows"),
        ({"first": "Time\tFrame\t"}, "line 4: … ['Time', 'Frame'] … Frame# … Time"),
        ({"names": ""}, "line 4: … marker"),
    ],
)
def test_contradictory_trc_files_are_rejected(tmp_path, options, tokens):
    path = trc(tmp_path, **options)
    message = refusal(read_trc, path)
    assert has_tokens(message, tokens) and str(path) in message


@pytest.mark.parametrize("content", [b"", b"time,x\n0,1\n", b"PathFileType\t4\n", bytes(range(256)) * 20])
def test_files_of_other_kinds_are_rejected(tmp_path, content):
    path = tmp_path / "lift.trc"
    path.write_bytes(content)
    assert has_tokens(refusal(read_trc, path), "lift.trc … TRC")


def test_real_irregular_file_against_its_own_text(shared):
    path = shared / "real" / "lifting" / "weird_squat_trc" / "markers_Squat2.trc"
    file = read_trc(path)
    lines = path.read_text().splitlines()
    row = [float(cell) for cell in lines[6 + 99].split("\t") if cell.strip()]
    values = np.array([points[99] for points in file.positions.values()]).ravel()
    np.testing.assert_allclose(np.nan_to_num(values), row[2:])
    zeros = sum(
        cells[first : first + 3] == ["0", "0", "0"]
        for cells in ([cell.strip() for cell in line.split("\t")] for line in lines[6:])
        for first in range(2, len(cells), 3)
    )
    missing = sum(np.isnan(points[:, 0]).sum() for points in file.positions.values())
    assert missing == zeros > 100
