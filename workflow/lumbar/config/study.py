"""The study: its configuration checked as a whole, and the places its files come from.

Everything a workflow or the command line needs to know of a configuration is asked in this package, so that a wrong key
is found before anything runs and all wrong keys are found at once.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lumbar.config.artefacts import Artefact, read_artefacts
from lumbar.config.chapters import NEEDS
from lumbar.config.consistency import check_consistency
from lumbar.config.schemas import check_schema
from lumbar.errors import Problems
from lumbar.tables import SYNTHETIC_TWIN

TWIN = "twin"


@dataclass(frozen=True)
class Study:
    """A checked configuration.

    Attributes
    ----------
    name : str
        Name of the results folder: the study's, or the subject's where one person runs alone.
    config : dict
        The merged configuration.
    subjects : dict of str to dict
        Subject files by name, in the study's order.
    artefacts : list of Artefact
        Those of the study's chapters.
    """

    name: str
    config: dict[str, Any]
    subjects: dict[str, dict]
    artefacts: list[Artefact]
    data_root: Path | None
    lifts: dict[str, dict] = field(default_factory=dict)

    @property
    def synthetic(self) -> bool:
        """Whether the data are made by the twin."""
        return self.config["data"] == TWIN

    @property
    def data_label(self) -> str:
        """The words that say, on every table and figure, where the data come from."""
        return SYNTHETIC_TWIN if self.synthetic else self.config["data_source"]["name"]

    def recording(self, path: str) -> str:
        """Path of a recording named in the configuration; relative to the working directory if made here."""
        if self.synthetic:
            return f"results/{self.name}/twin/{path}"
        return str(self.data_root / path)

    def subject_of(self, lift: str) -> dict:
        """The subject of a lift without trials: another trial of the person does not change this lift."""
        subject = self.subjects[self.lifts[lift]["subject"]]
        return {key: value for key, value in subject.items() if key != "trials"}

    def has(self, chapter: str) -> bool:
        """Whether the study includes a chapter."""
        return chapter in self.config["chapters"]


def load_study(config: dict, root: Path) -> Study:
    """Check a merged configuration and return the study it describes.

    Parameters
    ----------
    config : dict
        Defaults with study and subject files laid over them.
    root : Path
        Folder of the project: schemas and subject files lie below it.

    Returns
    -------
    Study

    Raises
    ------
    InputError
        With every wrong key, value, missing file or contradiction found.
    """
    problems = Problems("configuration")
    check_schema(config, root, problems)
    problems.raise_if_any()
    subjects = _load_subjects(config, root, problems)
    chapters = config["chapters"]
    for chapter in chapters:
        missing = [needed for needed in NEEDS.get(chapter, []) if needed not in chapters]
        if missing:
            problems.add("chapters", f"{chapter} without {', '.join(missing)}", "it builds on it: add it")
    if "perturbations" in chapters and config["perturbations"] is None:
        problems.add("perturbations", "null", "the chapter needs its trials")
    problems.raise_if_any()
    name = config["subject"]["name"] if "subject" in config else config["study"]
    lifts = name_lifts(subjects)
    artefacts = read_artefacts(root / "config" / "artefacts.tsv")
    study = Study(
        name=name,
        config=config,
        subjects=subjects,
        artefacts=[
            row.expanded(
                model=config["runtime"]["models"],
                record_set=[entry["name"] for entry in config["improvement"]["record_sets"]],
            )
            for row in artefacts
            if row.chapter in chapters
        ],
        data_root=_data_root(config, root, problems),
        lifts=lifts if "lifting" in chapters else {},
    )
    check_consistency(study, problems)
    problems.raise_if_any()
    return study


def name_lifts(subjects: dict[str, dict]) -> dict[str, dict]:
    """Return every trial by the name of its lift: ``expert_23kg``, and ``expert_23kg_2`` where it is repeated.

    Parameters
    ----------
    subjects : dict of str to dict
        Subject files by name.
    """
    lifts: dict[str, dict] = {}
    for subject, content in subjects.items():
        masses = []
        for trial in content["trials"]:
            masses.append(trial["box_mass_kg"])
            repetition = masses.count(trial["box_mass_kg"])
            name = f"{subject}_{trial['box_mass_kg']:g}kg"
            lifts[name if repetition == 1 else f"{name}_{repetition}"] = {"subject": subject, **trial}
    return lifts


def _load_subjects(config: dict, root: Path, problems: Problems) -> dict[str, dict]:
    import yaml

    if "lifting" not in config["chapters"]:
        return {}
    if "subject" in config:
        return {config["subject"]["name"]: config["subject"]}
    subjects = {}
    for name in config["lifting"]["subjects"]:
        path = root / "config" / "subjects" / f"{name}.yaml"
        if not path.is_file():
            known = ", ".join(sorted(item.stem for item in path.parent.glob("*.yaml")))
            problems.add("lifting.subjects", f"no file config/subjects/{name}.yaml", f"there are: {known}")
            continue
        content = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
        own = Problems(f"config/subjects/{name}.yaml")
        check_schema(content, root, own, "subject.schema.yaml")
        if not own.entries and content["subject"]["name"] != name:
            own.add("subject.name", repr(content["subject"]["name"]), f"the file is named {name}.yaml")
        problems.extend(own)
        if not own.entries:
            subjects[name] = content["subject"]
    return subjects


def _data_root(config: dict, root: Path, problems: Problems) -> Path | None:
    if config["data"] == TWIN:
        return None
    named = os.environ.get("LUMBAR_DATA") or config["data_root"]
    source = config["data_source"]
    if source is None:
        problems.add("data_source", "missing", "recordings need name, licence and where to obtain them")
        return None
    if named is None:
        problems.add(
            "data_root", "not set", "set it in the study's YAML or in the environment variable LUMBAR_DATA"
        )
        return None
    folder = Path(named).expanduser()
    folder = folder if folder.is_absolute() else root / folder
    if not folder.is_dir():
        problems.add(
            "data_root",
            f"the folder {folder} does not exist",
            f"it should hold: {source['name']} (licence: {source['licence']}); obtain it from "
            f"{source['obtain']}, then set data_root in the study's YAML or the environment variable "
            "LUMBAR_DATA",
        )
        return None
    return folder.resolve()
