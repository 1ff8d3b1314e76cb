"""``import lumbar``: its functions on objects, and the same bytes as from the commands."""

import ast
import filecmp
import json
from pathlib import Path

import numpy as np
import pytest
from periodic_records import multisine, noise, record, relaxing_force
from pydantic import ValidationError

import lumbar
from column_files import write_records
from refusing import has_tokens
from running import python


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Write tests of a tissue with dry friction: a periodic record and two others."""
    records = []
    for name, periods, seed in (("multisine", 4, 1), ("noise", 3, 2), ("other", 2, 3)):
        z = 0.4 * multisine(periods, 500, range(1, 20), seed)
        speed = np.gradient(z, 0.01)
        force = relaxing_force(z) + 0.6 * np.tanh(speed / 0.3) + 0.02 * noise(len(z), seed)
        records.append(record(z, force, name))
    return write_records(tmp_path_factory.mktemp("records"), records, "%.9g")


@pytest.fixture(scope="module")
def records(folder):
    return lumbar.read(folder)


@pytest.fixture(scope="module")
def diagnosis(records):
    return lumbar.diagnose(records)


def test_import_loads_no_module_that_a_function_needs_later():
    script = "import sys, lumbar; print(*sorted(name for name in sys.modules if name.split('.')[0] in " + (
        "('numpy', 'scipy', 'pandas', 'matplotlib', 'pydantic', 'control') or name.startswith('lumbar.')))"
    )
    assert python("-c", script).strip() == ""


def test_stub_and_package_offer_the_same_names():
    stub = ast.parse(Path(lumbar.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    assert {item.asname: node.module for node in imports for item in node.names} == lumbar._EXPORTS
    assert {"read", "diagnose", "lift"} <= set(lumbar.__all__) <= set(dir(lumbar))
    assert all(callable(getattr(lumbar, name)) for name in lumbar.__all__)


def test_records_are_indexed_by_name_and_number(records):
    assert records.names == ["multisine", "noise", "other"]
    assert records["noise"] is records[1]
    assert len(records[:2]) == 2
    assert "<td>multisine</td>" in records._repr_html_()
    with pytest.raises(lumbar.InputError, match=r"'chirp'.*multisine, noise, other"):
        records["chirp"]
    with pytest.raises(lumbar.InputError, match=r"records .*'a'"):
        lumbar.RecordSet([record(np.arange(9.0), np.arange(9.0), "a")] * 2)


def test_records_are_read_from_a_folder_or_from_files(folder, records):
    some = lumbar.read([folder / "noise.csv", folder / "other.csv"], names=["a", "b"], periods={"a": 5.0})
    assert [item.period for item in some] == [5.0, None]
    assert np.array_equal(some["a"]["output"], records["noise"]["output"])
    with pytest.raises(lumbar.InputError, match="tisue"):
        lumbar.read(folder, "tisue")


def test_diagnosis_selects_prints_and_refines(diagnosis, records):
    assert diagnosis.selected == ("coulomb_friction",)
    assert has_tokens(str(diagnosis).splitlines()[0], "KB…coulomb friction")
    assert has_tokens(repr(diagnosis), "Diagnosis…KB…3…named")
    assert "coulomb friction" in diagnosis._repr_html_()
    assert diagnosis.model["coulomb_friction.coulomb_force"].value == pytest.approx(0.6, rel=0.05)
    refined = lumbar.refine(records, ["coulomb_friction"])
    assert refined.model.scores.test_rms == pytest.approx(diagnosis.model.scores.test_rms)
    assert diagnosis.add("coulomb_friction").effects == ("coulomb_friction",)
    assert refined.remove("coulomb_friction").effects == ()
    assert [row["model"] for row in refined.table] == ["KB", "KB+coulomb_friction"]


def test_fitted_and_identified_models_are_compared_with_records(diagnosis, records):
    result = lumbar.compare(records, diagnosis.model)
    assert result["noise"].comparison.vaf.value > 99.9
    identified = lumbar.identify(records, "multisine")
    linear = lumbar.compare(records, identified["KB"])
    assert linear["noise"].comparison.vaf.value < result["noise"].comparison.vaf.value
    assert identified["KB"].scores.vaf_percent == pytest.approx(
        linear["multisine"].comparison.vaf.value, abs=0.2
    )
    assert "noise" in str(lumbar.locate(records, identified["KB"]))
    with pytest.raises(lumbar.InputError, match=r"'KBB'.*LE, MW"):
        identified["KBB"]


@pytest.mark.parametrize("lost", ["evidence", "page"])
def test_result_is_written_before_evidence_and_page(diagnosis, tmp_path, monkeypatch, lost):
    def fails(*arguments, **keywords):
        raise RuntimeError(lost)

    monkeypatch.setattr(type(diagnosis), lost, property(fails) if lost == "evidence" else fails)
    with pytest.raises(RuntimeError, match=lost):
        diagnosis.save(tmp_path)
    written = json.loads((tmp_path / "diagnosis.json").read_text())
    assert diagnosis.result.to_json().items() <= written.items()
    assert (tmp_path / "ladder.csv").is_file()


@pytest.mark.nightly
def test_object_saves_the_files_of_the_command(diagnosis, folder, run, tmp_path):
    out = run.done("diagnose", folder, "--output", tmp_path / "command")
    diagnosis.save(tmp_path / "object", pictures=False)
    assert diagnosis.headline in out.splitlines()
    written, following = out.splitlines()[-2:]
    assert "diagnosis.html" in written and "lumbar export" in following
    names = sorted(path.name for path in (tmp_path / "command").iterdir())
    assert names == sorted(path.name for path in (tmp_path / "object").iterdir())
    for name in names:
        assert filecmp.cmp(tmp_path / "command" / name, tmp_path / "object" / name, shallow=False), name


@pytest.mark.parametrize(
    ("chapter", "values"),
    [("improvement", {"base": "KX"}), ("tissue", {"rate_Hz": -100}), ("tissue", {"rate": 100})],
)
def test_settings_made_in_python_are_checked(chapter, values):
    with pytest.raises(ValidationError) as refused:
        lumbar.StudySettings(**{chapter: values})
    assert {chapter, *values} <= {part for error in refused.value.errors() for part in error["loc"]}


def test_settings_of_a_chapter_are_not_those_of_a_study(records):
    with pytest.raises(lumbar.InputError, match=r"\bsettings\b.*ImprovementSettings.*lumbar\.load_settings"):
        lumbar.identify(records, settings=lumbar.ImprovementSettings())


def test_one_model_is_compared_at_a_time(records):
    for function in (lumbar.compare, lumbar.locate):
        with pytest.raises(lumbar.InputError, match=r"^model .*\blist\b"):
            function(records, [])


@pytest.mark.parametrize("function", ["diagnose", "identify", "propose"])
@pytest.mark.parametrize("given", ["recordings", ["a.csv"]])
def test_paths_in_place_of_records_are_rejected(function, given):
    with pytest.raises(lumbar.InputError, match=r"^records .*lumbar\.read"):
        getattr(lumbar, function)(given)


@pytest.mark.parametrize("function", ["identify", "diagnose", "propose", "bandwidth"])
def test_one_record_in_place_of_a_list_is_rejected(function, records):
    with pytest.raises(lumbar.InputError, match=r"^records .*'multisine'.*\[record\]"):
        getattr(lumbar, function)(records["multisine"])


def test_numbers_of_numpy_and_integers_are_accepted_as_settings():
    study = lumbar.StudySettings(signals={"round_Hz": np.float64(0.25), "ramp_s": np.int64(1)})
    settings = lumbar.design_signals(2.5, settings=study.signals).settings
    assert (settings.round_Hz, settings.ramp_s, type(settings.ramp_s)) == (0.25, 1.0, float)
