"""The study: its configuration checked as a whole, and the places its files come from.

Everything a workflow or the command line needs to know of a configuration is asked here, so that a wrong key
is found before anything runs and all wrong keys are found at once.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from lumbar.errors import InputError, Problems
from lumbar.tables import SYNTHETIC_TWIN

TWIN = "twin"
CHAPTERS = (
    "surgeon",
    "signals",
    "tissue",
    "improvement",
    "runtime",
    "survey",
    "lifting",
    "stability",
    "perturbations",
    "claims",
)
NEEDS = {"signals": ["surgeon"], "improvement": ["tissue"], "runtime": ["tissue"], "stability": ["lifting"]}
"""Chapters that build on another one of the same study."""
RECORDED = ("surgeon", "tissue", "improvement", "survey", "lifting", "perturbations")
"""Chapters that read recordings."""


@dataclass(frozen=True)
class Artefact:
    """One table, figure or file of the thesis: a row of ``config/artefacts.tsv``.

    Attributes
    ----------
    id : str
        Name of its target, e.g. ``"table_3_1"``.
    rule : str
        Rule that makes it.
    path : str
        Below the study's results; ``{csv,tex,html}`` stands for each of these, ``{lift}`` for every lift,
        ``{model}`` for every exported model, ``{record_set}`` for every record set of the improvement chapter.
    chapter : str
        One of `CHAPTERS`.
    """

    id: str
    rule: str
    path: str
    chapter: str

    def expanded(self, **choices: Iterable[str]) -> Artefact:
        """Return the artefact with ``{name}`` standing for each of the choices given for it."""
        path = self.path
        for name, values in choices.items():
            path = path.replace(f"{{{name}}}", "{" + ",".join(values) + "}")
        return replace(self, path=path)

    def paths(self, lifts: Iterable[str] = ()) -> list[str]:
        """Every file of the artefact, below the study's results."""
        patterns = [self.path]
        if "{lift}" in self.path:
            patterns = [self.path.replace("{lift}", lift) for lift in lifts]
        return [path for pattern in patterns for path in _expand_braces(pattern)]


def _expand_braces(pattern: str) -> list[str]:
    before, opening, rest = pattern.partition("{")
    if not opening:
        return [pattern]
    choices, _, after = rest.partition("}")
    return [before + choice + tail for choice in choices.split(",") for tail in _expand_braces(after)]


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
    _check_schema(config, root, problems)
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
    _check_records(study, problems)
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


def read_artefacts(path: Path) -> list[Artefact]:
    """Read the sheet of artefacts (tab-separated: id, rule, path, chapter)."""
    with path.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t"))
    problems = Problems(str(path))
    for line, row in enumerate(rows, start=2):
        if row["chapter"] not in CHAPTERS:
            problems.add(f"line {line}", f"chapter {row['chapter']!r}", f"allowed: {', '.join(CHAPTERS)}")
        if row["id"] in (earlier["id"] for earlier in rows[: line - 2]):
            problems.add(f"line {line}", f"{row['id']!r} stands twice", "ids are names of targets")
    problems.raise_if_any()
    return [Artefact(row["id"], row["rule"], row["path"], row["chapter"]) for row in rows]


@cache
def _schemas(root: Path):
    """Registry of all schemas in ``workflow/schemas``, and the validator of the whole configuration."""
    import yaml
    from jsonschema import Draft202012Validator
    from referencing import Registry, Resource

    folder = root / "workflow" / "schemas"
    contents = {
        path.name: yaml.safe_load(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.yaml"))
    }
    registry = Registry().with_resources(
        (name, Resource.from_contents({"$schema": "https://json-schema.org/draft/2020-12/schema", **content}))
        for name, content in contents.items()
    )
    return lambda name: Draft202012Validator(contents[name], registry=registry)


def _check_schema(content: dict, root: Path, problems: Problems, schema: str = "config.schema.yaml") -> None:
    from jsonschema.exceptions import best_match

    errors = _schemas(root)(schema).iter_errors(content)
    for error in sorted(errors, key=lambda item: list(map(str, item.path))):
        if error.validator in ("anyOf", "oneOf") and error.context:
            error = best_match([error])
        key = ".".join(map(str, error.absolute_path)) or "top level"
        allowed = error.schema.get("description", "") if isinstance(error.schema, dict) else ""
        if error.validator == "additionalProperties":
            known = ", ".join(error.schema.get("properties", {}))
            problems.add(key, error.message.split(" (")[0], f"allowed keys: {known}. {error.message}")
        else:
            problems.add(key, error.message, allowed)


def check_sections(content: dict, sections: Iterable[str], root: Path) -> None:
    """Check some sections of a configuration against their schemas.

    Parameters
    ----------
    content : dict
        By section; a section's schema is ``workflow/schemas/<section>.schema.yaml``.
    sections : iterable of str
        Those to check.
    root : Path
        Folder of the project.

    Raises
    ------
    InputError
        With every wrong key and value.
    """
    problems = Problems("configuration")
    for section in sections:
        own = Problems(section)
        _check_schema(content[section], root, own, f"{section}.schema.yaml")
        problems.extend(own)
    problems.raise_if_any()


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
        _check_schema(content, root, own, "subject.schema.yaml")
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


def recordings_of(study: Study) -> dict[str, list[str]]:
    """File names of the recordings each chapter reads, as the configuration gives them."""
    config = study.config
    files = {
        "surgeon": [record["file"] for record in config["surgeon"]["records"]],
        "tissue": [record["file"] for record in config["tissue"]["records"]],
        "improvement": [
            record["file"]
            for entry in config["improvement"]["record_sets"]
            for record in entry.get("records", [])
        ],
        "survey": [config["survey"]["file"]],
        "lifting": [
            trial[key] for trial in study.lifts.values() for key in ("markers", "hip_moment") if key in trial
        ],
    }
    if study.has("perturbations"):
        settings = config["perturbations"]
        files["perturbations"] = [*settings["unperturbed"], *settings["perturbed"]]
    return {chapter: names for chapter, names in files.items() if names and study.has(chapter)}


def record_layout(config: dict, base: str) -> tuple[dict, float | None]:
    """Layout of a base model's records, and the rate (Hz) to which they are resampled.

    Raises
    ------
    InputError
        For an unknown base.
    """
    from lumbar.effects.base import BASES

    if base not in BASES:
        raise InputError(f"unknown base model {base!r}; known are {', '.join(BASES)}")
    if BASES[base].system == "pendulum":
        return config["lifting"]["moment_layout"], None
    return config["tissue"]["layout"], config["tissue"]["rate_Hz"]


def record_set_base(config: dict, name: str) -> str:
    """Base model of a record set of the improvement chapter."""
    entry = next(item for item in config["improvement"]["record_sets"] if item["name"] == name)
    return entry.get("base", config["improvement"]["base"])


def record_set_records(study: Study, name: str) -> list[dict]:
    """Records of a record set of the improvement chapter, as the configuration names them."""
    entry = next(item for item in study.config["improvement"]["record_sets"] if item["name"] == name)
    return entry.get("records", study.config["tissue"]["records"])


def reading_plan(study: Study, chapters: Iterable[str]) -> list[dict]:
    """How every recording of these chapters is read, for `lumbar.records.checking.check_recordings`.

    Holds what reading needs and nothing else of the configuration, so that a subject's mass or an analysis
    setting does not call for reading again.

    Returns
    -------
    list of dict
        ``chapter``, ``set``, ``reader``, ``path`` and ``layout`` of each file, and ``name``, ``period_s`` and
        ``rate_Hz`` of column files where the configuration gives them.
    """
    plan = []
    for chapter in chapters:
        settings = study.config[chapter]
        if chapter == "lifting":
            plan += _lift_readings(study)
        elif chapter == "improvement":
            for entry in settings["record_sets"]:
                layout, rate = record_layout(study.config, record_set_base(study.config, entry["name"]))
                readings = [
                    _column_reading(study, chapter, record, layout, rate)
                    for record in entry.get("records", [])
                ]
                plan += [{**reading, "set": entry["name"]} for reading in readings]
        elif chapter == "perturbations":
            plan += [
                {
                    "chapter": chapter,
                    "reader": "markers",
                    "path": study.recording(name),
                    "layout": settings["markers"],
                }
                for name in (*settings["unperturbed"], *settings["perturbed"])
            ]
        elif chapter == "survey":
            path = study.recording(settings["file"])
            plan.append({"chapter": chapter, "reader": "ratings", "path": path, "layout": settings["layout"]})
        else:
            layout, rate = settings["layout"], settings.get("rate_Hz")
            plan += [_column_reading(study, chapter, record, layout, rate) for record in settings["records"]]
    return plan


def _column_reading(study: Study, chapter: str, record: dict, layout: dict, rate: float | None) -> dict:
    reading = {
        "chapter": chapter,
        "set": chapter,
        "reader": "columns",
        "path": study.recording(record["file"]),
        "layout": layout,
        "name": record["name"],
        "period_s": record.get("period_s"),
        "rate_Hz": rate,
    }
    return {key: value for key, value in reading.items() if value is not None}


def _lift_readings(study: Study) -> list[dict]:
    settings = study.config["lifting"]
    markers = {"chapter": "lifting", "reader": "markers", "layout": settings["markers"]}
    moments = {"chapter": "lifting", "set": "hip moments", "reader": "columns"}
    plan = []
    for lift, trial in study.lifts.items():
        plan.append({**markers, "path": study.recording(trial["markers"])})
        if "hip_moment" in trial:
            path, layout = study.recording(trial["hip_moment"]), settings["moment_layout"]
            plan.append({**moments, "path": path, "layout": layout, "name": f"hip moment of {lift}"})
    return plan


def _check_survey(survey: dict, problems: Problems) -> None:
    """Check what one key of the survey says about another."""
    models = [model["name"] for model in survey["layout"]["models"]]
    if survey["baseline"] not in models:
        known = ", ".join(models)
        problems.add("survey.baseline", f"{survey['baseline']!r} is not rated", f"models: {known}")
    points, labels = survey["layout"]["scale_points"], len(survey["scale_labels"])
    if labels != points:
        problems.add("survey.scale_labels", f"{labels} names", f"survey.layout.scale_points is {points}")


def _check_tissue(tissue: dict, problems: Problems) -> None:
    """Check what one key of the tissue tests says about another."""
    ridge, (start, stop) = tissue["ridge"], tissue["segment_s"]
    if ridge["alpha_min"] >= ridge["alpha_max"]:
        found = f"{ridge['alpha_min']:g} is not below alpha_max {ridge['alpha_max']:g}"
        problems.add("tissue.ridge.alpha_min", found, "the progression runs from the smaller to the larger")
    if start >= stop:
        problems.add("tissue.segment_s", f"[{start:g}, {stop:g}]", "start before end")
    if tissue["search"]["selection"] == "test" and len(tissue["records"]) < 2:
        problems.add("tissue.search.selection", "'test' with a single record", "use training")


def _check_record_sets(config: dict, problems: Problems) -> None:
    """Check that a set whose base is no model of a tissue has records of its own."""
    tissue = config["tissue"]["layout"]
    for entry in config["improvement"]["record_sets"]:
        layout, _ = record_layout(config, record_set_base(config, entry["name"]))
        if layout is not tissue and "records" not in entry:
            found = f"{entry['name']} has the base {entry['base']} and no records"
            problems.add(
                "improvement.record_sets", found, "those of the tissue chapter are none: name its own"
            )


def _check_records(study: Study, problems: Problems) -> None:
    """Check names, references between keys and that every given recording is there and inside the root."""
    config = study.config
    if study.has("tissue"):
        names = [record["name"] for record in config["tissue"]["records"]]
        for name in config["tissue"]["training"]:
            if name not in names:
                problems.add("tissue.training", f"{name!r} is no record", f"records: {', '.join(names)}")
        for name in sorted({name for name in names if names.count(name) > 1}):
            problems.add("tissue.records", f"{name!r} stands twice", "names of records must differ")
        trained_on = config["runtime"]["trained_on"]
        if study.has("runtime") and trained_on not in config["tissue"]["training"]:
            problems.add(
                "runtime.trained_on", f"{trained_on!r} is not trained on", "take one of tissue.training"
            )
        _check_tissue(config["tissue"], problems)
    if study.has("improvement"):
        _check_record_sets(config, problems)
    if study.has("survey"):
        _check_survey(config["survey"], problems)
    if study.has("stability") or study.has("perturbations"):
        from lumbar.stability.riccati import weight_problems

        regulator = config["stability"]["regulator"]
        problems.extend(weight_problems(**regulator))
    for chapter, files in recordings_of(study).items():
        for name in files:
            path = Path(name)
            if path.is_absolute() or ".." in path.parts:
                problems.add(
                    chapter, f"file {name!r}", "recordings are named relative to data_root, without '..'"
                )
            elif study.data_root is not None:
                found = (study.data_root / path).resolve()
                if not found.is_relative_to(study.data_root):
                    problems.add(chapter, f"{name} leads out of data_root", "copy the file there")
                elif not found.is_file():
                    source = study.config["data_source"]
                    problems.add(
                        chapter,
                        f"{name} is not in {study.data_root}",
                        f"it comes with {source['name']} (licence: {source['licence']}): {source['obtain']}",
                    )
