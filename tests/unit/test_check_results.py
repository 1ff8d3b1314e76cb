"""The comparison with the reference says what moved, by how much, and whether that is allowed."""

import runpy

import pandas as pd
import pytest
import yaml


@pytest.fixture(scope="module")
def check(project):
    return runpy.run_path(str(project / "tests" / "reference" / "check_results.py"))


@pytest.fixture
def folders(tmp_path):
    reference, results = tmp_path / "reference", tmp_path / "results"
    (results / "tables").mkdir(parents=True)
    reference.mkdir()
    frame = pd.DataFrame({"model": ["KB", "HO"], "vaf": [80.0, 82.0], "note": ["a", "b"]})
    frame.to_csv(reference / "t.csv", index=False)
    frame.to_csv(results / "tables" / "t.csv", index=False)
    settings = {"tables/t.csv": {"keys": ["model"], "absolute": {"default": 0.5}}}
    (reference / "tolerances.yaml").write_text(yaml.safe_dump(settings), encoding="utf-8")
    return reference, results


def call(check, folders, *more):
    return check["main"](["--reference", str(folders[0]), "--results", str(folders[1]), *more])


def move(folders, column, value):
    path = folders[1] / "tables" / "t.csv"
    frame = pd.read_csv(path)
    frame.loc[0, column] = value
    frame.to_csv(path, index=False)


@pytest.mark.parametrize(("column", "value"), [("vaf", None), ("note", "c")])
def test_missing_number_or_changed_text_fails(check, folders, capsys, column, value):
    move(folders, column, value)
    assert call(check, folders) == 1
    assert "NOT ALLOWED: tables/t.csv [KB]" in capsys.readouterr().out


def test_missing_table_and_row_fail(check, folders, capsys):
    path = folders[1] / "tables" / "t.csv"
    pd.read_csv(path).iloc[:1].to_csv(path, index=False)
    assert call(check, folders) == 1
    path.unlink()
    assert call(check, folders) == 1
    told = capsys.readouterr().out
    assert "[HO]" in told and "t.csv: missing; run the default study first" in told


def test_update_takes_the_present_numbers(check, folders):
    move(folders, "vaf", 99.0)
    assert call(check, folders) == 1
    assert call(check, folders, "--update") == 0
    assert call(check, folders) == 0
