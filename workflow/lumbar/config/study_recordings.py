"""Which recordings a study reads, and how."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from lumbar.errors import InputError

if TYPE_CHECKING:
    from lumbar.config.study import Study


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
    from lumbar.models.bases import BASES

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
