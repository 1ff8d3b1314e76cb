"""``lumbar.report``: a finished study as one page."""

import os
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from lumbar.base.errors import InputError, Problems
from lumbar.base.files import read_json, write_text
from lumbar.base.yaml_file import read_yaml
from lumbar.publishing.figures.style import person_and_box
from lumbar.publishing.study_report.contents import chapters
from lumbar.publishing.study_report.report_page import report_page
from lumbar.study.load_study import load_study
from lumbar.study.study import read_artefacts
from lumbar.tables.table_layout import value_in_words


@dataclass(frozen=True, repr=False)
class StudyReport:
    """A study's report."""

    study: str
    html: str
    """The self-contained page; its links are relative to the study's results."""

    def __repr__(self) -> str:
        return f"<StudyReport of {self.study}: {len(self.html) / 1e6:.1f} MB>"

    def _repr_html_(self) -> str:
        return self.html

    def save(self, file: str | os.PathLike) -> None:
        """Write the page.

        Parameters
        ----------
        file : path
            The page.
        """
        write_text(Path(file), self.html)


def report(results: str | os.PathLike, project: str | os.PathLike = ".") -> StudyReport:
    """Return the report of a finished study: main results, failures and warnings, then every table and figure by chapter.

    Parameters
    ----------
    results : path
        ``results/<study>``, with ``run_config.yaml``.
    project : path
        Folder with ``config/artefacts.tsv``, and the captions in ``workflow/report``.

    Raises
    ------
    InputError
        If the folder has no study, or its settings are invalid.

    Examples
    --------
    >>> import lumbar
    >>> lumbar.report("results/thesis").save("results/thesis/report.html")        # doctest: +SKIP
    >>> lumbar.report("results/unknown")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    lumbar.base.errors.InputError: results/unknown/run_config.yaml: no such file; ...
    """
    results, project = Path(results), Path(project)
    for path in (results / "run_config.yaml", results / "run_environment.json"):
        if not path.is_file():
            raise InputError(f"{path}: no such file; run the workflow first, which writes it")
    problems = Problems(str(results / "run_config.yaml"))
    config = read_yaml(results / "run_config.yaml", problems).content
    problems.raise_if_any()
    study = load_study(config, Path.cwd(), shipped=project.resolve())
    settings, claims_file = study.settings, results / "claims.csv"
    claims = pd.read_csv(claims_file) if claims_file.is_file() and study.has("claims") else None
    people = {
        name: person_and_box({"subject": lift.subject, "box_mass_kg": lift.trial.box_mass_kg})
        for name, lift in study.lifts.items()
    }
    made = {row.id for row in study.artefacts}
    choices = {
        "lift": people,
        "record_set": {entry.name: value_in_words(entry.name) for entry in settings.improvement.record_sets},
        "model": {name: name for name in settings.runtime.models},
    }
    report_chapters = chapters(
        results,
        project / "workflow" / "report",
        [row for row in read_artefacts(project / "config" / "artefacts.tsv") if row.id in made],
        choices,
        claims,
    )
    environment = read_json(results / "run_environment.json")
    facts = {
        "name": study.name,
        "title": settings.title,
        "source_label": environment["data"],
        "people": list(dict.fromkeys(people.values())),
        "seed": settings.seed,
        "versions": environment["versions"],
    }
    return StudyReport(study.name, report_page(facts, results, report_chapters, claims))
