"""Column files become validated records, or an error that says where and why."""

import gzip
import shlex

import numpy as np
import pytest
from scipy.io import savemat

import lumbar
from refusing import has_tokens, refusal
from study_settings import changed

LAYOUT = lumbar.ColumnLayout.model_validate(
    {
        "columns": {
            "time": {"column": "t", "quantity": "time", "unit": "s"},
            "input": {"column": "z", "quantity": "position", "unit": "mm"},
            "output": {"column": "f", "quantity": "force", "unit": "N"},
        }
    },
)
TIME = np.arange(50) / 100


def read_record(path, layout, **options):
    return lumbar.read(path, "tissue", layout=layout, **options)[0]


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
    record = read_record(written(tmp_path, text_of(values)), LAYOUT, periods={"trial": 0.25})
    assert record.name == "trial"
    assert record["input"] == pytest.approx(values[:, 1], abs=1e-6)
    assert record.channels["output"].label == "Force (N)"
    assert record.sampling_time == pytest.approx(0.01)
    assert record.duration == pytest.approx(0.5)
    assert record.period == 0.25
    part = record.between(0.1, 0.2)
    assert len(part) == 10
    assert part.time[0] == pytest.approx(0.1)


def test_optional_column_may_be_absent_or_constant(tmp_path, values):
    optional = {"column": "l", "quantity": "length", "unit": "m", "optional": True}
    layout = changed(LAYOUT, columns={"length": optional})
    assert "length" not in read_record(written(tmp_path, text_of(values)), layout).channels
    resting = np.column_stack([values, np.full(len(values), 0.4)])
    text = text_of(resting, "t,z,f,l", "{:.6f},{:.6f},{:.6f},{:.6f}")
    assert read_record(written(tmp_path, text), layout)["length"] == pytest.approx(0.4)
    needed = changed(LAYOUT, columns={"length": {**optional, "optional": False}})
    assert has_tokens(refusal(read_record, written(tmp_path, text_of(values)), needed), "length … 'l'")
    with pytest.raises(lumbar.InputError, match=r"line 2\b.*length\b.*\bnan"):
        broken = text.replace("0.400000\n", "nan\n", 1)
        read_record(written(tmp_path, broken), layout)
    savemat(tmp_path / "trial.mat", dict(zip("tzf", values.T, strict=True)))
    read = read_record(tmp_path / "trial.mat", changed(layout, format="mat"))
    assert set(read.channels) == {"input", "output"}


def test_scale_offset_numbers_comments_and_decimal_comma(tmp_path, values):
    text = text_of(1000 * values, header="% made up\n", form="{:.3f}\t{:.3f}\t{:.3f}").replace(".", ",")
    layout = lumbar.ColumnLayout.model_validate(
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
    with pytest.raises(lumbar.InputError, match=r"(?s)trial\.mat.*\bf\b.*real.*lengths"):
        read_record(path, changed(LAYOUT, format="mat"))
    path.write_bytes(b"nonsense")
    assert has_tokens(refusal(read_record, path, changed(LAYOUT, format="mat")), "trial.mat … MATLAB")


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
    ("text", "changes", "problems"),
    [
        ("", {}, ["trial.csv … rows"]),
        ("t,z,f\n", {}, ["trial.csv … rows"]),
        ("t,z\n0,1\n", {}, ["output: … 'f' … t, z"]),
        ("t,z,f\n0,1,2\n", {}, ["1 samples … 8"]),
        ("t,z,f\n" + "x,y\n" * 10_000, {}, ["20 problems"]),
        (
            with_lines({4: "0.02,abc,1", 8: "0.06,,1"}), {},
            ["2 problems", "line 4: input … 'abc'", "line 8: input … ''"],
        ),
        (commas("{:.3f};{:.3f};{:.3f}"), {}, ["line 2: 6 cells … 3 … delimiter … decimal"]),
        (commas("{:.3f};{:.3f};{:.3f}"), {"decimal": ","}, ["',' … delimiter … decimal"]),
        # Comments and empty lines count: it is the line an editor shows.
        (
            with_lines({6: "0.04,1,nan"}, "# a comment", ""), {"comment": "#"},
            ["line 8: output … nan … 1e+06 N"],
        ),
        (with_lines({5: "0.03,1"}), {}, ["line 5: 2 cells … 3"]),
        (with_lines({5: "0.03,1,1e307"}), {"columns": {"output": {"scale": 1e3}}}, ["line 5: output … inf"]),
        (
            text_of(TWICE, "t,z,f,f", "{:.6f},{:.6f},{:.6f},{:.6f}"), {},
            ["output: … 3 and 4 … 'f'"],
        ),
    ],
)  # fmt: skip
def test_faulty_file_is_rejected_with_place(tmp_path, text, changes, problems):
    message = refusal(read_record, written(tmp_path, text), changed(LAYOUT, **changes))
    assert [tokens for tokens in problems if not has_tokens(message, tokens)] == []


@pytest.mark.parametrize("text", ["Zeit;Weg;Kraft\n0,0;1,0;2,0\n", "t,z,f\n0,eins,2\n", "t;z;f\n0;\xb5;2\n"])
def test_unreadable_layout_suggests_import(tmp_path, text):
    file = tmp_path / "a file's.csv"
    file.write_bytes(text.encode("latin-1"))
    (command,) = (line for line in refusal(read_record, file, LAYOUT).splitlines() if "lumbar import" in line)
    assert shlex.split(command.partition("lumbar import ")[2])[0] == str(file)
    (tmp_path / "study.yaml").touch()
    assert refusal(read_record, file, LAYOUT).endswith(f" --config {tmp_path / 'study.yaml'}")


def test_trim_ignores_faults_outside(tmp_path, values):
    """A gap before the part is no fault; lines are still counted in the file."""
    text = text_of(values).replace("0.050000,", "0.049000,").replace("0.200000,", "0.190000,")
    path = written(tmp_path, text)
    assert has_tokens(refusal(read_record, path, LAYOUT), "line 22: … 0.19 s … 0.19 s")
    record = read_record(path, LAYOUT, trims={"trial": (0.205, 0.4)})
    assert record.time == pytest.approx(TIME[21:40])
    assert record["output"] == pytest.approx(values[21:40, 2], abs=1e-6)
    assert has_tokens(refusal(read_record, path, LAYOUT, trims={"trial": (0.1, 0.4)}), "line 22")
    message = refusal(read_record, path, LAYOUT, trims={"trial": (0.45, 0.485)})
    assert has_tokens(message, "4 samples … 0.45 … 0.485 s … 0 … 0.49 s")
