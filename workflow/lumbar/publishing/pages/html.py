"""Building blocks of a page by macros of ``page.html.jinja`` (which escape texts, but not blocks), and the pages of
`lumbar compare` and `lumbar locate`: a model's errors on every record, and their locations."""

import base64
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup

from lumbar.base.formats import format_number
from lumbar.base.templates import template
from lumbar.tissue.diagnosis.residuals.locate import (
    ResidualReport,
    all_reports_sentence,
    axis_reports,
    expand_axes,
)
from lumbar.tissue.models.printing import equation_mathml

if TYPE_CHECKING:
    from lumbar.tissue.diagnosis.spatial.spatial_reports import SpatialReport

PAGE = "publishing/pages/page.html.jinja"
LOCATION_CAPTION = (
    "(a) Error along time, by period where the record repeats; (b) over depth; (c) around reversals. "
    "Grey: 95 % limits of noise alone."
)
SPACE_CAPTION = (
    "Above: the path, seen along every axis, wider and darker where the error is larger. Below, over the direction of "
    "travel: the error (RMS), and its mean along the travel, positive where the tissue resists more than the model. Cells "
    "of the sphere have one size; white ones were hardly visited."
)


def _macros():
    return template(PAGE).make_module({"title": "", "source_label": "", "blocks": ()})


def heading(text: str, level: int = 2) -> Markup:
    """Return a heading."""
    return _macros().heading(text, level)


def paragraph(text: str, kind: str = "") -> Markup:
    """Return a paragraph; `kind` is a class of the page's style: ``headline`` or ``note``."""
    return _macros().paragraph(text, kind)


def summary(
    chip: tuple[str, str], sentence: str, steps: Iterable[tuple[str, str, float]], noise: float | None
) -> Markup:
    """Return a verdict and its error ladder.

    The `chip` has a few words and a colour of the page's style, `steps` have name, value and length in percent; `noise` is the
    place of the noise floor in percent.
    """
    return _macros().summary(*chip, sentence, steps, noise)


def fold(title: str, blocks: Iterable[Markup], is_open: bool = False) -> Markup:
    """Return blocks that can be folded under their title."""
    return _macros().fold(title, blocks, is_open)


def listing(lines: Iterable[str]) -> Markup:
    """Return a bulleted list."""
    return _macros().listing(lines)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Markup:
    """Return a table of texts and pictures."""
    return _macros().table(head, rows)


def equation(latex: str) -> Markup:
    """Return an equation that scrolls if it is too long, because browsers do not break it into lines."""
    return Markup(f'<span class="equation" tabindex="0">{equation_mathml(latex)}</span>')


def figure(svg: Path, caption: str) -> Markup:
    """Return a picture with a caption."""
    return _macros().figure(base64.b64encode(svg.read_bytes()).decode("ascii"), caption)


def document(title: str, source_label: str, blocks: Iterable[Markup]) -> str:
    """Return a whole page of blocks; `source_label` is the origin of the data, empty for pages without data."""
    return template(PAGE).render(title=title, source_label=source_label, blocks=blocks)


Reports = Sequence["ResidualReport | SpatialReport"]
"""Reports of one model on every record."""


def comparison_page(reports: Reports, model: str, source_label: str, pictures: dict[str, Path]) -> str:
    """Return the page of a comparison; `pictures` are SVG files by record."""
    text = "Free-run simulation of every record. Intervals: errors for another excitation of the same kind."
    blocks = [paragraph(text), *comparison_blocks(axis_reports(reports))]
    caption = "measured and simulated, residual, and what is left of every record."
    if reports[0].record.axes:
        caption = "measured and simulated along every axis, over a part of the record, and the residual."
    blocks += [figure(svg, f"{name}: {caption}") for name, svg in pictures.items()]
    return document(f"The {model} model against every record", source_label, blocks)


def comparison_blocks(simulated: list[ResidualReport]) -> list[str]:
    """Return sentences and figures of merit for every record."""
    unit = simulated[0].comparison.unit
    rows = []
    for item in (report.comparison for report in simulated):
        merits = (item.vaf, item.fit, item.rms)
        errors = (
            f"{format_number(one.value, 4)} ({format_number(one.low, 4)} to {format_number(one.high, 4)})"
            for one in merits
        )
        noise = ("unknown", "unknown")
        if item.floor is not None:
            noise = (f"{item.floor.rms:.4g}", f"{item.explainable_rms:.4g}")
        rows.append((item.record, *errors, *noise))
    head = ("record", "VAF (%)", "FIT (%)", f"RMS error ({unit})", f"noise ({unit})", f"explainable ({unit})")
    return [listing(item.comparison.sentence for item in simulated), table(head, rows)]


def location_page(reports: Reports, model: str, source_label: str, pictures: dict[str, Path]) -> str:
    """Return the page of locations; parameters as in `comparison_page`."""
    blocks = [paragraph(all_reports_sentence(reports), "headline")]
    for item in expand_axes(reports):
        name, (headline, *sentences) = item.record.name, item.sentences
        blocks += [
            heading(name),
            paragraph(headline, "headline"),
            listing(sentences),
            figure(pictures[name], SPACE_CAPTION if item.record.axes else LOCATION_CAPTION),
        ]
    return document(f"Where the {model} model fails", source_label, blocks)
