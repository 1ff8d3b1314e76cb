"""Comparison of two runs' outputs in `make test-portable`."""

import io
import json
import zipfile

import pytest

from portable import outputs


def archive(text: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        file.writestr(zipfile.ZipInfo("model.json"), text)
    return stream.getvalue()


CSV = b"name,rms,count\na,1000.0,3\nb,0.001,4\n"


def test_digits_are_counted_against_the_largest_of_a_kind():
    digits = outputs.digits
    assert digits(CSV, CSV, ".csv") == outputs.SAME_BYTES
    assert digits(CSV, CSV.replace(b"0.001", b"0.002"), ".csv") == pytest.approx(6)
    one, other = ({"path": [0.0, x], "large": 1e9} for x in (2.0, 2.0002))
    assert digits(json.dumps(one).encode(), json.dumps(other).encode(), ".json") == pytest.approx(4, abs=0.01)
    assert digits(b"<p>x = 100.0</p>", b"<p>x = 100.1</p>", ".svg") == pytest.approx(3, abs=0.01)
    assert digits(archive(b'{"a": 100}'), archive(b'{"a": 101}'), ".fmu") == pytest.approx(2, abs=0.01)


@pytest.mark.parametrize(
    ("one", "other", "suffix"),
    [
        (CSV, CSV.replace(b"b,", b"c,"), ".csv"),
        (CSV, CSV.replace(b"0.001", b""), ".csv"),
        (b'{"verdict": "named", "x": 1}', b'{"verdict": "tied", "x": 1}', ".json"),
        (b'{"x": [1, 2]}', b'{"x": [1]}', ".json"),
        (b"\xff\xfe\x00", b"\xff\xfe\x01", ".pdf"),
    ],
)
def test_more_than_numbers_is_no_agreement(one, other, suffix):
    assert outputs.digits(one, other, suffix) == outputs.DIFFERENT
