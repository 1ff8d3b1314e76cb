"""Writing a diagnosis: JSON for machines, a page for people, the error ladder as a table."""

from __future__ import annotations

import csv
import html
import io
from pathlib import Path

from lumbar.effects.effect import Effect
from lumbar.files import write_json, write_text
from lumbar.improvement.diagnosis import Diagnosis
from lumbar.improvement.sentences import details, effects_text, headline

LADDER_COLUMNS = ("rung", "effects", "forms", "train_rms", "test_rms", "unit", "noise_floor_rms", "data")


def write_diagnosis(diagnosis: Diagnosis, catalogue: dict[str, Effect], folder: Path, data: str) -> None:
    """Write ``diagnosis.json``, ``diagnosis.html`` and ``ladder.csv``.

    Parameters
    ----------
    diagnosis : Diagnosis
    catalogue : dict of str to Effect
        Where mechanisms and experiments are looked up.
    folder : Path
    data : str
        Where the data come from.
    """
    write_json(folder / "diagnosis.json", {**diagnosis.to_json(), "data": data})
    write_text(folder / "ladder.csv", ladder_csv(diagnosis, data))
    write_text(folder / "diagnosis.html", page(diagnosis, catalogue, data))


def ladder_csv(diagnosis: Diagnosis, data: str) -> str:
    """Return the error ladder: base, base and first effect, …."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(LADDER_COLUMNS)
    floor = diagnosis.experiment.floor
    for rung, item in enumerate(diagnosis.ladder):
        forms = "+".join(form.name for form in item.fit.structure.forms)
        numbers = (repr(item.train_rms), repr(item.test_rms), diagnosis.experiment.output_unit)
        writer.writerow(
            [rung, "+".join(item.effects), forms, *numbers, "" if floor is None else repr(floor.rms), data]
        )
    return stream.getvalue()


def page(diagnosis: Diagnosis, catalogue: dict[str, Effect], data: str) -> str:
    """Return a page of its own: no script, no outside resource."""
    unit = html.escape(diagnosis.experiment.output_unit)
    sentences = "\n".join(f"<p>{html.escape(line)}</p>" for line in details(diagnosis, catalogue))
    return _PAGE.format(
        title=html.escape(f"Diagnosis of the {diagnosis.base.fit.structure.base.name} model"),
        data=html.escape(data),
        verdict=html.escape(diagnosis.verdict),
        headline=html.escape(headline(diagnosis)),
        sentences=sentences,
        unit=unit,
        ladder="\n".join(_ladder_row(item) for item in diagnosis.ladder),
        ranking="\n".join(_ranking_row(item) for item in diagnosis.ranking),
        parameters="\n".join(_parameter_rows(diagnosis)),
        equations="\n".join(_equation_rows(diagnosis)),
    )


def _row(*cells: str) -> str:
    return "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in cells) + "</tr>"


def _ladder_row(item) -> str:
    return _row(
        effects_text(item.effects) if item.effects else "base",
        f"{item.train_rms:.4g}",
        f"{item.test_rms:.4g}",
    )


def _ranking_row(item) -> str:
    forms = ", ".join(form.name for form in item.candidate.fit.structure.forms)
    rms = (f"{item.candidate.train_rms:.4g}", f"{item.candidate.test_rms:.4g}")
    return _row(effects_text(item.candidate.effects), forms, *rms, f"{item.p_value:.2g}")


def _parameter_rows(diagnosis: Diagnosis):
    if not diagnosis.ranking:
        return
    for item in diagnosis.ranking[0].estimates:
        interval = f"{item.low:.4g} to {item.high:.4g}"
        yield _row(
            item.effect.replace("_", " ") or "base", item.name, f"{item.value:.4g}", interval, item.unit
        )


def _equation_rows(diagnosis: Diagnosis):
    structure = diagnosis.model.fit.structure
    yield _row("base", structure.base.name, structure.base.equation)
    for form in structure.forms:
        yield _row(form.effect.replace("_", " "), form.name, form.equation)


_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{title}</title>
<style>
body {{ font-family: "DejaVu Sans", Arial, sans-serif; margin: 2em; max-width: 60em; color: #111; }}
table {{ border-collapse: collapse; font-variant-numeric: tabular-nums; margin-bottom: 1.5em; }}
th, td {{ padding: 0.25em 0.8em; text-align: left; }}
thead tr {{ border-top: 2px solid #111; border-bottom: 1px solid #111; }}
tbody tr:last-child {{ border-bottom: 2px solid #111; }}
.headline {{ font-size: 1.15em; font-weight: bold; }}
</style>
</head>
<body>
<h1>{title}</h1>
<p><b>Data: {data}</b></p>
<p>Verdict: {verdict}</p>
<p class="headline">{headline}</p>
{sentences}
<h2>Error ladder</h2>
<p>Root mean square of the free-run simulation error in {unit}, from 0.5 s on.</p>
<table><thead><tr><th>effects</th><th>training record</th><th>unseen records</th></tr></thead><tbody>
{ladder}
</tbody></table>
<h2>Ranking</h2>
<p>Each set of effects refitted jointly with the base. p: how often the best of all candidates gains as much where
nothing is missing.</p>
<table><thead><tr><th>effects</th><th>forms</th><th>training record</th><th>unseen records</th><th>p</th></tr></thead><tbody>
{ranking}
</tbody></table>
<h2>Parameters of the first in the ranking</h2>
<table><thead><tr><th>of</th><th>parameter</th><th>value</th><th>95 % interval</th><th>unit</th></tr></thead><tbody>
{parameters}
</tbody></table>
<h2>Equations of the model</h2>
<table><thead><tr><th>part</th><th>form</th><th>equation (LaTeX)</th></tr></thead><tbody>
{equations}
</tbody></table>
</body>
</html>
"""
