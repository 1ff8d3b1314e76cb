"""Files of a study against its settings: every fault by file, line and key, and what YAML itself lets pass."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from case_tables import cases
from generate.configuration_reference import keys
from lumbar.base.errors import InputError, Problems
from lumbar.base.yaml_file import read_yaml
from lumbar.cli.command import main
from lumbar.settings.study_settings import StudySettings, record_layout
from lumbar.settings.validation import Key, overlay
from lumbar.study.load_study import DEFAULT_FILES, load_settings, load_study, load_study_file, load_subject
from lumbar.study.study import read_artefacts, reading_plan, record_set, recordings_of
from refusing import has_tokens, refusal
from running import PROJECT
from study_settings import study_config, study_settings


@pytest.fixture
def folder(project, tmp_path):
    """Make a project of its own: subjects, artefacts."""
    shutil.copytree(project / "config", tmp_path / "config")
    return tmp_path


@pytest.fixture
def config() -> dict:
    """Files of the default study, with the sections that the tests change."""
    return overlay({name: {} for name in ("survey", "runtime", "stability")}, study_config())


SOURCE = {"name": "Survey of laboratory X", "licence": "CC BY 4.0", "obtain": "https://example.org/data"}


def recorded(config, root, **changes) -> dict:
    """Return the survey alone, with recordings in `root`."""
    study = {"data": "recordings", "data_root": str(root), "data_source": SOURCE, "chapters": ["survey"]}
    return {**config, **study, **changes}


def test_default_study_loads(config, folder):
    study = load_study(config, folder)
    assert study.synthetic
    assert study.data_label == "synthetic twin"
    assert study.name == "thesis"
    assert {"expert_23kg", "novice_15kg"} <= set(study.lifts)
    assert study.recording("survey.csv") == "results/thesis/twin/survey.csv"


def test_reading_plan_covers_every_recording(config, folder):
    study = load_study(config, folder)
    for chapter, files in recordings_of(study).items():
        plan = reading_plan(study, [chapter])
        assert sorted(item["path"] for item in plan) == sorted(study.recording(name) for name in files)
    before = reading_plan(study, recordings_of(study))
    subject = folder / "config" / "subjects" / "expert.yaml"
    content = yaml.safe_load(subject.read_text(encoding="utf-8"))
    content["subject"]["mass_kg"] += 1
    subject.write_text(yaml.safe_dump(content), encoding="utf-8")
    config["survey"]["confidence"] = 0.9
    changed = load_study(config, folder)
    assert changed.subjects["expert"].mass_kg == study.subjects["expert"].mass_kg + 1
    assert reading_plan(changed, recordings_of(changed)) == before


def test_record_set_determines_base_and_layout(config, folder):
    config["tissue"]["rate_Hz"] = 50
    study = load_study(config, folder)
    settings = study.settings
    assert record_set(settings, "hip_moment").base == "pendulum"
    assert record_set(settings, "tissue").base == "auto"
    assert record_set(settings, "tissue").records == settings.tissue.records
    assert record_layout(settings, "pendulum") == (settings.lifting.moment_layout, None)
    assert record_layout(settings, "KV") == (settings.tissue.layout, 50)
    with pytest.raises(InputError, match=r"base.*'HO'"):
        record_layout(settings, "HO")
    plan = {item["path"]: item for item in reading_plan(study, ["improvement"])}
    moment = plan["results/thesis/twin/hip_moment/paced.csv"]
    assert moment["layout"]["columns"]["input"]["column"] == "angle_rad"
    assert "rate_Hz" not in moment
    force = plan["results/thesis/twin/two_hidden_effects/chirp.csv"]
    assert force["layout"] == settings.tissue.layout.model_dump(mode="json")
    config["improvement"]["record_sets"][0]["base"] = "pendulum"
    assert has_tokens(refusal(load_study, config, folder), "tissue … base … pendulum … records")
    config["improvement"]["record_sets"][2]["base"] = "HO"
    allowed = "auto, LE, Maxwell, KV, KB, KV-mass, KB-mass, Burgers, QLV, QLV-2, QLV-power"
    message = refusal(load_study, config, folder)
    assert has_tokens(message, f'improvement.record_sets.2.base … "HO" … {allowed}')


def test_all_wrong_keys_are_named_at_once(config, folder):
    config["seed"] = -1
    config["survey"] |= {"resmaples": 10, "confidence": 95, "layout": {"scale_points": "five"}}
    config["colour"] = "blue"
    config["data_source"] = {"name": "x", "licence": "none"}
    config["tissue"]["records"][0]["period_s"] = "1e1"
    config["tissue"]["training"] = ["chirp", "chirp"]
    config["tissue"]["layout"] = {"format": "excel"}
    config["lifting"]["subjects"] = ["nobody"]
    message = refusal(load_study, config, folder)
    for tokens in cases(__file__, "all_at_once"):
        assert has_tokens(message, tokens), tokens
    assert has_tokens(message, "configuration: 10")


ALIAS = "{mean} … {between, share} … {from, offset_m}"
WRONG_ALIASES = [
    ({"lifting": {"markers": {"aliases": {"C7": alias}}}}, [f"lifting.markers.aliases.C7 … {ALIAS}"])
    for alias in (7, {"median": ["A", "B"]}, {"mean": ["A"]}, {"from": "A", "offset_m": [0, 0, 3]})
]


@pytest.mark.parametrize(("changes", "problems"), [*cases(__file__, "refused_together"), *WRONG_ALIASES])
def test_contradictions_between_keys_are_reported(config, folder, changes, problems):
    message = refusal(load_study, overlay(config, changes), folder)
    assert [tokens for tokens in problems if not has_tokens(message, tokens)] == []


def test_records_of_several_axes_omit_artefacts_of_one_axis(config, folder):
    columns = {"time": {"column": "time_s", "unit": "s"}}
    for axis in "xy":
        columns |= {f"input_{axis}": {"column": f"position_{axis}_mm", "unit": "mm"}}
        columns |= {f"output_{axis}": {"column": f"force_{axis}_N", "unit": "N"}}
    one = {row.id for row in load_study(config, folder).artefacts}
    several = {**config, "tissue": {**config["tissue"], "layout": {"columns": columns}}}
    with pytest.raises(InputError, match=r"chapters.*runtime.*axes"):
        load_study(several, folder)
    several["chapters"] = [name for name in config["chapters"] if name != "runtime"]
    made = {row.id for row in load_study(several, folder).artefacts}
    assert {"table_2_1", "diagnoses", "survey_paired"} <= made
    assert made - one == {"principal_axes"}
    assert {"table_3_1", "models"} <= one - made


def test_record_sets_of_a_pendulum_need_gravity(config, folder):
    config["stability"] = {"pendulum": {"gravity_m_s2": 1.62}}
    load_study(config, folder)
    config["stability"] = {"pendulum": {"gravity_m_s2": 0}}
    tokens = "stability.pendulum.gravity_m_s2 … 0 … base pendulum"
    assert has_tokens(refusal(load_study, config, folder), tokens)
    config["improvement"]["record_sets"] = [{"name": "tissue"}]
    load_study(config, folder)


def test_effect_files_of_study_define_effects(config, folder, project):
    shutil.copy(project / "examples" / "own_effect" / "hertzian_contact.py", folder / "own.py")
    config["improvement"] |= {"effects": ["hertzian_contact"], "effect_files": ["own.py"]}
    assert load_study(config, folder).settings.improvement.effects == ("hertzian_contact",)
    config["improvement"]["effect_files"] = ["absent.py"]
    assert "improvement.effect_files: " in refusal(load_study, config, folder)


RUN = "from pathlib import Path\n\nPath('ran').touch()\n"
NAMED = "improvement:\n  effect_files: [own.py]\n"


@pytest.fixture
def stranger(tmp_path, monkeypatch, project):
    """Folder with a study of somebody else, whose effect leaves a file; the working directory is a project."""
    own = tmp_path / "own"
    shutil.copytree(project / "config", own / "config")
    monkeypatch.chdir(own)
    strange = tmp_path / "downloads"
    strange.mkdir()
    (strange / "own.py").write_text(RUN, encoding="utf-8")
    (strange / "study.yaml").write_text(NAMED, encoding="utf-8")
    return strange


def test_python_effects_of_untrusted_studies_are_not_run(stranger):
    refused = r"study\.yaml, line 2: improvement\.effect_files\.0: .*own\.py.*--trust"
    for load in (load_settings, lambda file: load_study_file(Path(), file)):
        with pytest.raises(InputError, match=refused):
            load(stranger / "study.yaml")
    Path("link.py").symlink_to(stranger / "own.py")
    Path("study.yaml").write_text(NAMED.replace("own.py", "link.py"), encoding="utf-8")
    with pytest.raises(InputError, match=r"study\.yaml, line 2.*link\.py.*--trust"):
        load_settings("study.yaml")
    assert not Path("ran").exists()
    assert main(["diagnose", str(stranger), "--output", "out", "--config", str(stranger / "study.yaml")]) != 0
    assert not Path("ran").exists()
    with pytest.raises(InputError, match=r"own\.py.* Effect"):
        load_settings(stranger / "study.yaml", trust=True)
    assert Path("ran").exists()


def test_python_effects_run_only_in_their_own_project(stranger, project, monkeypatch):
    effect = (project / "examples" / "own_effect" / "hertzian_contact.py").read_text(encoding="utf-8")
    Path("own.py").write_text(effect, encoding="utf-8")
    Path("study.yaml").write_text(NAMED, encoding="utf-8")
    assert load_settings("study.yaml").improvement.effect_files == ("own.py",)
    monkeypatch.chdir(stranger)  # no project, even where one is
    with pytest.raises(InputError, match=r"study\.yaml, line 2.*own\.py.*--trust"):
        load_settings("study.yaml")
    assert not Path("ran").exists()


def test_missing_recordings_name_source_and_licence(config, folder, monkeypatch):
    monkeypatch.delenv("LUMBAR_DATA", raising=False)
    (data := folder / "data").mkdir()
    for root, problem in ((folder / "nowhere", "LUMBAR_DATA"), ("data", f"{data} … survey.csv")):
        message = refusal(load_study, recorded(config, root), folder)
        assert all(has_tokens(message, tokens) for tokens in (*SOURCE.values(), problem))
    for key in ("data_root", "data_source"):
        assert f"{key}: " in refusal(load_study, recorded(config, "x", **{key: None}), folder)


def test_recordings_are_in_a_folder_or_an_object_store(config, folder, monkeypatch):
    study = load_study(recorded(config, "s3://lab/recordings/"), folder)
    assert study.recording("survey.csv") == "s3://lab/recordings/survey.csv"
    assert (study.remote, study.synthetic) == (True, False)
    (folder / "data").mkdir()
    (folder / "data" / "survey.csv").write_text("x")
    monkeypatch.setenv("LUMBAR_DATA", str(folder / "data"))
    study = load_study(recorded(config, "nowhere"), folder)
    assert study.recording("survey.csv") == str(folder / "data" / "survey.csv")
    assert (study.data_label, study.synthetic) == ("Survey of laboratory X", False)


@pytest.mark.parametrize(
    ("name", "tokens"),
    [
        ("../survey.csv", "survey: … '..'"),
        ("/etc/passwd", "survey: … /etc/passwd … '..'"),
        ("a/../../survey.csv", "survey: … '..'"),
        ("{lift}.csv", "survey: … {lift}.csv … braces"),  # Snakemake takes them for wildcards
        ("link.csv", "link.csv … data_root"),
    ],
)
def test_recordings_outside_the_root_or_with_braces_are_rejected(config, folder, name, tokens):
    (folder / "data").mkdir()
    (folder / "data" / "{lift}.csv").write_text("x")
    (folder / "data" / "link.csv").symlink_to(__file__)
    config["survey"]["file"] = name
    assert has_tokens(refusal(load_study, recorded(config, "data"), folder), tokens)
    assert name == "link.csv" or has_tokens(refusal(load_study, config, folder), tokens)


def test_subject_files_are_checked_too(config, folder):
    subject = folder / "config" / "subjects" / "novice.yaml"
    content = yaml.safe_load(subject.read_text(encoding="utf-8"))
    content["subject"] |= {"mass_kg": -70, "name": "someone"}
    subject.write_text(yaml.safe_dump(content), encoding="utf-8")
    config["lifting"]["subjects"] = ["expert", "novice", "nobody"]
    message = refusal(load_study, config, folder)
    assert has_tokens(message, "config/subjects/novice.yaml, line 4 … subject.mass_kg … -70 … > 0")
    assert has_tokens(message, "config/subjects/nobody.yaml … expert, novice")


def test_copy_of_subject_needs_its_own_name(config, folder):
    people = folder / "config" / "subjects"
    text = (people / "expert.yaml").read_text(encoding="utf-8").replace("mass_kg: 78.0", "mass_kg: 61")
    copy, alone = people / "anna.yaml", folder / "anna.yaml"
    for path in (copy, alone):
        path.write_text(text, encoding="utf-8")
    problem = "anna.yaml, line 4 … subject.name … 'expert' … name: anna"
    assert has_tokens(refusal(load_subject, copy), problem)
    single = overlay(config, yaml.safe_load(text))
    assert has_tokens(refusal(load_study, single, folder, ["config/subjects/anna.yaml"]), problem)
    assert load_subject(alone).mass_kg == 61
    copy.write_text("subject: {mass_kg: 61}", encoding="utf-8")
    names = [f"config/subjects/{name}.yaml" for name in ("expert", "anna")]
    assert load_study(single, folder, names).subjects["expert"].mass_kg == 61
    copy.write_text(
        text.replace("name: expert", "name: anna").replace(" mass_kg", " weight_kg"), encoding="utf-8"
    )
    assert has_tokens(refusal(load_subject, copy), "line 6 … subject.weight_kg … did you mean 'mass_kg'")


def test_subject_without_trials_is_rejected(config, folder):
    """Without them a file serves single lifts alone."""
    subject = folder / "config" / "subjects" / "novice.yaml"
    lines = subject.read_text(encoding="utf-8").splitlines()
    kept = [line for line in lines if not line.lstrip().startswith(("- {", "trials:"))]
    subject.write_text("\n".join([*kept, "  trials: []"]), encoding="utf-8")
    assert has_tokens(refusal(load_study, config, folder), "lifting.subjects … novice … trials")


def test_lifts_that_the_twin_cannot_make_are_rejected(config, folder):
    """A person's file that was copied and half changed, with a label that nobody has, and movements of nobody."""
    people = folder / "config" / "subjects"
    text = (people / "expert.yaml").read_text(encoding="utf-8")
    third = text.replace("name: expert", "name: third").replace("experience: expert", "experience: nurse")
    (people / "third.yaml").write_text(third + "  static: standing.c3d\n", encoding="utf-8")
    config["lifting"]["subjects"] = ["expert", "novice", "third"]
    twin = config["twin"]["lifting"]
    twin["lifts"]["novice_15kg"]["person"] = "robot"
    del twin["hip_moment"]["trials"]["paced"]
    twin["hip_moment"]["trials"]["fast"]["lift"] = "third_23kg"
    message = refusal(load_study, config, folder)
    file = "config/subjects/third.yaml, line"
    for tokens in (
        "twin.lifting.lifts.novice_15kg.person … 'robot' … expert, novice",
        "twin.lifting.hip_moment.trials.fast.lift … 'third_23kg' … expert_23kg,",
        "improvement.record_sets.2.records.0.name … 'paced' … twin.lifting.hip_moment.trials … fast,",
        f"{file} 10 … subject.trials.0.markers … lifting/expert_23kg.c3d … lifting/third_23kg.c3d",
        f"{file} 12 … subject.static … 'standing.c3d' … twin",
        f"{file} 8 … subject.experience … 'nurse' … twin … third_23kg, third_15kg",
        f"{file} 4 … subject.name … third … mass_kg: 78, height_m: 1.75 … twin.lifting.people",
    ):
        assert has_tokens(message, tokens), tokens


def test_labelled_artefacts_have_captions_and_pictures(project):
    shown = [row for row in read_artefacts(project / "config" / "artefacts.tsv") if row.label]
    captions = {path.stem for path in (project / "workflow" / "report").glob("*.rst")}
    assert {row.id for row in shown} == captions
    for row in shown:
        files = row.labelled(["x_1kg", "y_2kg"])
        seen = [label for path, label in files if path.endswith((".html", ".svg"))]
        assert seen and len(seen) == len(set(seen))
        assert ("{record_set}" in row.path) == ("{record_set}" in row.label)


def test_artefacts_with_unknown_chapter_or_repeated_id_are_rejected(tmp_path):
    sheet = tmp_path / "artefacts.tsv"
    sheet.write_text("id\trule\tpath\tchapter\tlabel\na\tr\tp\tsurvey\tA\na\tr\tp\tsurveys\tA\n")
    with pytest.raises(InputError, match=r"(?s)line 3: chapter 'surveys'.*line 3: 'a' .*label 'A'"):
        read_artefacts(sheet)


def test_every_key_has_a_description():
    assert [path for path, key, _ in keys(Key.from_class(StudySettings), {}) if not key.meaning] == []


def test_settings_survive_a_round_trip_through_yaml():
    settings = study_settings("studies/box_transfer.yaml")
    assert StudySettings.model_validate(settings.model_dump(mode="json")) == settings
    written = yaml.safe_dump(settings.model_dump(mode="json"))
    assert StudySettings.model_validate(yaml.safe_load(written)) == settings


def test_yaml_file_keeps_content_and_lines(tmp_path):
    text = "a: 1\nb:\n  c: [x, {d: 2}]\n  e: &e {f: 3}\ng:\n  <<: *e\n  h: 1.5e+3\n"
    (tmp_path / "a.yaml").write_text(text, encoding="utf-8")
    problems = Problems("x")
    file = read_yaml(tmp_path / "a.yaml", problems)
    assert not problems.entries
    assert file.content == yaml.safe_load(text)
    assert (file.lines["b", "c", 1, "d"], file.lines["b", "e", "f"], file.lines["g", "h"]) == (3, 4, 7)
    assert file.line(("b", "c", 7, "z")) == 3
    assert read_yaml(tmp_path / "a.yaml", problems).path.endswith("a.yaml")


@pytest.mark.parametrize(
    ("content", "tokens"),
    [
        (b"a: 1\n\tb: 2\n", "a.yaml, line 2 … YAML"),
        (b"a: !!python/object/apply:os.system [ls]\n", "a.yaml, line 1: a: tag 'tag:yaml.org,2002:python"),
        (b"a: 1\n---\nb: 2\n", "a.yaml, line 2 … YAML"),
        ("a: 1\nb: Prüfstand\n".encode("latin-1"), "a.yaml, line 2 … 0xfc … UTF-8"),
        (b"a: 1\nb: {c: 2,\n  c: 3}\na: 4\n", "a.yaml … 1 … 4 … key 'a'"),
        (b"a: 1\nb: {c: 2,\n  c: 3}\na: 4\n", "a.yaml … 2 … 3 … key 'b.c'"),
        (b"- 1\n", "a.yaml … mapping"),
        (b"a: " + b"[" * 1000 + b"]" * 1000, "a.yaml … nested"),
        (b"b: 1\na: " + b"9" * 200, "a.yaml, line 2: a: … 200"),
        (b"a: " + b"9" * 5000, "a.yaml, line 1: a: … 5000"),
        (b"a: &a [x, x, x, x, x, x, x, x, x, x]\n", ""),
        (
            b"a: &a [x, x, x, x, x, x, x, x, x]\n"
            + b"".join(
                b"%c: &%c [%s]\n" % (k, k, b", ".join([b"*%c" % (k - 1)] * 9)) for k in range(98, 106)
            ),
            "a.yaml … aliases",
        ),
        (b"a: " + b"x" * 1_100_000, "a.yaml … 1000000"),
    ],
)
def test_faults_of_yaml_are_reported_with_their_lines(tmp_path, content, tokens):
    (tmp_path / "a.yaml").write_bytes(content)
    problems = Problems("x")
    read_yaml(tmp_path / "a.yaml", problems, "a.yaml")
    assert bool(problems.entries) == bool(tokens)
    assert has_tokens("\n".join(problems.entries), tokens)


def test_problems_name_the_file_that_set_the_value(tmp_path):
    upper = tmp_path / "upper.yaml"
    upper.write_text("title: x\nsurvey:\n  confidence: 95\n  note: a\n  note: b\nseed: 5\n")
    lower = tmp_path / "lower.yaml"
    lower.write_text("chapters: [survey]\nsurvey: {confidence: 0.9, resamples: 3}\n")
    survey = {"confidence": 95, "note": "b", "resamples": 3}
    config = {"title": "x", "chapters": ["survey"], "survey": survey, "seed": -5}
    message = refusal(load_study, config, PROJECT, [lower, upper])
    for tokens in (
        f"{upper}, line 3 … survey.confidence … 95",
        f"{lower}, line 2 … survey.resamples … 3",
        f"{upper}, … 4 … 5 … 'survey.note'",
        "--config: seed … -5",
        "configuration: 4",
    ):
        assert has_tokens(message, tokens), tokens


@pytest.mark.parametrize(
    ("given", "tokens"),
    [
        ({"lifting": {"filter": {"order": 99}}}, "--config: lifting.filter.order … 99 … ≥ 1, ≤ 8"),
        ({"lifting": {"filtr": {"order": 2}}}, "--config: lifting.filtr: … 'filter'"),
        ({"lifting": {"subjects": ["expert", "nobody"]}}, "--config: lifting.subjects.1 … config/subjects/nobody.yaml"),
        ({"chapters": []}, "--config: chapters:"),
        ({"twin": {"seed": -5}}, "--config: twin.seed … -5"),
    ],
)  # fmt: skip
def test_faults_of_the_command_line_have_no_file_line(config, given, tokens):
    message = refusal(load_study, overlay(config, given), PROJECT, [PROJECT / path for path in DEFAULT_FILES])
    assert has_tokens(message, tokens)
    assert "config.yaml, line" not in message


def test_faults_of_a_file_have_its_line_despite_a_command_line(tmp_path, config):
    study = tmp_path / "study.yaml"
    study.write_text("lifting:\n  filter: {order: 99}\n")
    merged = overlay(config, {"lifting": {"filter": {"order": 99, "cutoff_Hz": 5}}})
    message = refusal(load_study, merged, PROJECT, [*(PROJECT / path for path in DEFAULT_FILES), study])
    assert has_tokens(message, f"{study}, line 2: lifting.filter.order … 99")


@pytest.mark.parametrize(("content", "tokens"), [("a: Pr\xfcfung", "line 1: … 0xfc"), ("a: x", "")])
def test_yaml_module_reports_faults_without_traceback(tmp_path, content, tokens):
    """As ``make`` does: nothing of the workflow runs before Snakemake has read its ``--configfile``."""
    path = tmp_path / "study.yaml"
    path.write_text(content, encoding="latin-1")
    command = [sys.executable, "-m", "lumbar.base.yaml_file", str(path)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == bool(tokens)
    assert has_tokens(run.stderr, tokens) and "Traceback" not in run.stderr
