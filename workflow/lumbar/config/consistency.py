"""What one key of a configuration says about another, and about the files it names."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.config.study_recordings import record_layout, record_set_base, recordings_of
from lumbar.errors import Problems

if TYPE_CHECKING:
    from lumbar.config.study import Study


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


def check_consistency(study: Study, problems: Problems) -> None:
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
        from lumbar.stability.model.riccati import weight_problems

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
