"""A study's configuration is checked as a whole before anything runs."""

from __future__ import annotations

import copy
import shutil

import pytest
import yaml

from lumbar.config.artefacts import Artefact, read_artefacts
from lumbar.config.study import load_study, name_lifts
from lumbar.config.study_recordings import reading_plan, record_layout, record_set_base, recordings_of
from lumbar.errors import InputError


@pytest.fixture
def folder(project, tmp_path):
    """Make a project of its own: schemas, subjects, artefacts."""
    shutil.copytree(project / "config", tmp_path / "config")
    shutil.copytree(project / "workflow" / "schemas", tmp_path / "workflow" / "schemas")
    return tmp_path


@pytest.fixture
def config(project) -> dict:
    content = {}
    for name in ("config.yaml", "twin.yaml", "hidden_effects.yaml"):
        content |= yaml.safe_load((project / "config" / name).read_text(encoding="utf-8"))
    return copy.deepcopy(content)


def message_of(config, folder) -> str:
    with pytest.raises(InputError) as caught:
        load_study(config, folder)
    return str(caught.value)


def recorded(config, root) -> dict:
    """Return the survey alone, with recordings in `root`."""
    source = {"name": "Survey of laboratory X", "licence": "CC BY 4.0", "obtain": "https://example.org/data"}
    return config | {
        "data": "recordings",
        "data_root": str(root),
        "data_source": source,
        "chapters": ["survey"],
    }


def test_the_default_study_is_sound(config, folder):
    study = load_study(config, folder)
    assert study.synthetic
    assert study.data_label == "synthetic twin"
    assert study.name == "thesis"
    assert {"expert_23kg", "novice_15kg"} <= set(study.lifts)
    assert study.recording("survey.csv") == "results/thesis/twin/survey.csv"


def test_the_reading_plan_covers_every_recording_and_only_reading(config, folder):
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
    assert changed.subjects["expert"]["mass_kg"] == study.subjects["expert"]["mass_kg"] + 1
    assert reading_plan(changed, recordings_of(changed)) == before


def test_a_record_set_names_its_base_and_with_it_its_layout(config, folder):
    study = load_study(config, folder)
    assert record_set_base(config, "hip_moment") == "pendulum"
    assert record_set_base(config, "tissue") == "KB"
    config["tissue"]["rate_Hz"] = 50
    assert record_layout(config, "pendulum") == (config["lifting"]["moment_layout"], None)
    assert record_layout(config, "KV") == (config["tissue"]["layout"], 50)
    with pytest.raises(InputError, match="unknown base model 'HO'"):
        record_layout(config, "HO")
    plan = {item["path"]: item for item in reading_plan(study, ["improvement"])}
    moment = plan["results/thesis/twin/hip_moment/paced.csv"]
    assert moment["layout"]["columns"]["input"]["column"] == "angle_rad"
    assert "rate_Hz" not in moment
    force = plan["results/thesis/twin/two_hidden_effects/chirp.csv"]
    assert force["layout"] == config["tissue"]["layout"]
    config["improvement"]["record_sets"][0]["base"] = "pendulum"
    assert "tissue has the base pendulum and no records" in message_of(config, folder)
    config["improvement"]["record_sets"][2]["base"] = "HO"
    assert "improvement.record_sets.2.base" in message_of(config, folder)


def test_all_wrong_keys_are_named_at_once(config, folder):
    config["seed"] = -1
    config["survey"]["resmaples"] = 10
    config["survey"]["confidence"] = 95
    config["survey"]["zeros"] = "drop"
    config["survey"]["layout"]["scale_points"] = "five"
    config["colour"] = "blue"
    del config["title"]
    message = message_of(config, folder)
    for words in (
        "seed: -1 is less than the minimum of 0",
        "'resmaples' was unexpected",
        "survey.confidence: 95 is greater",
        "survey.zeros: 'drop' is not one of ['pratt', 'wilcox']",
        "survey.layout.scale_points: 'five' is not of type 'integer'",
        "'colour' was unexpected",
        "'title' is a required property",
    ):
        assert words in message
    assert "7 problems" in message


def test_keys_that_contradict_each_other(config, folder):
    config["survey"]["baseline"] = "LE"
    config["survey"]["scale_labels"] = ["no", "yes"]
    config["tissue"]["training"] = ["multisine", "step"]
    config["runtime"]["trained_on"] = "chirps"
    message = message_of(config, folder)
    for words in (
        "survey.baseline: 'LE' is not rated; models: IL, MW, KB, HO",
        "survey.scale_labels: 2 names; survey.layout.scale_points is 5",
        "tissue.training: 'step' is no record",
        "runtime.trained_on: 'chirps'",
    ):
        assert words in message


def test_chapters_need_those_they_build_on(config, folder):
    config["chapters"] = ["runtime", "stability"]
    message = message_of(config, folder)
    assert "runtime without tissue" in message
    assert "stability without lifting" in message


def test_an_absent_data_root_names_source_licence_and_where_to_get_it(config, folder, monkeypatch):
    monkeypatch.delenv("LUMBAR_DATA", raising=False)
    message = message_of(recorded(config, folder / "nowhere"), folder)
    for words in (
        "Survey of laboratory X",
        "CC BY 4.0",
        "https://example.org/data",
        "nowhere",
        "LUMBAR_DATA",
    ):
        assert words in message
    assert "data_root: not set" in message_of(recorded(config, "x") | {"data_root": None}, folder)
    assert "data_source: missing" in message_of(recorded(config, folder) | {"data_source": None}, folder)


def test_an_absent_recording_names_its_source(config, folder):
    (folder / "data").mkdir()
    message = message_of(recorded(config, "data"), folder)
    assert f"survey.csv is not in {folder / 'data'}" in message
    assert "CC BY 4.0" in message


def test_the_environment_variable_replaces_the_data_root(config, folder, monkeypatch):
    (folder / "data").mkdir()
    (folder / "data" / "survey.csv").write_text("x")
    monkeypatch.setenv("LUMBAR_DATA", str(folder / "data"))
    study = load_study(recorded(config, "nowhere"), folder)
    assert study.recording("survey.csv") == str(folder / "data" / "survey.csv")
    assert study.data_label == "Survey of laboratory X"
    assert not study.synthetic


@pytest.mark.parametrize("name", ["../survey.csv", "/etc/passwd", "a/../../survey.csv"])
def test_recordings_cannot_be_named_outside_the_root(config, folder, name):
    (folder / "data").mkdir()
    config["survey"]["file"] = name
    assert "without '..'" in message_of(recorded(config, "data"), folder)
    assert "without '..'" in message_of(config, folder)


def test_links_cannot_lead_out_of_the_root(config, folder):
    (folder / "data").mkdir()
    (folder / "secret.csv").write_text("x")
    (folder / "data" / "survey.csv").symlink_to(folder / "secret.csv")
    assert "survey.csv leads out of data_root" in message_of(recorded(config, "data"), folder)


def test_subject_files_are_checked_too(config, folder):
    subject = folder / "config" / "subjects" / "novice.yaml"
    content = yaml.safe_load(subject.read_text(encoding="utf-8"))
    content["subject"] |= {"mass_kg": -70, "name": "someone"}
    subject.write_text(yaml.safe_dump(content), encoding="utf-8")
    config["lifting"]["subjects"] = ["expert", "novice", "nobody"]
    message = message_of(config, folder)
    assert "config/subjects/novice.yaml: subject.mass_kg: -70" in message
    assert "no file config/subjects/nobody.yaml; there are: " in message


def test_one_person_alone_has_results_of_its_own(config, folder):
    subject = yaml.safe_load((folder / "config" / "subjects" / "novice.yaml").read_text(encoding="utf-8"))
    study = load_study(config | subject, folder)
    assert study.name == "novice"
    assert {lift["subject"] for lift in study.lifts.values()} == {"novice"}


def test_artefacts_expand_to_files():
    table = Artefact("t", "r", "tables/t.{csv,tex}", "tissue")
    assert table.paths() == ["tables/t.csv", "tables/t.tex"]
    lift = Artefact("l", "r", "lifting/{lift}/a.{svg,pdf}", "lifting")
    assert lift.paths(["x_1kg", "y_2kg"]) == [
        "lifting/x_1kg/a.svg", "lifting/x_1kg/a.pdf", "lifting/y_2kg/a.svg", "lifting/y_2kg/a.pdf"
    ]  # fmt: skip
    assert lift.paths() == []


def test_every_artefact_with_a_label_has_a_caption_and_something_to_look_at(project):
    shown = [row for row in read_artefacts(project / "config" / "artefacts.tsv") if row.label]
    captions = {path.stem for path in (project / "workflow" / "report").glob("*.rst")}
    assert {row.id for row in shown} == captions
    for row in shown:
        files = row.labelled(["x_1kg", "y_2kg"])
        seen = [label for path, label in files if path.endswith((".html", ".svg"))]
        assert seen and len(seen) == len(set(seen))
        assert ("{record_set}" in row.path) == ("{record_set}" in row.label)


def test_the_sheet_of_artefacts_is_checked(tmp_path):
    sheet = tmp_path / "artefacts.tsv"
    sheet.write_text("id\trule\tpath\tchapter\tlabel\na\tr\tp\tsurvey\tA\na\tr\tp\tsurveys\tA\n")
    with pytest.raises(
        InputError, match=r"(?s)line 3: chapter 'surveys'.*line 3: 'a' stands twice.*label .A. stands twice"
    ):
        read_artefacts(sheet)


@pytest.mark.parametrize("schema", ["survey.schema.yaml", "layout.schema.yaml", "config.schema.yaml"])
def test_every_key_has_a_description(project, schema):
    def undescribed(content: dict, path: str):
        for key, value in content.get("properties", {}).items():
            if "$ref" not in value:
                if "description" not in value:
                    yield f"{path}.{key}"
                yield from undescribed(value, f"{path}.{key}")
        if isinstance(content.get("items"), dict):
            yield from undescribed(content["items"], f"{path}[]")

    content = yaml.safe_load((project / "workflow" / "schemas" / schema).read_text(encoding="utf-8"))
    assert list(undescribed(content, "")) == []


def test_repeated_trials_with_one_box_are_lifts_of_their_own():
    trials = [{"box_mass_kg": 23, "markers": "a.c3d"}, {"box_mass_kg": 15, "markers": "b.c3d"}]
    trials += [{"box_mass_kg": 23, "markers": "c.c3d"}]
    lifts = name_lifts({"expert": {"trials": trials}, "novice": {"trials": trials[:1]}})
    assert {name: lift["markers"] for name, lift in lifts.items()} == {
        "expert_23kg": "a.c3d",
        "expert_15kg": "b.c3d",
        "expert_23kg_2": "c.c3d",
        "novice_23kg": "a.c3d",
    }
