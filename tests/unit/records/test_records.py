"""Column files become validated records, or an error that says where and why."""

import gzip
import shlex

import numpy as np
import pytest
from scipy.io import savemat

from lumbar.base.errors import InputError
from lumbar.records.columns import read_record
from lumbar.records.record import Channel, Record, check_record, require_same_units
from lumbar.records.sampling import resample
from lumbar.settings.layout import ColumnLayout
from refusing import refusal
from study_settings import changed

LAYOUT = ColumnLayout.model_validate(
    {
        "columns": {
            "time": {"column": "t", "quantity": "time", "unit": "s"},
            "input": {"column": "z", "quantity": "position", "unit": "mm"},
            "output": {"column": "f", "quantity": "force", "unit": "N"},
        }
    },
)
TIME = np.arange(50) / 100


def text_of(values, header="t,z,f", form="{:.6f},{:.6f},{:.6f}") -> str:
    return "\n".join([header, *(form.format(*row) for row in values)]) + "\n"


@pytest.fixture
def values():
    return VALUES.copy()


def written(tmp_path, text, name="trial.csv"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_values_units_and_clock_are_read(tmp_path, values):
    record = read_record(written(tmp_path, text_of(values)), LAYOUT, period=0.25)
    assert record.name == "trial"
    assert record["input"] == pytest.approx(values[:, 1], abs=1e-6)
    assert record.channels["output"].label == "Force (N)"
    assert record.sampling_time == pytest.approx(0.01)
    assert record.duration == pytest.approx(0.5)
    assert record.period == 0.25
    part = record.between(0.1, 0.2)
    assert len(part) == 10
    assert part.time[0] == pytest.approx(0.1)


def test_an_optional_column_may_be_absent_or_rest(tmp_path, values):
    optional = {"column": "l", "quantity": "length", "unit": "m", "optional": True}
    layout = changed(LAYOUT, columns={"length": optional})
    assert "length" not in read_record(written(tmp_path, text_of(values)), layout).channels
    resting = np.column_stack([values, np.full(len(values), 0.4)])
    text = text_of(resting, "t,z,f,l", "{:.6f},{:.6f},{:.6f},{:.6f}")
    assert read_record(written(tmp_path, text), layout)["length"] == pytest.approx(0.4)
    with pytest.raises(InputError, match="no column 'l'"):
        read_record(
            written(tmp_path, text_of(values)),
            changed(LAYOUT, columns={"length": {**optional, "optional": False}}),
        )
    with pytest.raises(InputError, match=r"length is nan"):
        broken = text.replace("0.400000\n", "nan\n", 1)
        read_record(written(tmp_path, broken), layout)
    savemat(tmp_path / "trial.mat", dict(zip("tzf", values.T, strict=True)))
    read = read_record(tmp_path / "trial.mat", changed(layout, format="mat"))
    assert set(read.channels) == {"input", "output"}


def test_scale_offset_numbers_comments_and_decimal_comma(tmp_path, values):
    text = text_of(1000 * values, header="% made up\n", form="{:.3f}\t{:.3f}\t{:.3f}").replace(".", ",")
    layout = ColumnLayout.model_validate(
        {
            "delimiter": "\t",
            "header": False,
            "comment": "%",
            "decimal": ",",
            "columns": {
                "time": {"column": 1, "unit": "ms"},
                "input": {"column": 3, "unit": "mm", "scale": 0.001, "offset": 5},
            },
        },
    )
    record = read_record(written(tmp_path, text), layout)
    assert record.time == pytest.approx(TIME, abs=1e-9)
    assert record["input"] == pytest.approx(values[:, 2] + 5, abs=1e-6)


def test_gzip_whitespace_and_byte_order_mark(tmp_path, values):
    path = tmp_path / "run.2.txt.gz"
    text = "﻿" + text_of(values, header="t z  f", form="  {:.6f}   {:.6f} {:.6f}")
    path.write_bytes(gzip.compress(text.encode()))
    record = read_record(path, changed(LAYOUT, delimiter="whitespace"))
    assert record.name == "run.2"
    assert record["output"] == pytest.approx(values[:, 2], abs=1e-6)


def test_matlab_files(tmp_path, values):
    path = tmp_path / "trial.mat"
    savemat(path, {"t": values[:, 0], "z": values[:, [1]], "f": values[:, 2]})
    record = read_record(path, changed(LAYOUT, format="mat"))
    assert record["input"] == pytest.approx(values[:, 1])
    savemat(path, {"t": values[:, 0], "z": values[:5, 1], "f": 1j * values[:, 2]})
    with pytest.raises(InputError, match=r"(?s)not a vector of real numbers.*different lengths"):
        read_record(path, changed(LAYOUT, format="mat"))
    path.write_bytes(b"nonsense")
    with pytest.raises(InputError, match="not a MATLAB file"):
        read_record(path, changed(LAYOUT, format="mat"))


def test_empty_first_cells_and_quoted_headers_keep_their_columns(tmp_path, values):
    layout = changed(LAYOUT, delimiter="\t")
    text = text_of(values, header="\tt\tz\tf", form="\t{:.6f}\t{:.6f}\t{:.6f}")
    assert read_record(written(tmp_path, text), layout)["output"] == pytest.approx(values[:, 2], abs=1e-6)
    text = text_of(values, header='"t","z","f, raw"')
    layout = changed(LAYOUT, columns={"output": {"column": "f, raw", "unit": "N"}})
    record = read_record(written(tmp_path, text), layout)
    assert record["output"] == pytest.approx(values[:, 2], abs=1e-6)


VALUES = np.column_stack([TIME, np.sin(20 * TIME), np.cos(20 * TIME)])
TWICE = np.column_stack([VALUES, VALUES[:, 2]])


def with_lines(lines: dict[int, str], *more: str) -> str:
    """A sound file with other lines in some places and more before the header."""
    whole = text_of(VALUES).splitlines()
    return "\n".join([*more, *(lines.get(number, line) for number, line in enumerate(whole, start=1))])


def commas(form: str) -> str:
    return text_of(VALUES, form=form).replace(".", ",").replace(";", ",")


@pytest.mark.parametrize(
    ("text", "changes", "said"),
    [
        ("", {}, ["no data rows"]),
        ("t,z,f\n", {}, ["no data rows"]),
        ("t,z\n0,1\n", {}, ["output: no column 'f'; the header has t, z"]),
        ("t,z,f\n0,1,2\n", {}, ["1 samples; at least 8"]),
        ("t,z,f\n" + "x,y\n" * 10_000, {}, ["stopped after 20 problems"]),
        (
            with_lines({4: "0.02,abc,1", 8: "0.06,,1"}), {},
            ["2 problems", "line 4: input is 'abc'", "line 8: input is ''"],
        ),
        (commas("{:.3f};{:.3f};{:.3f}"), {}, ["line 2: 6 cells; 3 are needed: check delimiter and decimal"]),
        (commas("{:.3f};{:.3f};{:.3f}"), {"decimal": ","}, ["both as delimiter and as decimal mark"]),
        # Comments and empty lines count: it is the line an editor shows.
        (
            with_lines({6: "0.04,1,nan"}, "# a comment", ""), {"comment": "#"},
            ["line 8: output is nan; every value must be a finite number, of at most 1e+06 N in size"],
        ),
        (with_lines({5: "0.03,1"}), {}, ["line 5: 2 cells; 3 are needed"]),
        (with_lines({5: "0.03,1,1e307"}), {"columns": {"output": {"scale": 1e3}}}, ["line 5: output is inf"]),
        (
            text_of(TWICE, "t,z,f,f", "{:.6f},{:.6f},{:.6f},{:.6f}"), {},
            ["output: columns 3 and 4 have the name 'f'; give the number of one of them"],
        ),
    ],
)  # fmt: skip
def test_a_file_with_a_fault_is_refused_with_its_place(tmp_path, text, changes, said):
    told = refusal(read_record, written(tmp_path, text), changed(LAYOUT, **changes))
    for words in said:
        assert words in told


@pytest.mark.parametrize("text", ["Zeit;Weg;Kraft\n0,0;1,0;2,0\n", "t,z,f\n0,eins,2\n", "t;z;f\n0;\xb5;2\n"])
def test_a_file_that_is_laid_out_otherwise_is_led_to_its_import(tmp_path, text):
    file = tmp_path / "a file's.csv"
    file.write_bytes(text.encode("latin-1"))
    (command,) = (line for line in refusal(read_record, file, LAYOUT).splitlines() if "lumbar import" in line)
    assert shlex.split(command.partition("lumbar import ")[2])[0] == str(file)
    (tmp_path / "study.yaml").touch()
    assert refusal(read_record, file, LAYOUT).endswith(f" --config {tmp_path / 'study.yaml'}")


def record_of(time, *channels, name="r") -> Record:
    named = zip(("input", "output"), channels, strict=False)
    return Record(name, np.asarray(time), {role: Channel(np.asarray(v), role, "mm") for role, v in named})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t, v: (t, np.where(np.arange(50) == 6, np.nan, v)), "sample 7: input is nan"),
        (lambda t, v: (t, np.full(50, 2.0)), "input: constant"),
        (lambda t, v: (np.where(np.arange(50) == 9, 0.0, t), v), "sample 10: time 0 s after 0.08 s"),
        (lambda t, v: (t + 0.01 * (np.arange(50) >= 20), v), "sample 21: step of 0.02 s"),
        (lambda t, v: (t**1.2, v), "sampled evenly"),
    ],
)
def test_records_that_cannot_be_analysed(change, message):
    time, value = change(TIME, np.sin(TIME))
    with pytest.raises(InputError, match=message):
        check_record(record_of(time, value))


def test_a_clock_written_with_few_digits_is_even():
    time = np.round(np.arange(300) / 128, 3)
    assert check_record(record_of(time, np.sin(time))).sampling_time == pytest.approx(1 / 128, rel=1e-3)


def test_sets_share_quantities_and_units():
    a, b = record_of(TIME, TIME, TIME, name="a"), record_of(TIME, TIME, TIME, name="b")
    require_same_units([])
    require_same_units([a, b])
    b.channels["output"] = Channel(TIME, "output", "kN")
    with pytest.raises(InputError, match="b: output is output in kN, but output in mm in a"):
        require_same_units([a, b])
    with pytest.raises(InputError, match="output is missing"):
        require_same_units([a, record_of(TIME, TIME, name="b")])


def test_resampling_keeps_what_lies_below_and_removes_what_lies_above():
    time = np.arange(4000) / 1000
    slow, fast = np.sin(2 * np.pi * 7 * time), np.sin(2 * np.pi * 180 * time)
    record = record_of(time, slow + fast + 10)
    result = resample(record, 200.0)
    assert result.sampling_time == pytest.approx(1 / 200)
    assert (len(result), result.time[0], result.time[-1]) == (780, 0.05, pytest.approx(3.945))
    # The window's ripple, at every sample: none is left that the filter could not see whole.
    assert result["input"] == pytest.approx(np.sin(2 * np.pi * 7 * result.time) + 10, abs=0.01)
    assert resample(record, 1000.0) is record
    with pytest.raises(InputError, match="simpler ratio"):
        resample(record, 0.3)


@pytest.mark.parametrize("rate", [10.0, 25.0, 50.0, 64.0, 150.0, 400.0])
def test_a_record_that_ends_in_full_motion_does_not_ring(rate):
    """Sensors stopped at full speed: a filter that guesses how the motion goes on would make peaks of its own."""
    time = np.arange(2000) / 100
    record = record_of(time, 3 * np.cos(2 * np.pi * 0.31 * time) + 5, 80 * np.cos(2 * np.pi * 0.31 * time))
    result = resample(record, rate)
    assert result["output"] == pytest.approx(80 * np.cos(2 * np.pi * 0.31 * result.time), abs=0.2)
    assert 0 < result.time[0] - time[0] <= 10 / min(rate, 100) + 1e-9
    assert 0 < time[-1] - result.time[-1] <= 11 / min(rate, 100) + 1e-9


def test_a_record_too_short_for_the_filter_is_refused():
    record = record_of(np.arange(200) / 100, np.sin(np.arange(200)))
    said = "2 s are too short to be resampled to 10 Hz: 10 samples are left out"
    assert said in refusal(resample, record, 10.0)


def test_a_part_is_read_and_the_rest_not_even_checked(tmp_path, values):
    """A gap before the part is no fault; lines are still counted in the file."""
    text = text_of(values).replace("0.050000,", "0.049000,").replace("0.200000,", "0.190000,")
    path = written(tmp_path, text)
    with pytest.raises(InputError, match=r"line 22: time 0\.19 s after 0\.19 s"):
        read_record(path, LAYOUT)
    record = read_record(path, LAYOUT, trim=(0.205, 0.4))
    assert record.time == pytest.approx(TIME[21:40])
    assert record["output"] == pytest.approx(values[21:40, 2], abs=1e-6)
    with pytest.raises(InputError, match="line 22"):
        read_record(path, LAYOUT, trim=(0.1, 0.4))
    with pytest.raises(InputError, match=r"4 samples from 0.45 to 0.485 s; the clock runs from 0 to 0.49 s"):
        read_record(path, LAYOUT, trim=(0.45, 0.485))
