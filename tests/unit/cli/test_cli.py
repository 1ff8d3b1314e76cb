"""The commands on files and folders, what they write, print and refuse."""

import json
import shlex
import shutil
import zipfile
from html import unescape
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from runtime_models import models_json
from scipy.signal import butter, lfilter

import lumbar
from column_files import write_columns
from lumbar.cli.command import build_parser, command_names
from lumbar.cli.ending import after_diagnosis
from lumbar.tissue.effects.catalogue import MOTION_SENSOR, PENDULUM, TISSUE
from refusing import has_tokens
from running import python


@pytest.fixture(scope="module")
def tissue(tmp_path_factory):
    """Make tests of a known Kelvin-Boltzmann tissue, simulated exactly at 100 Hz."""
    folder = tmp_path_factory.mktemp("tests")
    random = np.random.default_rng(3)
    for name, seconds in (("long", 20), ("short", 10)):
        time = np.arange(seconds * 100) / 100
        position = np.cumsum(random.normal(size=len(time)))
        position = lfilter(*butter(2, 0.2), position - position.mean())
        force = lfilter([1.9, -1.2], [1, -0.45], position) + random.normal(scale=0.01, size=len(time))
        write_columns(folder / f"{name}.csv", "%.8f", time_s=time, position_mm=position, force_N=force)
    return folder


def test_help_names_every_command_and_its_example(run):
    out = run.done("--help")
    names = command_names()
    assert all(name in out for name in names)
    for name in names:
        out = run.done(name, "--help")
        assert f"lumbar {name}" in out.split("example:")[1]
    out = run.done("--version")
    assert out.startswith("lumbar 0")


def test_a_wrong_command_line_ends_with_2(run):
    for command, message in (
        ("nonsense", "nonsense"),
        ("diagnos", "'diagnose'"),
    ):
        status, _, err = run(command, "folder")
        assert status == 2 and message in err


def test_starting_up_loads_no_heavy_package():
    script = (
        "import sys; from lumbar.cli.command import build_parser; build_parser();"
        "print([n for n in ('numpy', 'pandas', 'scipy', 'matplotlib', 'fmpy') if n in sys.modules])"
    )
    assert python("-c", script).strip() == "[]"


def test_check_reads_surveys_and_other_layouts(run, project, tissue, tmp_path):
    sheet = project / "resources" / "survey" / "survey_reconstructed.csv"
    checked = run.done("check", "--chapter", "survey", sheet)
    assert has_tokens(checked, "survey_reconstructed.csv: …45…IL, MW, KB, HO") and checked.count("\n") == 1
    columns = {"input": {"column": "force_N", "unit": "kN", "scale": 0.001}}
    (tmp_path / "study.yaml").write_text(yaml.safe_dump({"tissue": {"layout": {"columns": columns}}}))
    out = run.done("check", tissue / "long.csv", "--config", tmp_path / "study.yaml")
    assert has_tokens(out, "input: …kN")


@pytest.mark.parametrize("command", ["identify", "bandwidth"])
def test_folder_without_recordings_is_rejected(run, tmp_path, command):
    assert f"{tmp_path}: " in run.refused(command, tmp_path, "--output", tmp_path / "out")
    assert f"{tmp_path / 'absent'}: " in run.refused(
        command, tmp_path / "absent", "--output", tmp_path / "out"
    )


def test_bandwidth_finds_the_edge_of_a_known_spectrum(run, tmp_path):
    # White noise cut off at 2 Hz: 95 % of the power lies below 1.9 Hz.
    for trial in range(4):
        random, spectrum = np.random.default_rng(trial), np.zeros(4097, dtype=complex)
        spectrum[1:164] = random.normal(size=163) + 1j * random.normal(size=163)  # of lines of 100/8192 Hz
        path = tmp_path / f"surgeon_{trial}_trial_1.csv"
        write_columns(path, "%.6f", time_s=np.arange(8192) / 100, z_mm=100 * np.fft.irfft(spectrum))
    run.done("bandwidth", tmp_path, "--output", tmp_path / "out")
    bandwidth = json.loads((tmp_path / "out" / "bandwidth.json").read_text())
    assert bandwidth["position"]["power_share"]["value_Hz"] == pytest.approx(1.9, abs=0.1)
    assert bandwidth["data"] == tmp_path.name
    run.done("signals", "--bandwidth", tmp_path / "out" / "bandwidth.json", "--output", tmp_path / "s")
    assert {"multisine.csv", "noise.csv", "chirp.csv"} <= {path.name for path in (tmp_path / "s").iterdir()}


def test_identify_recovers_a_known_tissue(run, tissue, tmp_path):
    assert has_tokens(run.done("identify", tissue, "--output", tmp_path), "identified…long")
    models = json.loads((tmp_path / "models.json").read_text())["models"]
    kb = next(model for model in models if model["name"] == "KB" and model["estimator"] == "output_error")
    assert kb["structure"]["numerator"] == pytest.approx([1.9, -1.2], abs=0.02)
    assert kb["structure"]["denominator"] == pytest.approx([1, -0.45], abs=0.01)
    err = run.refused("identify", tissue, "--train", "middle", "--output", tmp_path)
    assert has_tokens(err, "'middle'…long, short")


def test_refined_model_is_exported_as_fmu(run, tissue, tmp_path):
    """From a folder of records to an FMU with an effect, by either of two ways."""
    run.done("refine", tissue, "--add", "inertia", "--output", tmp_path / "refined")
    refined = lumbar.load_models(tmp_path / "refined" / "refined.json")
    assert [model.name for model in refined] == ["KB", "KB+inertia"]
    command = ("export", tmp_path / "refined" / "refined.json", "--target", "host")
    run.done(*command, "--output", tmp_path / "fmu")
    names = [f"KB+inertia_fmi{version}.fmu" for version in (2, 3)]
    assert sorted(path.name for path in (tmp_path / "fmu").iterdir()) == names
    err = run.refused(*command, "--output", tmp_path, "--prony")
    assert has_tokens(err, "--prony … --target")
    run.done(*command[:2], "--model", "KB", "--output", tmp_path / "prony", "--prony")
    names = ["KB_abaqus.inp", "KB_febio.xml"]
    assert sorted(path.name for path in (tmp_path / "prony").iterdir()) == names
    settings = tmp_path / "effects.yaml"
    settings.write_text("improvement: {effects: [inertia]}")
    run.done("identify", tissue, "--config", settings, "--output", tmp_path / "identified")
    models = json.loads((tmp_path / "identified" / "models.json").read_text())["models"]
    assert [model["name"] for model in models if "effects" in model["structure"]] == ["KB+inertia"]


def test_export_builds_for_a_platform_and_a_rate(run, tmp_path):
    path = tmp_path / "models.json"
    path.write_text(json.dumps(models_json()))
    command = ("export", path, "--output", tmp_path / "fmu", "--model", "KB", "--rate", "500")
    assert "KB_fmi3.fmu" in run.done(*command, "--target", "host")
    with zipfile.ZipFile(tmp_path / "fmu" / "KB_fmi3.fmu") as archive:
        assert b'fixedInternalStepSize="0.002"' in archive.read("modelDescription.xml")
    assert "x86_64-amiga" in run.refused(*command, "--target", "x86_64-amiga")
    err = run.refused("export", path, "--output", tmp_path, "--model", "MW", "--rate", "50")
    assert has_tokens(err, "MW…runtime.rate_Hz 50…100 Hz")


def test_survey_writes_tables_and_figures(run, project, tmp_path):
    sheet = project / "resources" / "survey" / "survey_reconstructed.csv"
    assert "kruskal_wallis: 29.29" in run.done("survey", sheet, "--output", tmp_path)
    names = {
        "table_3_2.csv",
        "survey_paired.html",
        "survey_best_picks.tex",
        "survey_likert.svg",
        "survey.json",
    }
    assert names <= {path.name for path in tmp_path.iterdir()}
    assert "reconstructed survey" in (tmp_path / "table_3_2.csv").read_text()


def test_basin_reads_the_files_of_lift(run, project, twin_lift, tmp_path):
    markers = twin_lift("expert_23kg")
    subject = project / "config" / "subjects" / "expert.yaml"
    output = tmp_path / "out"
    page = tmp_path / "lift.html"
    chosen = ("--subject", subject, "--box-mass", 23, "--output", output, "--page", page)
    out = run.done("lift", markers, *chosen)
    assert "release: " in out and f"{page} " in out
    assert page.read_text(encoding="utf-8") == lumbar.lift_page(output).to_html()
    assert "smallest_impulse: " in out
    assert len((output / "movement_measures.csv").read_text().splitlines()) > 15
    facts = json.loads((output / "pendulum.json").read_text())
    assert facts["box_mass_kg"] == 23
    study = tmp_path / "fewer.yaml"
    study.write_text("stability: {checks: [simulation], knots: 253, attack: {starts: 20}}\n")
    run.done("basin", output / "pendulum.csv", "--output", output, "--config", study)
    assert (output / "boa.csv").read_text().count("\n") > 6
    study.write_text("stability: {checks: [simulation], knots: 253, goal_level: 1.0e+6}\n")
    message = run.refused("basin", output / "pendulum.csv", "--output", output, "--config", study)
    assert "12 of 12 basins not computed: " in message and len(message.splitlines()) == 1
    faults = ((tmp_path / "x.yaml", 23, f"{tmp_path / 'x.yaml'}: "), (subject, -1, "box_mass_kg is -1 kg"))
    for person, mass, message in faults:
        options = ("--subject", person, "--box-mass", mass, "--output", output)
        assert message in run.refused("lift", markers, *options)


def test_retired_options_and_keys_are_rejected_by_name(run, tmp_path):
    plates = tmp_path / "plates.mot"
    plates.write_text("nRows=4000\nendheader\n")
    options = ("--subject", "ann.yaml", "--output", tmp_path / "out", "--forces", plates)
    status, _, message = run("lift", "ann.c3d", *options)
    assert status == 2 and "--forces" in message
    assert "'.mot'" in run.refused("inspect", plates)
    study = tmp_path / "study.yaml"
    study.write_text(
        "lifting: {force_plates: {}}\nstability: {checks: [extended], limits: {mass_share: 0}}\n"
    )
    message = run.refused("basin", "pendulum.csv", "--config", study, "--output", tmp_path / "out")
    for name in ("lifting.force_plates", '"extended"', "stability.limits.mass_share"):
        assert name in message


@pytest.mark.parametrize("command", [("diagnose",), ("propose",), ("refine", "--add", "drift")])
def test_output_is_checked_before_the_fit(run, tissue, tmp_path, monkeypatch, command):
    """A file in the way, a full disk: told before the records are even read, and nothing is made."""
    (tmp_path / "taken").write_text("")
    broken = tmp_path / "broken.csv"
    broken.write_text("x")
    name, *options = command
    ending = "/law.yaml" if name == "propose" else ""
    status, out, err = run(name, broken, *options, "--output", f"{tmp_path}/taken{ending}")
    assert (status, out) == (1, "") and f"{tmp_path / 'taken'}: Not a directory" in err
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr("shutil.disk_usage", lambda _: usage._replace(free=3_000_000))
    status, out, err = run(name, broken, *options, "--output", tmp_path / "new" / "law.yaml")
    assert (status, out) == (1, "")
    assert has_tokens(err, f"No space left on device…3.0 MB…{tmp_path}")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["broken.csv", "taken"]


def test_compare_and_locate_a_folder(run, tissue, tmp_path):
    run.done("compare", tissue, "--output", tmp_path)
    made = {path.name for path in tmp_path.iterdir()}
    assert {f"compare.{ending}" for ending in ("csv", "tex", "html")} <= made
    assert {f"comparison_{name}.{ending}" for name in ("long", "short") for ending in ("svg", "pdf")} <= made
    out = run.done("locate", tissue, "--verbose", "--output", tmp_path).partition("\n\n")[0]
    made = {path.name for path in tmp_path.iterdir()}
    assert {f"location.{ending}" for ending in ("csv", "tex", "html")} <= made
    assert {f"location_{name}.{ending}" for name in ("long", "short") for ending in ("svg", "pdf")} <= made
    page = (tmp_path / "location_page.html").read_text(encoding="utf-8")
    assert page.count('<img src="data:image/svg+xml;base64,') == 2
    assert all(line.strip() in unescape(page).replace("−", "-") for line in out.splitlines())


@pytest.fixture
def sliding(examples, tmp_path, monkeypatch):
    """Work in a folder with records of a tissue with dry friction."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "records").mkdir()
    for record in examples:
        columns = {"time_s": record.time, "position_mm": record["input"], "force_N": record["output"]}
        write_columns(tmp_path / "records" / f"{record.name}.csv", "%.8g", **columns)


def following(out: str) -> list[str]:
    """Return the next command of a command that printed this, after a check of its lines."""
    lines = out.splitlines()
    assert len(lines) <= 12
    written = next(line for line in lines if line.startswith("Written: ")).removeprefix("Written: ")
    assert all(Path(name).is_file() for name in written.split(", "))
    program, *words = shlex.split(lines[-1].removeprefix("Next: "))
    assert program == "lumbar"
    return words


def test_each_command_prints_the_next_one(run, sliding):
    words = ["compare", "records", "--output", "out"]
    for name in ("locate", "refine", "export"):
        words = following(run.done(*words))
        assert words[0] == name
    assert run.done(*words, "--target", "host").count(".fmu") == 2
    out = run.done("diagnose", "records", "--output", "out")
    assert has_tokens(out, "KB … 22 times the noise") and has_tokens(
        out, "+ coulomb_friction … 0.98 times the noise"
    )
    assert following(out) == words
    run.done(*following(run.done("refine", "records", "--add", "drift", "--output", "out")))


def diagnosis_of(status, **changes):
    """Return a diagnosis of two records with this status, as far as the next step depends on it."""
    structure = SimpleNamespace(base=SimpleNamespace(name="KB"), effects=("drift",))
    model = SimpleNamespace(fit=SimpleNamespace(structure=structure), effects=("drift",))
    result = {
        "status": status,
        "orientation": None,
        "path": [model],
        "selected": ("drift",),
        "further": None,
        "proposal": None,
        "is_incomplete": False,
        "experiment": SimpleNamespace(points=False),
    }
    return SimpleNamespace(
        result=SimpleNamespace(**result | changes),
        settings=SimpleNamespace(base="auto", forward=False, system="tissue"),
        records=[SimpleNamespace(axes=())],
        candidates={"drift": SimpleNamespace(experiment="wait")},
    )


@pytest.mark.parametrize(
    ("diagnosis", "step"),
    [
        (diagnosis_of("tied"), "wait; put the record into a folder, then lumbar diagnose 'a folder'"),
        (diagnosis_of("unexplained"), "lumbar propose 'a folder'"),
        (diagnosis_of("unexplained", proposal="law"), "lumbar locate 'a folder' --base KB --add drift"),
        (diagnosis_of("named", orientation="sign"), "correct the records, then lumbar diagnose 'a folder'"),
        (diagnosis_of("named", is_incomplete=True), "lumbar locate 'a folder' --base KB --add drift"),
        (
            diagnosis_of("named", is_incomplete=True, further=SimpleNamespace(effects=("drift", "delay"))),
            "lumbar refine 'a folder' --base KB --add drift --add delay",
        ),
    ],
)
def test_next_step_depends_on_the_verdict(diagnosis, step):
    arguments = ["diagnose", "a folder", "--train", "one", "--config", "s.yaml", "--output", "out"]
    printed = after_diagnosis(diagnosis, build_parser().parse_args(arguments))
    end = "law.yaml" if "propose" in step else "out"
    assert printed == f"{step} --config s.yaml --train one --output {end}"


def test_effects_are_listed_with_a_sentence_each(run, tmp_path):
    listed = run.done("effects")
    assert all(has_tokens(listed, name) for name in (*TISSUE, *PENDULUM, *MOTION_SENSOR))
    assert has_tokens(listed, "hand_load … box in the hands")
    assert run.done("refine", tmp_path / "absent", "--add", "?", "--output", tmp_path) == listed


def test_wrong_periods_end_a_diagnosis_before_it_writes(run, tissue, tmp_path):
    for period, message in (("long", "NAME=SECONDS"), ("other=3", "'other'")):
        assert message in run.refused("diagnose", tissue, "--period", period, "--output", tmp_path / "out")
        assert not (tmp_path / "out").exists()
