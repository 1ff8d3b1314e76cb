"""``lumbar import``: what it shows, what it writes, and that the other commands and the workflow take it."""

import json
import os

import numpy as np
import pytest
from foreign_files import FORCE, POSITION, foreign_files, rows

import lumbar
from refusing import has_tokens

FILES = foreign_files()


@pytest.fixture
def sources(tmp_path):
    """Return a folder with recordings of a machine and words about them."""
    folder = tmp_path / "machine"
    folder.mkdir()
    for name in ("labview.lvm", "excel_deutsch.csv"):
        (folder / name).write_bytes(FILES[name][0])
    (folder / "LICENSE.txt").write_text("Do what you like, 1 2 3\n")
    return folder


def test_dry_run_writes_nothing(run, sources):
    before = sorted(sources.iterdir())
    status, out, err = run("import", sources / "labview.lvm", "--dry-run")
    assert (status, err) == (0, "")
    assert sorted(sources.iterdir()) == before
    lines = [line.strip() for line in out.splitlines()]
    assert lines[5].split() == ["time_s", "position_mm", "force_N"]
    assert [float(cell) for cell in lines[6].split()] == pytest.approx([0, POSITION[0], FORCE[0]], abs=1e-4)


def test_records_and_a_study_are_written(run, sources, tmp_path, project):
    output = tmp_path / "records"
    files = (sources / "labview.lvm", sources / "excel_deutsch.csv")
    run.done("import", *files, "--output", output, "--licence", "CC0")
    names = {path.name for path in output.iterdir()}
    assert names == {"excel_deutsch.csv", "imported.json", "labview.csv", "study.yaml"}
    records = lumbar.read(output)
    assert records.names == ["excel_deutsch", "labview"]
    np.testing.assert_allclose(records["labview"]["output"], FORCE, atol=2e-5)
    study = lumbar.load_settings(output / "study.yaml")
    assert (study.data_source.licence, str(study.data_root)) == ("CC0", str(output))
    assert [record.file for record in study.tissue.records] == ["labview.csv", "excel_deutsch.csv"]
    out = run.done("check", output)
    assert has_tokens(out, "labview.csv … 600 samples … 200 Hz … 3 s … position … mm … force … N")


def test_imports_are_added_to_folder(run, sources, tmp_path):
    output = tmp_path / "records"
    assert run("import", sources / "labview.lvm", "--output", output)[0] == 0
    options = ("--force-unit", "lbf", "--output", output)
    assert run("import", sources / "excel_deutsch.csv", *options)[0] == 0
    assert run("import", sources / "labview.lvm", "--flip-force", "--output", output)[0] == 0
    records = lumbar.read(output)
    np.testing.assert_allclose(records["excel_deutsch"]["output"], FORCE * 4.4482216152605, atol=1e-4)
    np.testing.assert_allclose(records["labview"]["output"], -FORCE, atol=2e-5)
    content = json.loads((output / "imported.json").read_text())
    assert [entry["name"] for entry in content["records"]] == ["excel_deutsch", "labview"]


def test_one_file_may_hold_several_recordings(run, tmp_path):
    file = tmp_path / "both.csv"
    time = 0.01 * np.arange(400)
    columns = [time, np.sin(time), 2 * np.sin(time), np.cos(time), 3 * np.cos(time)]
    np.savetxt(file, np.transpose(columns), delimiter=",", header="time_s,z1,F1,z2,F2", comments="")
    for name, position, force in (("fit", "z1", "F1"), ("unseen", "z2", "F2")):
        options = ("--position", position, "--position-unit", "mm", "--force", force, "--force-unit", "N")
        assert run("import", file, *options, "--name", name, "--output", tmp_path / "records")[0] == 0
    records = lumbar.read(tmp_path / "records")
    assert records.names == ["fit", "unseen"]
    np.testing.assert_allclose(records["unseen"]["output"], 3 * np.cos(time), atol=1e-6)
    err = run.refused("import", file, file, *options, "--name", "a", "--dry-run")
    assert has_tokens(err, "--name … 2")


def test_forward_import_makes_force_the_input(run, sources, tmp_path, project):
    output = tmp_path / "records"
    out = run.done("import", sources / "labview.lvm", "--forward", "--output", output)
    assert out.splitlines()[-1].endswith(f"lumbar diagnose {output} --forward --output out")
    assert lumbar.load_settings(output / "study.yaml").improvement.forward
    err = run.refused("import", sources / "excel_deutsch.csv", "--output", output)
    assert has_tokens(err, f"{output.name} … --forward")


def test_user_files_are_not_overwritten(run, sources, tmp_path):
    err = run.refused("import", sources / "labview.lvm", "--output", sources)
    assert has_tokens(err, f"{sources} … excel_deutsch.csv … imported")
    output = tmp_path / "records"
    assert run("import", sources / "labview.lvm", "--output", output)[0] == 0
    study = output / "study.yaml"
    study.write_text(study.read_text() + "# mine\n")
    err = run.refused("import", sources / "labview.lvm", "--output", output)
    assert has_tokens(err, "study.yaml … changed")
    assert study.read_text().endswith("# mine\n")


def test_records_of_other_units_do_not_join(run, tmp_path):
    for name, unit in (("a", "mm"), ("b", "deg")):
        (tmp_path / f"{name}.txt").write_text(f"time_s,position_{unit},force_N\n" + rows(","))
    output = tmp_path / "records"
    assert run("import", tmp_path / "a.txt", "--output", output)[0] == 0
    err = run.refused("import", tmp_path / "b.txt", "--output", output)
    assert has_tokens(err, "a … time_s, position_mm, force_N … b … time_s, angle_rad, force_N")


def test_study_states_units_clipping_and_rate_of_records(run, tmp_path, project):
    """Clipped torque in volts at two rates over an angle."""
    for name, rate in (("a", 200), ("b", 100)):
        clipped = np.clip(FORCE, -4, 4)
        table = rows(",", columns=(POSITION, clipped))
        (tmp_path / f"{name}.txt").write_text("angle [deg],torque [V]\n" + table)
        options = (
            "--force-unit",
            "V",
            "--rate",
            rate,
            "--accept-clipped",
            "--output",
            tmp_path / "no: records",
        )
        out = run.done("import", tmp_path / f"{name}.txt", *map(str, options))
    assert "--config" in out.splitlines()[-1]
    path = tmp_path / "no: records" / "study.yaml"
    study = lumbar.load_settings(path)
    assert study.tissue.rate_Hz == 100
    records = lumbar.read(path.parent, layout=study.tissue.layout, rate=study.tissue.rate_Hz)
    assert records["a"].channels["output"].label == "Force (V)"
    assert records["a"].channels["input"].label == "Angle (rad)"
    np.testing.assert_allclose(records["b"]["input"], np.deg2rad(POSITION), atol=1e-6)


def test_folder_is_imported_without_its_texts(run, tmp_path):
    assert has_tokens(run.refused("import", tmp_path, "--dry-run"), f"{tmp_path} … recordings")
    for name in ("b.csv", "a.txt", "c.dat"):
        (tmp_path / name).write_bytes(FILES["tidy.csv"][0])
    for name in ("README.txt", "notes.md"):
        (tmp_path / name).write_text("words\n")
    run.done("import", tmp_path, "--output", tmp_path / "records")
    for name in ("LICENSE.txt", "README.TXT", "readme_de.txt", "Licence-data.txt"):
        (tmp_path / "records" / name).write_text("words\n")
    assert lumbar.read(tmp_path / "records").names == ["a", "b", "c"]


def test_wrong_options_have_usage_status(run, sources):
    assert run("import", sources / "labview.lvm")[0] == 2
    status, _, err = run("import", sources / "labview.lvm", "--dry-run", "--trim", "5")
    assert status == 2
    assert has_tokens(err, "--trim … START:STOP")


def test_files_of_one_name_are_rejected(run, sources, tmp_path):
    (tmp_path / "labview.csv").write_bytes(FILES["tidy.csv"][0])
    err = run.refused("import", sources / "labview.lvm", tmp_path / "labview.csv", "--dry-run")
    assert has_tokens(err, "labview.lvm … labview.csv … 'labview'")


def test_imports_agree_with_studies_by_hand(shared, project):
    """The layouts of two studies, written by hand, are an independent reading of the same files."""
    for study, options in (
        ("friction_damper", {}),
        (
            "davinci_tool",
            {
                "position": 2,
                "force": 3,
                "time_unit": "s",
                "position_unit": "7.669903939428206e-4 rad",
                "force_unit": "-3.9811e-5 N·m/count",
            },
        ),
    ):
        settings = lumbar.load_settings(project / f"config/studies/{study}.yaml").tissue
        path = shared / "real" / settings.records[0].file
        [by_hand] = lumbar.read(path, layout=settings.layout)
        [imported] = lumbar.import_recordings(path, **options)
        factors = {"friction_damper": (1.0, 1e3), "davinci_tool": (1.0, 1.0)}[study]
        np.testing.assert_allclose(imported.record.time, by_hand.time, rtol=1e-12)
        for role, factor in zip(("input", "output"), factors, strict=True):
            np.testing.assert_allclose(imported.record[role], by_hand[role] * factor, rtol=1e-7)


def test_control_characters_do_not_reach_terminal(run, tmp_path):
    table = "".join(f"{n / 100},{n % 7}.5,{n % 5}.25\n" for n in range(60))
    named, called = tmp_path / "named.csv", tmp_path / os.fsdecode(b"no\x1b[2Jtext\xff.csv")
    named.write_text(f"time_s,\x1b[2Jposition_mm,\u202eforce_N\n{table}")
    called.write_text(f"time_s,position_mm,force_N\n{table}")
    for path in (named, called):
        words = "".join(map(str, run("import", path, "--output", tmp_path / path.stem[:2])))
        assert {sign for sign in words if not sign.isprintable()} == {"\n"}
    assert "no?[2Jtext?.csv (SHA-256" in (tmp_path / "no" / "study.yaml").read_text(encoding="utf-8")
