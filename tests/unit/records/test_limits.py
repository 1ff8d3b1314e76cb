"""Files that are small and stand for much, or hold what no recording holds: refused at once, with their place."""

import gzip

import numpy as np
import pytest
from scipy.io import savemat

import lumbar
from lumbar.base.errors import InputError
from lumbar.records.numbers import number
from lumbar.records.unpacking import LARGEST_RATIO, SMALLEST_LIMIT, unpack
from lumbar.settings.layout import ColumnLayout, columns

ROWS = [f"{n / 100:.2f},{n % 7},{n % 5}" for n in range(200)]


def write(tmp_path, cell=None, name="record.csv"):
    rows = list(ROWS)
    if cell is not None:
        rows[50] = f"0.50,1,{cell}"
    path = tmp_path / name
    content = ("time_s,position_mm,force_N\n" + "\n".join(rows) + "\n").encode()
    path.write_bytes(gzip.compress(content) if name.endswith(".gz") else content)
    return path


@pytest.mark.parametrize(
    ("cell", "said"),
    [
        ("1_000", "line 52: output is '1_000'; a number is needed"),
        ("\u0661\u0662", "line 52: output is"),  # Arabic digits, which Python's float reads
        (
            "1e11",
            "line 52: output is 100000000000.0; every value must be a finite number, of at most 1e+06 N in size",
        ),
        ("-2e6", "of at most 1e+06 N in size"),
        ("9" * 400, "line 52: output is inf"),
        ("\0", "line 52: output is '\\x00'"),
        ('"' + "x" * 200_000, "line 52: "),
        ("x" * 2_000_000, "line 52 has more than 1000000 characters"),
    ],
)
@pytest.mark.parametrize("name", ["record.csv", "record.csv.gz"])
def test_cells_that_no_recording_holds(tmp_path, cell, said, name):
    path = write(tmp_path, cell, name)
    with pytest.raises(InputError) as caught:
        lumbar.read(path)
    assert said in str(caught.value)
    assert str(path) in str(caught.value)
    assert len(str(caught.value)) < 1000


def test_packed_files_read_as_before(tmp_path):
    plain, packed = lumbar.read(write(tmp_path)), lumbar.read(write(tmp_path, name="record.csv.gz"))
    np.testing.assert_array_equal(plain["record"]["output"], packed["record"]["output"])


def test_large_packed_file_is_read_as_a_plain_table(tmp_path):
    rows = "".join(f"{n / 1000:.3f},{n % 7},{n % 5}\n" for n in range(500_000))
    path = tmp_path / "long.csv.gz"
    path.write_bytes(gzip.compress(("time_s,position_mm,force_N\n" + rows).encode(), 1))
    record = lumbar.read(path)["long"]
    assert len(record) == 500_000
    assert record["output"][-1] == 499_999 % 5


@pytest.mark.parametrize("reader", [lumbar.read, lambda path: lumbar.import_recordings([path])])
def test_a_small_file_that_unpacks_to_much_is_refused(tmp_path, reader):
    path = tmp_path / "bomb.csv.gz"
    line = b"0.000,1.000,1.000\n" * 50_000
    with gzip.open(path, "wb") as stream:
        for _ in range(100):
            stream.write(line)
    assert LARGEST_RATIO * path.stat().st_size < SMALLEST_LIMIT < 100 * len(line)
    with pytest.raises(InputError, match=r"bomb\.csv\.gz: unpacks to more than 50 MB"):
        reader(path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda packed: packed[:-20], "cut short|broken"),
        (lambda packed: packed[:30] + b"\xff" * 20 + packed[50:], "broken"),
        (lambda packed: b"\x1f\x8b" + b"\0" * 30, "broken"),
    ],
)
def test_broken_packed_files(tmp_path, change, said):
    path = write(tmp_path, name="record.csv.gz")
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(InputError, match=said):
        lumbar.read(path)


def test_packed_in_two_parts(tmp_path):
    path = tmp_path / "two.gz"
    path.write_bytes(gzip.compress(b"a" * 3_000_000) + gzip.compress(b"b") + b"\0" * 10)
    assert unpack(path.read_bytes(), path) == b"a" * 3_000_000 + b"b"


@pytest.mark.parametrize("text", ["1", "-1.5e3", " 2 ", "nan", ".5", "1e400"])
def test_numbers(text):
    np.testing.assert_equal(number(text), float(text))


@pytest.mark.parametrize("reader", [lumbar.import_recordings, None])
def test_matlab_file_that_stands_for_much(tmp_path, reader):
    """Zeros pack into a thousandth of what they take."""
    path = tmp_path / "zeros.mat"
    savemat(path, {"t": np.zeros(51_000_000, np.int8), "z": [1.0, 2], "f": [3.0, 4]}, do_compression=True)
    assert path.stat().st_size < 100_000
    layout = ColumnLayout(format="mat", columns=columns(time=("t", "s", "time"), output=("f", "N", "force")))
    with pytest.raises(
        InputError, match=r"zeros\.mat: its variable 't' holds 51000000 numbers; at most 50000000"
    ):
        reader([path]) if reader else lumbar.read(path, layout=layout)
