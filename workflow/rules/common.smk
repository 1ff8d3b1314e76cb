# What all rules share: the validated study, where its recordings lie, and what a script depends on.

import os
import sys
from pathlib import Path

from snakemake.io import sourcecache_entry

from run.dependencies import library_code
from run.jobs import expected_seconds, job_size, remove_half_written, set_job_environment
from run.summary import grouped_warnings, summary
from lumbar.base.environment import describe_environment
from lumbar.base.errors import LumbarError
from lumbar.base.yaml_file import read_nested_scalars, shipped_yaml
from lumbar.settings.validation import overlay
from lumbar.study.load_study import DEFAULT_FILES, load_study
from lumbar.study.study import read_artefacts

set_job_environment(WORKFLOW)

IMPORTED = Path(workflow.main_snakefile).resolve() != ROOT / "Snakefile"
if IMPORTED:
    # A module's `config:` keeps Snakemake from reading the default files. It overrides them, as a study's file does.
    for path in reversed(DEFAULT_FILES):
        config = overlay(shipped_yaml(ROOT / path), config)
else:
    config = overlay(config, read_nested_scalars(dict(workflow.config_settings.config)))
# Snakemake has merged these files, those of the command line last; messages name the line in the file.
GIVEN = workflow.overwrite_configfiles
FILES = [] if IMPORTED else [*workflow.configfiles[len(GIVEN) :], *GIVEN]
try:
    study = load_study(config, Path.cwd(), FILES, shipped=ROOT)
except LumbarError as error:
    sys.exit(str(error))  # a WorkflowError would begin with this file and line, where nothing is wrong

settings = study.settings


def plain(section, include=None):
    """Return a section, or some of its keys, as a parameter: a job runs again if one of them changes."""
    return section.model_dump(mode="json", include=include)


STUDY = study.name
ARTEFACTS = study.artefacts
SHEET = {row.id: row for row in read_artefacts(ROOT / "config" / "artefacts.tsv")}
CATEGORIES = {
    "twin": "0 Recordings",
    "surgeon": "1 Surgeon motion",
    "signals": "2 Signal design",
    "tissue": "3 System identification",
    "improvement": "4 Improvement",
    "runtime": "5 Haptic runtime",
    "survey": "6 Survey",
    "lifting": "7 Lifting",
    "stability": "8 Basins of attraction",
    "population": "8 People compared",
    "claims": "9 Claims",
}
CONDA = str(ROOT / "envs" / "lumbar.yaml")


def DATA(wildcards):
    """Label of the data. It is a function because Snakemake would treat braces in a plain text as wildcards."""
    return study.data_label


def placed(path):
    """Return the recording at a path: made by the twin, a local file that is not copied, or an object of a store."""
    if study.synthetic:
        return path
    return storage(path) if study.remote else local(path)


def recording(path):
    """Return a recording by its name in the configuration."""
    return placed(study.recording(path))


def source(path, folder=ROOT):
    """Return a file of the workflow; it is not copied to the storage of the results, and may move with its folder."""
    return sourcecache_entry(
        str(folder / path), path
    )  # `local` would also keep the job from the cluster's nodes


def at_hand(path):
    """Path at which this machine sees a result: its own, or that of the copy of the store's object."""
    return str(workflow.modifier.path_modifier.apply_default_storage(path))


def address(path):
    """Where a result is kept, as a person would name it."""
    return os.path.join(workflow.storage_settings.default_storage_prefix or "", path)


EFFECT_FILES = [source(path, Path.cwd()) for path in settings.improvement.effect_files]
BASE_FILES = [source(path, Path.cwd()) for path in sorted(set(settings.improvement.base_files.values()))]


def made(artefacts):
    """Files of these artefacts."""
    return [f"<results>/{path}" for artefact in artefacts for path in artefact.paths(study.lifts)]


def published(*names):
    """Outputs of these artefacts by name, each in all its formats: the page or picture is in the report.

    What belongs to a check that was not chosen would be empty and is left out.
    """
    made_here = [name for name in names if SHEET[name].check in ("", *settings.stability.checks)]
    return {
        name: [in_report(name, *file) for file in SHEET[name].labelled(study.lifts)] for name in made_here
    }


def in_report(name, path, label):
    """Output of an artefact; a page or picture is shown in the report with its caption and label."""
    if not path.endswith((".html", ".svg")):
        return f"<results>/{path}"
    return report(
        f"<results>/{path}",
        caption=str(WORKFLOW / "report" / f"{name}.rst"),
        category=CATEGORIES["twin" if name == "quality" else SHEET[name].chapter],  # recordings come first
        labels={"artefact": label},
    )


wildcard_constraints:
    lift="|".join(study.lifts) or "none",
    person="|".join(study.subjects) or "none",


# Not in the Snakefile, where older versions of Snakemake would report a syntax error before they compare their version.
pathvars:
    results=f"results/{STUDY}",
    logs=f"results/{STUDY}/logs",
    benchmarks=f"results/{STUDY}/benchmarks",
