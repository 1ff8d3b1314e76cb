"""The workflow as a module of another workflow, and from another folder than its own."""

import json
import shutil

from running import PROJECT, snakemake

IMPORTING = f"""
module lumbar:
    snakefile: {str(PROJECT / "Snakefile")!r}
    config: config
    prefix: "lumbar"
use rule * from lumbar as lumbar_*
rule page:
    default_target: True
    input: rules.lumbar_table_4_1.input
    output: "page.txt"
    shell: "cat {{input}} > {{output}}"
"""


def person(name: str) -> str:
    text = (PROJECT / "config" / "subjects" / "expert.yaml").read_text(encoding="utf-8")
    return text.replace("expert", name).replace(f"experience: {name}", "experience: expert")


def write_people(folder, *names: str) -> None:
    people = folder / "config" / "subjects"
    people.mkdir(parents=True)
    for name in names:
        people.joinpath(f"{name}.yaml").write_text(person(name), encoding="utf-8")


def test_another_workflow_imports_the_rules_with_its_study(tmp_path):
    (tmp_path / "Snakefile").write_text(IMPORTING, encoding="utf-8")
    write_people(tmp_path, "anna")
    study = {"study": "ours", "lifting": {"subjects": ["anna", "novice"]}}
    study["twin"] = {"lifting": {"people": {"anna": {"mass_kg": 77, "height_m": 1.75}}}}
    (tmp_path / "ours.yaml").write_text(json.dumps(study), encoding="utf-8")
    run = snakemake(tmp_path, "--dry-run", "--cores", "1", "--configfile", "ours.yaml").whole()
    assert run.jobs["page"] == 1 and run.jobs["lumbar_lift"] == 4
    reasons = snakemake(
        tmp_path, "--dry-run", "--cores", "1", "--quiet", "host", "--configfile", "ours.yaml"
    ).whole()
    assert "lumbar/results/ours/lifting/anna_23kg/pendulum.csv" in reasons.text


def test_files_of_the_working_folder_precede_those_of_the_workflow(tmp_path):
    """The user's subjects and recordings, relative to the folder of the call; subjects of the workflow if it has none."""
    write_people(tmp_path, "anna")
    recordings = tmp_path / "recordings" / "lifting"
    recordings.mkdir(parents=True)
    for name in ("anna", "novice"):
        for mass in ("15", "23"):
            for end in (".c3d", "_hip_moment.csv"):
                recordings.joinpath(f"{name}_{mass}kg{end}").touch()
    study = {"study": "ours", "data": "recordings", "data_root": "recordings", "chapters": ["lifting"]}
    study |= {"lifting": {"subjects": ["anna", "novice"]}}
    study |= {"data_source": {"name": "ours", "licence": "none", "obtain": "here"}}
    (tmp_path / "ours.yaml").write_text(json.dumps(study), encoding="utf-8")
    elsewhere = ("--snakefile", str(PROJECT / "Snakefile"), "--configfile", "ours.yaml")
    assert snakemake(tmp_path, "--dry-run", "--cores", "1", *elsewhere).whole().jobs["lift"] == 4
    shutil.rmtree(recordings)
    refused = snakemake(tmp_path, "--dry-run", "--cores", "1", *elsewhere)
    assert refused.status != 0
    missing = " ".join(refused.text.split())
    assert f"{tmp_path / 'recordings'}" in missing and "obtain ours (licence: none) from here" in missing
