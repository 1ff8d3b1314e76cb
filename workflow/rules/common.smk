# What all rules share: the validated study, where its recordings lie, and what a script depends on.

import sys
from pathlib import Path

WORKFLOW = Path(workflow.basedir) / "workflow"
sys.path.insert(0, str(WORKFLOW))

from dependencies import library_code
from job_environment import set_job_environment
from job_forks import fork_scripts
from job_resources import measured
from job_starts import lift_limit
from run_log import watch
from lumbar.config.artefacts import read_artefacts
from lumbar.config.load_study import load_study
from lumbar.errors import LumbarError
from lumbar.settings.plain import plain
from lumbar.stability.model.failures import announcement

set_job_environment(WORKFLOW)

# Snakemake has merged these files, those of the command line last; messages name the line in the file.
GIVEN = workflow.overwrite_configfiles
try:
    study = load_study(config, Path(workflow.basedir), [*workflow.configfiles[len(GIVEN) :], *GIVEN])
except LumbarError as error:
    sys.exit(str(error))  # a WorkflowError would begin with this file and line, where nothing is wrong

settings = study.settings

STUDY = study.name
ARTEFACTS = study.artefacts
SHEET = {row.id: row for row in read_artefacts(Path(workflow.basedir) / "config" / "artefacts.tsv")}
DATA = study.data_label
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
    "perturbations": "8 Basins of attraction",
    "population": "8 People compared",
    "pushes": "8 Basins of attraction",
    "claims": "9 Claims",
}
STAGES = CATEGORIES | {
    "records": CATEGORIES["twin"],
    "hidden_effects": CATEGORIES["improvement"],
    "report": "Report",
}
QUALITY = ("quality", "quality_of_trials")
BENCHMARKS = Path("results") / STUDY / "benchmarks"
RUN = {}  # what is told of the run under way
CONDA = str(Path(workflow.basedir) / "envs" / "lumbar.yaml")


def recording(path):
    """Path of a recording: made by the twin, or below the study's data root."""
    return study.recording(path)


def without(section, *keys):
    """A section as plain data, without the keys that do not concern a rule: they would run it again."""
    return {key: value for key, value in plain(section).items() if key not in keys}


def made(artefacts):
    """Files of these artefacts."""
    return [f"<results>/{path}" for artefact in artefacts for path in artefact.paths(study.lifts)]


def modelled():
    """Files of the lifts by the body model, where the study asks for it."""
    files = [f"<results>/lifting/{lift}/body_model_areas.csv" for lift in study.lifts]
    return files if study.has("lifting") and settings.lifting.body_model is not None else []


def published(*names):
    """Outputs of these artefacts by name, each in all its formats: the page or picture is in the report."""
    return {name: [in_report(name, *file) for file in SHEET[name].labelled(study.lifts)] for name in names}


def in_report(name, path, label):
    """Output of an artefact; a page or picture is shown in the report with its caption and label."""
    if not path.endswith((".html", ".svg")):
        return f"<results>/{path}"
    return report(
        f"<results>/{path}",
        caption=str(WORKFLOW / "report" / f"{name}.rst"),
        category=CATEGORIES["twin" if name in QUALITY else SHEET[name].chapter],  # recordings come first
        labels={"artefact": label},
    )


wildcard_constraints:
    lift="|".join(study.lifts) or "none",
    person="|".join(study.subjects) or "none",
