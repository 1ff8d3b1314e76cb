"""The catalogues as pages, from the definitions, renewed by ``make docs``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lumbar.base.files import write_text
from lumbar.tables.table_layout import unit_in_print
from lumbar.tissue.effects.catalogue import CATALOGUES
from lumbar.tissue.effects.signature import pictured_form
from lumbar.tissue.models.form import Effect, Form, Place

_SCALES = {
    "position": "half the range of the position",
    "speed": "the largest speed",
    "path": "the path travelled",
    "duration": "the duration",
    "time": "√(sampling interval × duration)",
    "rate": "1/√(sampling interval × duration)",
    "sampling": "the sampling interval",
    "force": "the largest force",
    "one": "1",
}
_SIGNS = {1: "not negative", -1: "not positive", 0: "any"}


@dataclass(frozen=True)
class CataloguePage:
    """Texts of one catalogue's page that do not follow from the definitions."""

    page: str
    """File name without suffix, and folder of its pictures."""
    introduction: str
    places: dict[Place, str]
    """Position of a form in the measuring chain, as text."""


_HEAD = """# {title}

Written by `make docs` from `workflow/lumbar/tissue/effects/`; do not edit. {symbols}. Units: x of the
{moved}, y of the {response}.

Pictures: the first form of each effect with {base}, for a sine of amplitude 1. Left:
{response} over {moved} without and with the effect at 0.5 Hz. Middle: the added {response} at 0.5 and 2 Hz. Right: the
same over time. The effect is scaled to a third of the base's {response}.

"""
REFERENCES = {
    "tissue": CataloguePage(
        "effects",
        _HEAD.format(
            title="The catalogue of effects",
            symbols="Position z about the record's zero, velocity v, acceleration a, path s travelled, time t, force F",
            moved="position",
            response="force",
            base="a Kelvin–Boltzmann tissue with kₑ = k_b = 1 and τ = 0.1 s",
        ),
        {
            Place.INPUT: "between position and tissue",
            Place.PARALLEL: "parallel to the tissue",
            Place.OUTPUT: "between tissue and sensor",
        },
    ),
    "pendulum": CataloguePage(
        "pendulum_effects",
        _HEAD.format(
            title="The pendulum's catalogue of effects",
            symbols="Angle θ from the vertical, its rate v = θ̇, moment M that the person exerts; time t; "
            "step(x) = 3x² − 2x³ from 0 to 1, constant outside; channels h (share of the box held), "
            "ℓ (length) and the pivot's acceleration",
            moved="angle",
            response="moment",
            base="a pendulum of Eq. 4.1",
        ),
        {
            Place.INPUT: "between angle and pendulum",
            Place.PARALLEL: "parallel to the pendulum",
            Place.OUTPUT: "between pendulum and sensor",
        },
    ),
}
"""By system."""


def effects_page(system: str) -> str:
    """Return a catalogue's page as Markdown.

    Parameters
    ----------
    system : str
        ``"tissue"`` or ``"pendulum"``.
    """
    catalogue, reference = CATALOGUES[system], REFERENCES[system]
    listed = ", ".join(f"[`{name}`](#{name})" for name in catalogue)
    sections = (_section(effect, reference) for effect in catalogue.values())
    return f"{reference.introduction}{listed}.\n" + "".join(sections)


def _scaled_constants(form: Form) -> str:
    """Return the values that a fit uses for constants that depend on its records."""
    return "".join(
        f"; in a fit ${item.latex_symbol}$ is {item.value:g} × {_SCALES[item.scale]}"
        for item in form.constants
        if item.scale
    )


def _section(effect: Effect, reference: CataloguePage) -> str:
    places = dict.fromkeys(reference.places[form.place] for form in effect.forms)
    picture = ""
    if pictured_form(effect):
        picture = f"![Signature of {effect.name}](images/{reference.page}/{effect.name}.svg)\n\n"
    rows = "\n".join(_rows_of_forms(effect.forms))
    needed = any(form.channels for form in effect.forms)
    head = "| form | equation | needs |\n|---|---|---|" if needed else "| form | equation |\n|---|---|"
    forms = "\n".join(
        f"| `{form.name}` | ${_escaped(form.latex)}${_scaled_constants(form)} |"
        + (_needs(form) if needed else "")
        for form in effect.forms
    )
    return f"""
## {effect.name}
{effect.mechanism} It acts {" or ".join(places)}.

{picture}{head}
{forms}

| forms | symbol | parameter | unit | range | starts |
|---|---|---|---|---|---|
{rows}

Source: {effect.source}. Best experiment: {effect.experiment}.{" " + effect.sensors if effect.sensors else ""}
"""


def _needs(form: Form) -> str:
    """Return the cell with the columns that a form needs in addition to input and output."""
    return f" {', '.join(f'`{role}`' for role in form.channels) or '–'} |"


def _escaped(latex: str) -> str:
    """Return LaTeX without vertical bars, which would end a cell of the table."""
    return latex.replace("|", r"\vert ")


def _rows_of_forms(forms: Sequence[Form]) -> list[str]:
    """Return the rows of the parameters, one for all forms with the same parameter."""
    names: dict[str, list[str]] = {}
    for form in forms:
        for row in _rows(form):
            names.setdefault(row, []).append(f"`{form.name}`")
    return [f"| {', '.join(having)} | {row} |" for row, having in names.items()]


def _rows(form: Form) -> list[str]:
    """Return the rows of a form's parameters, without the first cell and the bars at both ends."""
    rows = [
        f"${item.latex_symbol}$ | `{item.name}` | {_unit(item.unit)} | {_SIGNS[item.sign]} | solved for"
        for item in form.linear
    ]
    for item in form.nonlinear:
        scale = _SCALES[item.scale]
        low, high = item.bounds(1.0)
        starts = "from the residual" if form.starts else f"{item.points} from {item.low:g} to {item.high:g}"
        span = (
            f"within {item.lines:g} lines of the start"
            if item.lines is not None
            else f"{low:.3g} to {high:.3g} × {scale}"
        )
        rows.append(f"${item.latex_symbol}$ | `{item.name}` | {_unit(item.unit)} | {span} | {starts}")
    return rows


def _unit(template: str) -> str:
    return unit_in_print(template.replace("{x}", "x").replace("{y}", "y"))


def write_reference(folder: Path) -> None:
    """Write every catalogue's page, and its pictures to ``images/<page>`` in the same folder."""
    from lumbar.publishing.figures.comparison_figures import signature_figure
    from lumbar.publishing.figures.style import save

    for system, reference in REFERENCES.items():
        for effect in CATALOGUES[system].values():
            if pictured_form(effect):
                stem = folder / "images" / reference.page / effect.name
                save(signature_figure([effect], system), stem, "")
                stem.with_suffix(".pdf").unlink()
        write_text(folder / f"{reference.page}.md", effects_page(system))


if __name__ == "__main__":
    write_reference(Path(__file__).resolve().parents[1] / "tissue")
