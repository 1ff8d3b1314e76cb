"""One recording in two dozen dialects, in MATLAB and HDF5 files and in workbooks is read back as the same record."""

import json
import sys

import numpy as np
import pytest
from foreign_files import FORCE, POSITION, RATE, TIME, foreign_files, rows
from scipy.io import savemat

import lumbar
from refusing import has_tokens, refusal

FILES = foreign_files()


@pytest.mark.parametrize("name", FILES)
def test_dialect_is_detected(tmp_path, name):
    content, told = FILES[name]
    (tmp_path / name).write_bytes(content)
    [imported] = lumbar.import_recordings(tmp_path / name, **told)
    record = imported.record
    assert 1 / record.sampling_time == pytest.approx(RATE)
    assert record.time - record.time[0] == pytest.approx(TIME, abs=1e-9)
    assert record["input"] == pytest.approx(POSITION, abs=2e-5)
    assert record["output"] == pytest.approx(FORCE, abs=2e-5)
    assert list(imported.frame()) == ["time_s", "position_mm", "force_N"]
    assert not imported.notes


def check(imported):
    [one] = imported
    assert 1 / one.record.sampling_time == pytest.approx(RATE)
    np.testing.assert_allclose(one.record["input"], POSITION, atol=1e-9)
    np.testing.assert_allclose(one.record["output"], FORCE, atol=1e-9)


def test_vectors_of_a_matlab_file(tmp_path):
    variables = {"time_ms": 1e3 * TIME, "disp_m": POSITION[:, None] / 1e3, "F": FORCE, "name": "x"}
    savemat(tmp_path / "a.mat", variables)
    check(lumbar.import_recordings(tmp_path / "a.mat", force_unit="N"))


def test_structure_may_state_rate(tmp_path):
    trial = {"position_mm": POSITION, "force_N": FORCE, "fs": RATE}
    savemat(tmp_path / "a.mat", {"speed_test": trial})
    imported = lumbar.import_recordings(tmp_path / "a.mat")
    check(imported)
    assert has_tokens(imported[0].grounds["time"], "200 Hz … speed_test.fs")


def test_simulink_signals_are_named_by_labels(tmp_path):
    signals = [{"values": POSITION, "label": "stroke [mm]"}, {"values": FORCE, "label": "load [N]"}]
    savemat(tmp_path / "a.mat", {"out": {"time": TIME, "signals": np.array(signals, dtype=object)}})
    imported = lumbar.import_recordings(tmp_path / "a.mat")
    check(imported)
    assert has_tokens(imported[0].grounds["force"], "column 3 'out.signals(2).load' [N] … name")


def test_columns_of_a_matrix_are_chosen_by_name(tmp_path):
    savemat(tmp_path / "a.mat", {"data": np.column_stack([TIME, FORCE, POSITION])})
    told = {"position_unit": "mm", "force_unit": "N", "time_unit": "s"}
    with pytest.raises(lumbar.InputError, match=r"--position .*'data\(:,2\)'"):
        lumbar.import_recordings(tmp_path / "a.mat", **told)
    names = {"time": "data(:,1)", "position": "data(:,3)", "force": "data(:,2)"}
    check(lumbar.import_recordings(tmp_path / "a.mat", **names, **told))


def test_trials_of_several_lengths_need_choice(tmp_path):
    trial = {"time_s": TIME, "position_mm": POSITION, "force_N": FORCE}
    short = {name: values[:300] for name, values in trial.items()}
    savemat(tmp_path / "a.mat", {"trial": np.array([trial, short], dtype=object)})
    fragment = r"trial\(2\).time_s, .* \(300 values\).*--table VARIABLE"
    with pytest.raises(lumbar.InputError, match=fragment):
        lumbar.import_recordings(tmp_path / "a.mat")
    check(lumbar.import_recordings(tmp_path / "a.mat", table="trial(1)"))
    message = refusal(lumbar.import_recordings, tmp_path / "a.mat", table="trial(3)")
    assert has_tokens(message, "'trial(3)' … trial(1).time_s")


def test_named_vectors_choose_length(tmp_path):
    """As benchmarks give them: an estimation part and a longer validation part in one file."""
    parts = {"uEst": POSITION[:200], "yEst": FORCE[:200], "uVal": POSITION, "yVal": FORCE, "fs": RATE}
    savemat(tmp_path / "a.mat", parts)
    units = {"position_unit": "mm", "force_unit": "N"}
    offered = r"--position uEst --force yEst.*--position uVal --force yVal"
    with pytest.raises(lumbar.InputError, match=offered):
        lumbar.import_recordings(tmp_path / "a.mat", **units)
    check(lumbar.import_recordings(tmp_path / "a.mat", position="uVal", force="yVal", **units))
    [short] = lumbar.import_recordings(tmp_path / "a.mat", position="uEst", force="yest", **units)
    assert short.record["output"] == pytest.approx(FORCE[:200])
    message = refusal(lumbar.import_recordings, tmp_path / "a.mat", position="uEst", force="yVal", **units)
    assert has_tokens(message, "'uEst' … 200 … 'yVal' … 600")
    with pytest.raises(lumbar.InputError, match=r"--force 'yTest'.*'uEst'"):
        lumbar.import_recordings(tmp_path / "a.mat", position="uEst", force="yTest", **units)


def test_matlab_7_3_matrices_are_transposed(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
        for name, values in (("time_s", TIME), ("position_mm", POSITION), ("force_N", FORCE)):
            file[f"trial/{name}"] = values[None, :]
        file["#refs#/a"] = np.arange(50.0)
    check(lumbar.import_recordings(tmp_path / "a.mat"))


def test_hdf5_states_units_and_rate_as_attributes(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["position"], file["load"] = POSITION / 25.4, FORCE / 1e3
        file["position"].attrs["unit"], file["load"].attrs["unit"] = "in", b"kN"
        file.attrs["sampling_rate"] = RATE
    check(lumbar.import_recordings(tmp_path / "a.h5"))
    (tmp_path / "broken.h5").write_bytes((tmp_path / "a.h5").read_bytes()[:600])
    assert has_tokens(refusal(lumbar.import_recordings, tmp_path / "broken.h5"), "broken.h5 … HDF5")


def test_compound_data_sets_have_their_fields(tmp_path):
    h5py = pytest.importorskip("h5py")
    rows = np.rec.fromarrays([TIME, POSITION, FORCE], names="time_s,position_mm,force_N")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["table"] = rows
    check(lumbar.import_recordings(tmp_path / "a.h5"))


@pytest.mark.parametrize(("package", "first"), [("h5py", b"\x89HDF\r\n\x1a\n"), ("openpyxl", b"PK\x03\x04")])
def test_missing_package_is_named(tmp_path, monkeypatch, package, first):
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / "a.bin").write_bytes(first + bytes(600))
    message = refusal(lumbar.import_recordings, tmp_path / "a.bin")
    assert has_tokens(message, f"a.bin … {package} … pip install 'lumbar[import]'")


def test_sheet_of_workbook_is_read(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.title = "Trial"
    head = (["Bench 3"], [], ["Zeit [s]", "Weg [mm]", "Kraft [N]"])
    for row in (*head, *zip(TIME, POSITION, FORCE, strict=True)):
        sheet.append([float(cell) if isinstance(cell, np.floating) else cell for cell in row])
    book.save(tmp_path / "a.xlsx")
    check(lumbar.import_recordings(tmp_path / "a.xlsx"))
    book.create_sheet("Notes").append(["nothing"])
    book.save(tmp_path / "a.xlsx")
    check(lumbar.import_recordings(tmp_path / "a.xlsx"))
    second = book.copy_worksheet(sheet)
    book.save(tmp_path / "a.xlsx")
    message = refusal(lumbar.import_recordings, tmp_path / "a.xlsx")
    assert has_tokens(message, f"2 sheets … Trial, {second.title} … --sheet NAME")
    check(lumbar.import_recordings(tmp_path / "a.xlsx", table="Trial"))


def write_table(path, table) -> None:
    """Write rows of cells as a sheet, or as CSV."""
    if path.suffix == ".csv":
        cells = (["" if cell is None else str(cell) for cell in row] for row in table)
        path.write_text("".join(f"{','.join(row)}\n" for row in cells))
        return
    book = pytest.importorskip("openpyxl").Workbook()
    for row in table:
        book.active.append(row)
    book.save(path)


UNITS = [["Temps d'essai", "Force", "Allongement"], ["s", "N", "mm"]]
TABLE = [[*map(float, row)] for row in zip(TIME, FORCE, POSITION, strict=True)]
"""Rows of numbers."""
LAYOUTS = {
    "a sum under it": ([*UNITS, *TABLE, [], [], [None, 5.5]], "line 605"),
    "means with a label": ([*UNITS, *TABLE, [], ["Mean", 5.5, 3.1], ["Max", 7.0, 8.5]], "2 … line 604"),
    "a repeated header": ([*UNITS, *TABLE[:300], *UNITS, *TABLE[300:]], "2 … line 303"),
    "a maximum in a column": ([[*UNITS[0], "Force max"], UNITS[1], [*TABLE[0], 9.5], *TABLE[1:]], ""),
    "a total in the row below": ([*UNITS, *TABLE, [None, 5.5, 3.1]], "line 603"),
    "a cell to the right": ([*UNITS, [*TABLE[0], None, None, 5.5], *TABLE[1:]], "line 3, column 6 … '5.5'"),
    "empty columns to the left": ([[None, None, *row] for row in (*UNITS, *TABLE)], ""),
    "a column of notes": (
        [[*UNITS[0], "Note"], UNITS[1], [*TABLE[0], "slip"], [*TABLE[1], 3], *TABLE[2:]],
        "",
    ),
    "a comment between rows": (
        [*UNITS, *TABLE[:300], ["probe cleaned"], *TABLE[300:]],
        "line 303 … 'probe cleaned'",
    ),
    "merged cells above": (
        [["Temps d'essai", "Sensor"], [None, "Force", "Allongement"], UNITS[1], *TABLE],
        "",
    ),
}


@pytest.mark.parametrize("suffix", [".csv", ".xlsx"])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_cells_outside_a_table_are_noted_and_no_row_is_lost(tmp_path, layout, suffix):
    table, note = LAYOUTS[layout]
    width = max(map(len, table))
    write_table(tmp_path / f"a{suffix}", [[*row, *[None] * (width - len(row))] for row in table])
    imported = lumbar.import_recordings(tmp_path / f"a{suffix}")
    check(imported)
    text = "".join(";".join("" if cell is None else str(cell) for cell in row) + "\n" for row in table)
    (tmp_path / "a.txt").write_text(text.replace(".", ","))
    check(lumbar.import_recordings(tmp_path / "a.txt"))
    assert not note or any(has_tokens(item, note) for item in imported[0].notes), imported[0].notes


@pytest.mark.parametrize("suffix", [".csv", ".xlsx"])
@pytest.mark.parametrize("spacer", [[], [None]])
def test_tables_abreast_are_chosen_by_number(tmp_path, suffix, spacer):
    short = [[*map(float, row)] for row in zip(TIME[:300], 2 * FORCE[:300], POSITION[:300], strict=True)]
    right = [*UNITS, *short, *[[None] * 3] * 300]
    write_table(tmp_path / f"a{suffix}", [a + spacer + b for a, b in zip(UNITS + TABLE, right, strict=True)])
    message = refusal(lumbar.import_recordings, tmp_path / f"a{suffix}")
    first = 4 + len(spacer)
    assert has_tokens(message, f"2 tables … columns 1 to 3 … lines 3 to 302, columns {first} to {first + 2}")
    prefix = "Sheet:" if suffix == ".xlsx" else ""
    assert suffix == ".csv" or f"{prefix}1" in message
    check(lumbar.import_recordings(tmp_path / f"a{suffix}", table=f"{prefix}1"))
    [two] = lumbar.import_recordings(tmp_path / f"a{suffix}", table=f"{prefix}2")
    np.testing.assert_allclose(two.record["output"], 2 * FORCE[:300], atol=1e-9)


def test_rows_of_a_matrix_are_channels(tmp_path):
    savemat(tmp_path / "a.mat", {"data": np.stack([TIME, POSITION, FORCE])})
    assert has_tokens(refusal(lumbar.import_recordings, tmp_path / "a.mat"), "--position … 'data(2,:)'")
    names = {"time": "data(1,:)", "position": "data(2,:)", "force": "data(3,:)"}
    units = {"position_unit": "mm", "force_unit": "N", "time_unit": "s"}
    check(lumbar.import_recordings(tmp_path / "a.mat", **names, **units))
    savemat(tmp_path / "a.mat", {"data": np.ones((3, 5))})
    assert has_tokens(refusal(lumbar.import_recordings, tmp_path / "a.mat"), "data 3 x 5")


@pytest.mark.parametrize(
    "head", ["Frequency [Hz],G' [Pa],G'' [Pa]", "ω in rad/s,Storage modulus,Loss modulus"]
)
def test_tables_over_frequency_are_rejected(tmp_path, head):
    (tmp_path / "a.csv").write_text(f"{head}\n" + rows(","))
    message = refusal(lumbar.import_recordings, tmp_path / "a.csv")
    assert has_tokens(message, "column 1 … column 2 … --time, --position … --force")
    units = {"time_unit": "s", "position_unit": "mm", "force_unit": "N"}
    check_names = {"time": 1, "position": 2, "force": 3}
    assert len(lumbar.import_recordings(tmp_path / "a.csv", **check_names, **units)[0].record) == 600


def test_clock_of_an_arduino_is_in_milliseconds(tmp_path):
    (tmp_path / "a.csv").write_text("millis,z mm,F N\n" + rows(",", columns=(1e3 * TIME, POSITION, FORCE)))
    [one] = lumbar.import_recordings(tmp_path / "a.csv")
    assert 1 / one.record.sampling_time == pytest.approx(RATE)


@pytest.mark.parametrize(
    ("name", "first", "message"),
    [
        (
            "a.ods",
            b"PK\x03\x04" + bytes(26) + b"mimetypeapplication/vnd.oasis.opendocument",
            r"a\.ods.*\.xlsx",
        ),
        ("a.xls", b"\xd0\xcf\x11\xe0", r"a\.xls.*\.xlsx"),
        ("a.c3d", b"\x02P", r"a\.c3d.*markers"),
    ],
)
def test_old_workbooks_and_marker_files_are_rejected(tmp_path, name, first, message):
    (tmp_path / name).write_bytes(first + bytes(600))
    with pytest.raises(lumbar.InputError, match=message):
        lumbar.import_recordings(tmp_path / name)


CHINESE = "试验机 3\n时间 [s],位移 [mm],力 [N]\n" + rows(",")


@pytest.mark.parametrize(
    ("encoding", "text"),
    [
        ("gbk", CHINESE),
        ("big5", "時間 [s],位移 [mm],力 [N]\n" + rows(",")),
        ("shift_jis", "試験\n時間 [s],変位 [mm],荷重 [N]\n" + rows(",")),
        ("cp1251", "время [s],перемещение [mm],сила [N]\n" + rows(",")),
        ("cp850", "Zeit [s];Weg [mm];Prüfkraft [N]\n" + rows(";", ",")),
    ],
)
def test_unknown_encoding_must_be_given(tmp_path, encoding, text):
    path = tmp_path / "trial.txt"
    path.write_bytes(text.encode(encoding))
    with pytest.raises(lumbar.InputError, match=r"line 1 .*UTF-8.*--encoding gbk"):
        lumbar.import_recordings(path)
    [one] = lumbar.import_recordings(path, encoding=encoding)
    np.testing.assert_allclose(one.record["input"], POSITION, atol=2e-5)
    np.testing.assert_allclose(one.record["output"], FORCE, atol=2e-5)
    assert one.form.startswith(f"{encoding}, ")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_utf_encodings_are_detected(tmp_path, encoding):
    (tmp_path / "trial.txt").write_bytes(CHINESE.encode(encoding))
    [one] = lumbar.import_recordings(tmp_path / "trial.txt")
    assert has_tokens(one.grounds["force"], "column 3 '力' [N]")
    [told] = lumbar.import_recordings(tmp_path / "trial.txt", encoding=encoding)
    assert told.record["output"] == pytest.approx(one.record["output"])


def test_windows_1252_is_detected(tmp_path):
    text = "# Prüfkraft, größer als 5 °C – N·m, 20 µm²\ntime_s,position_mm,force_N\n" + rows(",")
    (tmp_path / "trial.txt").write_bytes(text.encode("cp1252"))
    [one] = lumbar.import_recordings(tmp_path / "trial.txt")
    assert one.form.startswith("Windows-1252, ")


def test_wrong_encoding_is_rejected(run, tmp_path):
    path = tmp_path / "trial.txt"
    path.write_bytes(CHINESE.encode("gbk"))
    err = run.refused("import", path, "--encoding", "klingon", "--dry-run")
    assert has_tokens(err, "--encoding 'klingon' … gbk")
    message = refusal(lumbar.import_recordings, path, encoding="base64")
    assert has_tokens(message, "--encoding 'base64' … gbk")
    message = refusal(lumbar.import_recordings, path, encoding="utf-8")
    assert has_tokens(message, "trial.txt … line 1 … utf-8")


HEAD = "time_s,position_mm,force_N\n"


@pytest.fixture
def source(tmp_path):
    """Return the path of a recording of 3 s."""
    path = tmp_path / "bench.csv"
    path.write_text(HEAD + rows(","))
    return path


def trials(path, labels, time=TIME, head="time_s,position_mm,force_N,trial\n"):
    """Write the recording with a column more."""
    lines = rows(",", columns=(time, POSITION, FORCE)).splitlines()
    path.write_text(head + "".join(f"{line},{label}\n" for line, label in zip(lines, labels, strict=True)))
    return path


def test_cut_spans_become_named_records(run, source, tmp_path):
    cuts = ("--cut", "fit=:1", "--cut", "unseen=1:2.5")
    out = run.done("import", source, *cuts, "--output", tmp_path / "records")
    assert has_tokens(out, "200 of 600 … --cut fit=:1")
    records = lumbar.read(tmp_path / "records")
    assert records.names == ["fit", "unseen"]
    np.testing.assert_allclose(records["fit"]["output"], FORCE[:200], atol=2e-5)
    np.testing.assert_allclose(records["unseen"]["input"], POSITION[200:500], atol=2e-5)
    assert records["unseen"].time[0] == 1
    entries = json.loads((tmp_path / "records/imported.json").read_text())["records"]
    assert has_tokens(entries[0]["notes"][0], "200 of 600 … --cut fit=:1")
    assert has_tokens(entries[1]["notes"][0], "300 of 600 … --cut unseen=1:2.5")


def test_all_wrong_cuts_are_listed(run, source):
    cuts = ("fit=0:1", "unseen=0.5:2", "late=10:20", "../up=2:2.5", "fit=2.5:2.6", "back=2.9:2.7")
    status, out, err = run("import", source, *(word for cut in cuts for word in ("--cut", cut)), "--dry-run")
    assert (status, out) == (1, "")
    for tokens in (
        "fit … unseen … 0.5 … 1 s",
        "--cut late=10:20 … 0 samples … 10 … 20 s … 0 … 2.995 s",
        "'../up' … letters, digits, _",
        "2 … 'fit'",
        "--cut back=2.9:2.7",
    ):
        assert has_tokens(err, tokens), tokens
    assert "5 problems" in err


def test_number_column_splits_trials(tmp_path):
    """The clock of each trial may start at 0."""
    numbers = np.repeat([1, 2, 3], 200)
    path = trials(tmp_path / "bench.csv", numbers, time=np.tile(TIME[:200], 3))
    imported = lumbar.import_recordings(path, cut_by="trial")
    assert imported.records.names == ["bench_1", "bench_2", "bench_3"]
    for number, one in enumerate(imported):
        assert one.record.time == pytest.approx(TIME[:200])
        assert one.record["output"] == pytest.approx(FORCE[200 * number :][:200], abs=2e-5)
        assert has_tokens(one.notes[0], f"200 of 600 … column 4 'trial' … {number + 1}")


def test_text_column_splits_trials(tmp_path):
    names = ["slow"] * 200 + [""] * 50 + ["fast sine"] * 250 + ["slow"] * 100
    path = trials(tmp_path / "bench.csv", names)
    imported = lumbar.import_recordings(path, cut_by=4)
    assert imported.records.names == ["bench_slow", "bench_fast_sine", "bench_slow_2"]
    assert [len(one.record) for one in imported] == [200, 250, 100]
    assert 1 / imported[1].record.sampling_time == pytest.approx(RATE)


def test_invalid_trials_are_rejected(tmp_path):
    path = trials(tmp_path / "bench.csv", np.repeat([1, 2, 3], [300, 295, 5]))
    for column, tokens in (
        ("trial", "bench_3 … 5 samples … 8"),
        ("cycle", "--cut-by 'cycle' … column 4 'trial'"),
        ("time", "--cut-by … 600 intervals"),
    ):
        assert has_tokens(refusal(lumbar.import_recordings, path, cut_by=column), tokens), tokens
