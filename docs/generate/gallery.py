"""The gallery of figures in the documentation: what each shows, which rule makes it, and how Python does.

``make docs`` writes the page from the sheet of artefacts and the captions of the report. The
site shows the pictures of ``results/thesis`` where they have been made: ``docs/gallery_pictures.py`` puts them in place of the
comments ``<!-- picture: … -->``.
"""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

from lumbar.base.files import write_text
from lumbar.study.study import Artefact, read_artefacts

PAGE = "gallery.md"
IN_PYTHON = {
    "surgeon_psd": "lumbar.bandwidth(trials).figure()",
    "excitation_signals": "lumbar.design_signals(2.5).figure()",
    "figure_3_5": "lumbar.identify(records).free_run_figure(record)",
    "error_ladders": 'lumbar.refine(records, ["coulomb_friction"]).save("out")',
    "comparison_figures": 'lumbar.compare(records, model).figure("noise")',
    "location_figures": 'lumbar.locate(records, model).figure("noise")',
    "effect_signatures": 'lumbar.diagnose(records).save("out")',
    "closed_loop": 'lumbar.render("models.json").loop_figure()',
    "z_width": 'lumbar.render("models.json").z_width_figure()',
    "survey_likert": 'lumbar.analyse_survey(file).figures()["survey_likert"]',
    "survey_best_picks_figure": 'lumbar.analyse_survey(file).figures()["survey_best_picks_figure"]',
    "measure_comparison_figure": "lumbar.compare_groups(table).figure()",
}
"""Figures that a verb of the library draws; the others come from the workflow alone."""
_HEAD = """\
# Gallery

<!-- Made by "make docs" from config/artefacts.tsv and workflow/report; change those. -->

Every figure of the default study, in the order of the thesis's chapters. `snakemake --cores 2 NAME` makes one of them and what it
needs; `make` makes all. All are written as SVG and PDF below `results/<study>/`;
the site (`make docs-site`) shows them here.
"""


def figures(project: Path) -> list[Artefact]:
    """Artefacts of the sheet that are pictures."""
    return [row for row in read_artefacts(project / "config" / "artefacts.tsv") if "svg" in row.path]


def page(project: Path) -> str:
    """Text of the page.

    Parameters
    ----------
    project : pathlib.Path
        Folder that holds ``config`` and ``workflow``.
    """
    parts = [_HEAD]
    for chapter, rows in groupby(figures(project), key=lambda row: row.chapter):
        parts.append(f"## {chapter.capitalize()}\n")
        parts += [_entry(row, project) for row in rows]
    return "\n".join(parts)


def title(figure: Artefact) -> str:
    """Heading under which the page shows a figure."""
    return figure.label.replace(" {lift}", "").replace(" the records {record_set}", " records")


def _entry(figure: Artefact, project: Path) -> str:
    caption = (project / "workflow" / "report" / f"{figure.id}.rst").read_text(encoding="utf-8").strip()
    lines = [f"### {title(figure)}\n", caption + "\n", f"- Name: `{figure.id}`, by the rule `{figure.rule}`"]
    lines += [f"- Files: `{figure.path}`"]
    lines += [f"- In Python: `{IN_PYTHON[figure.id]}`"] if figure.id in IN_PYTHON else []
    svg = next(path for path in figure.paths(["{lift}"]) if path.endswith(".svg"))
    return "\n".join([*lines, f"\n<!-- picture: {svg} -->\n"])


if __name__ == "__main__":
    docs = Path(__file__).resolve().parents[1]
    write_text(docs / PAGE, page(docs.parent))
