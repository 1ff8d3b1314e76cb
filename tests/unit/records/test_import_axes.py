"""Foreign tables of several axes: which columns are found, what is asked, and the study that is written of them."""

import numpy as np
import pytest
from foreign_files import DIGITS, POSITION, TIME, rows
from scipy.io import savemat

import lumbar
from case_tables import cases
from refusing import has_tokens, refusal

MOVED = [POSITION + number * np.roll(POSITION, 7 * number) for number in range(10)]
"""A signal for each column, all different."""


def written(tmp_path, header: str, name="trial.csv"):
    names = header.split(",")
    columns = [TIME if item[0] in "tTZ" and item[:2] != "to" else MOVED[at] for at, item in enumerate(names)]
    (tmp_path / name).write_text(header + "\n" + rows(",", columns=columns), encoding="utf-8")
    return tmp_path / name


@pytest.mark.parametrize("case", cases(__file__, "found"))
def test_triples_are_found_by_their_names(tmp_path, case):
    path = written(tmp_path, case["header"])
    [recording] = lumbar.import_recordings(path, **case.get("told", {}))
    assert recording.record.axes == tuple(case.get("axes", "xyz"))
    for side, role in (("input", "position"), ("output", "force")):
        expected = [MOVED[number - 1] for number in case[role]]
        assert recording.record.stacked(side) == pytest.approx(np.stack(expected), abs=10**-DIGITS)


@pytest.mark.parametrize("case", cases(__file__, "asked"))
def test_unclear_triples_need_choice(tmp_path, case):
    path = written(tmp_path, case["header"])
    message = refusal(lumbar.import_recordings, path, **case.get("told", {}))
    assert has_tokens(message, case["tokens"])


@pytest.mark.parametrize("force_unit", [None, "V"])
def test_saved_axes_are_read_back(tmp_path, force_unit):
    path = written(tmp_path, "time,x_cm,z_cm,Fx_lbf,Fz_lbf")
    imported = lumbar.import_recordings(path, force_unit=force_unit, flip_force=True)
    study = imported.save(tmp_path / "records")
    records = lumbar.read(tmp_path / "records", layout=lumbar.load_settings(study).tissue.layout)
    assert records[0].stacked("output") == pytest.approx(imported.records[0].stacked("output"), abs=1e-6)
    plain = lumbar.read(tmp_path / "records") if force_unit is None else records
    assert plain[0].axes == ("x", "z")
    assert ("--config" in imported.next_command(study)) == (force_unit is not None)
    velocity = np.gradient(records[0].stacked("input"), records[0].sampling_time, axis=1)
    speed = np.sqrt((velocity**2).sum(axis=0)).max()
    assert imported.table["largest speed (mm/s)"][0] == pytest.approx(speed, rel=1e-6)


def test_variables_of_matlab_have_axes_too(tmp_path):
    moved = np.column_stack(MOVED[:4])
    options = {"position_unit": "mm", "force_unit": "N"}
    savemat(tmp_path / "matrix.mat", {"t": TIME, "pos": moved[:, :3], "force": moved[:, 1:]})
    by_axis = [{"x": moved[:, at], "y": moved[:, at + 1]} for at in (0, 2)]
    savemat(tmp_path / "fields.mat", {"trial": {"t": TIME, "pos": by_axis[0], "force": by_axis[1]}})
    [matrix] = lumbar.import_recordings(tmp_path / "matrix.mat", **options).records
    assert matrix.stacked("output") == pytest.approx(moved[:, 1:].T)
    [fields] = lumbar.import_recordings(tmp_path / "fields.mat", **options).records
    assert fields.stacked("output") == pytest.approx(moved[:, 2:].T)
