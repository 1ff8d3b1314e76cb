"""Pages of `lumbar compare` and `lumbar locate`: what a model makes of every record, and where it fails."""

from __future__ import annotations

from pathlib import Path

from lumbar.publishing.pages.html import document, figure, heading, listing, paragraph, table
from lumbar.tissue.diagnosis.residuals.locate import ResidualReport, all_records_sentence


def comparison_page(simulated: list[ResidualReport], model: str, data: str, pictures: dict[str, Path]) -> str:
    """Return the page of a comparison; `pictures` are SVG files by record."""
    blocks = [
        paragraph(
            "Free-run simulation against every record. Error intervals: what another excitation of the same kind would give."
        ),
        *comparison_blocks(simulated),
    ]
    for item in simulated:
        name = item.record.name
        caption = f"{name}: measured and simulated, residual, and what is left of every record."
        blocks.append(figure(pictures[name], caption))
    return document(f"The {model} model against every record", data, blocks)


def comparison_blocks(simulated: list[ResidualReport]) -> list[str]:
    """Sentences and figures of merit of every record."""
    unit = simulated[0].comparison.unit
    rows = []
    for found in (item.comparison for item in simulated):
        errors = (
            f"{it.value:.4g} ({it.low:.4g} to {it.high:.4g})" for it in (found.vaf, found.fit, found.rms)
        )
        noise = ("unknown", "unknown")
        if found.floor is not None:
            noise = (f"{found.floor.rms:.4g}", f"{found.explainable_rms:.4g}")
        rows.append((found.record, *errors, *noise))
    head = ("record", "VAF (%)", "FIT (%)", f"RMS error ({unit})", f"noise ({unit})", f"explainable ({unit})")
    return [listing(item.comparison.sentence for item in simulated), table(head, rows)]


def location_page(simulated: list[ResidualReport], model: str, data: str, pictures: dict[str, Path]) -> str:
    """Return the page that says and shows where a model fails; parameters as for `comparison_page`."""
    blocks = []
    for item in simulated:
        name = item.record.name
        headline, *sentences = item.location.sentences
        blocks += [
            heading(name),
            paragraph(headline, "headline"),
            listing(sentences),
            figure(pictures[name], LOCATION_CAPTION),
        ]
    told = paragraph(all_records_sentence([item.location for item in simulated]), "headline")
    return document(f"Where the {model} model fails", data, [told, *blocks])


LOCATION_CAPTION = (
    "(a) Error along time, by period where the record repeats; (b) in every cycle of the motion; (c) over frequency against "
    "the noise; (d) over depth; (e) around reversals; (f) over position and velocity; (g) its autocorrelation; its "
    "correlation with the input and odd functions of it (h) and with even functions (i). Grey: 95 % limits of noise alone."
)
