"""One recording in two dozen dialects, in MATLAB and HDF5 files and in workbooks is read back as the same record."""

import sys

import numpy as np
import pytest
from foreign_files import FORCE, POSITION, RATE, TIME, foreign_files
from scipy.io import savemat

import lumbar
from lumbar.base.errors import InputError

FILES = foreign_files()


@pytest.mark.parametrize("name", FILES)
def test_a_dialect_is_read(tmp_path, name):
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
    savemat(
        tmp_path / "a.mat",
        {"time_ms": 1e3 * TIME, "disp_m": POSITION[:, None] / 1e3, "F": FORCE, "name": "x"},
    )
    check(lumbar.import_recordings(tmp_path / "a.mat", force_unit="N"))


def test_fields_of_a_structure_with_the_rate_beside(tmp_path):
    trial = {"position_mm": POSITION, "force_N": FORCE, "fs": RATE}
    savemat(tmp_path / "a.mat", {"speed_test": trial})
    imported = lumbar.import_recordings(tmp_path / "a.mat")
    check(imported)
    assert imported[0].grounds["time"] == "no column; 200 Hz as speed_test.fs says"


def test_signals_of_simulink_are_named_by_their_labels(tmp_path):
    signals = [{"values": POSITION, "label": "stroke [mm]"}, {"values": FORCE, "label": "load [N]"}]
    savemat(tmp_path / "a.mat", {"out": {"time": TIME, "signals": np.array(signals, dtype=object)}})
    imported = lumbar.import_recordings(tmp_path / "a.mat")
    check(imported)
    assert imported[0].grounds["force"].startswith("column 3 'out.signals(2).load' [N], by its name")


def test_columns_of_a_matrix_are_chosen_by_name(tmp_path):
    savemat(tmp_path / "a.mat", {"data": np.column_stack([TIME, FORCE, POSITION])})
    told = {"position_unit": "mm", "force_unit": "N", "time_unit": "s"}
    with pytest.raises(InputError, match=r"choose by --position NAME or NUMBER among .*'data\(:,2\)'"):
        lumbar.import_recordings(tmp_path / "a.mat", **told)
    names = {"time": "data(:,1)", "position": "data(:,3)", "force": "data(:,2)"}
    check(lumbar.import_recordings(tmp_path / "a.mat", **names, **told))


def test_trials_of_several_lengths_are_refused_until_one_is_chosen(tmp_path):
    trial = {"time_s": TIME, "position_mm": POSITION, "force_N": FORCE}
    short = {name: values[:300] for name, values in trial.items()}
    savemat(tmp_path / "a.mat", {"trial": np.array([trial, short], dtype=object)})
    said = r"trial\(2\).time_s, .* \(300 values\).*choose a part with --table VARIABLE"
    with pytest.raises(InputError, match=said):
        lumbar.import_recordings(tmp_path / "a.mat")
    check(lumbar.import_recordings(tmp_path / "a.mat", table="trial(1)"))
    with pytest.raises(InputError, match=r"no variable 'trial\(3\)'; there are trial\(1\).time_s"):
        lumbar.import_recordings(tmp_path / "a.mat", table="trial(3)")


def test_vectors_of_one_length_are_chosen_by_naming_them(tmp_path):
    """As benchmarks give them: an estimation part and a longer validation part in one file."""
    parts = {"uEst": POSITION[:200], "yEst": FORCE[:200], "uVal": POSITION, "yVal": FORCE, "fs": RATE}
    savemat(tmp_path / "a.mat", parts)
    units = {"position_unit": "mm", "force_unit": "N"}
    offered = r"--position uEst --force yEst, or --position uVal --force yVal"
    with pytest.raises(InputError, match=offered):
        lumbar.import_recordings(tmp_path / "a.mat", **units)
    check(lumbar.import_recordings(tmp_path / "a.mat", position="uVal", force="yVal", **units))
    [short] = lumbar.import_recordings(tmp_path / "a.mat", position="uEst", force="yest", **units)
    assert short.record["output"] == pytest.approx(FORCE[:200])
    with pytest.raises(InputError, match=r"'uEst' has 200 and 'yVal' 600 values"):
        lumbar.import_recordings(tmp_path / "a.mat", position="uEst", force="yVal", **units)
    with pytest.raises(InputError, match=r"--force 'yTest': no such column.*; there are .*uEst"):
        lumbar.import_recordings(tmp_path / "a.mat", position="uEst", force="yTest", **units)


def test_a_single_vector_is_no_recording(tmp_path):
    savemat(tmp_path / "a.mat", {"force_N": FORCE})
    with pytest.raises(InputError, match=r"need two vectors of one length.*force_N \(600 values\)"):
        lumbar.import_recordings(tmp_path / "a.mat")


def test_matlab_7_3_has_its_matrices_on_their_sides(tmp_path):
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
    with pytest.raises(InputError, match="broken HDF5 file"):
        lumbar.import_recordings(tmp_path / "broken.h5")


def test_compound_data_sets_have_their_fields(tmp_path):
    h5py = pytest.importorskip("h5py")
    rows = np.rec.fromarrays([TIME, POSITION, FORCE], names="time_s,position_mm,force_N")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["table"] = rows
    check(lumbar.import_recordings(tmp_path / "a.h5"))


@pytest.mark.parametrize(("package", "first"), [("h5py", b"\x89HDF\r\n\x1a\n"), ("openpyxl", b"PK\x03\x04")])
def test_a_package_that_is_not_installed_is_named(tmp_path, monkeypatch, package, first):
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / "a.bin").write_bytes(first + bytes(600))
    with pytest.raises(InputError, match=rf"needs the package {package}: pip install 'lumbar\[import\]'"):
        lumbar.import_recordings(tmp_path / "a.bin")


def test_a_sheet_of_a_workbook(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.title = "Trial"
    for row in (
        ["Bench 3"],
        [],
        ["Zeit [s]", "Weg [mm]", "Kraft [N]"],
        *zip(TIME, POSITION, FORCE, strict=True),
    ):
        sheet.append([float(cell) if isinstance(cell, np.floating) else cell for cell in row])
    book.save(tmp_path / "a.xlsx")
    check(lumbar.import_recordings(tmp_path / "a.xlsx"))
    book.create_sheet("Notes").append(["nothing"])
    book.save(tmp_path / "a.xlsx")
    with pytest.raises(InputError, match="2 sheets hold something: Trial, Notes; choose by --sheet NAME"):
        lumbar.import_recordings(tmp_path / "a.xlsx")
    check(lumbar.import_recordings(tmp_path / "a.xlsx", table="Trial"))


@pytest.mark.parametrize(
    ("name", "first", "message"),
    [("a.xls", b"\xd0\xcf\x11\xe0", "save it as"), ("a.c3d", b"\x02P", "file of markers")],
)
def test_files_of_other_kinds(tmp_path, name, first, message):
    (tmp_path / name).write_bytes(first + bytes(600))
    with pytest.raises(InputError, match=message):
        lumbar.import_recordings(tmp_path / name)
