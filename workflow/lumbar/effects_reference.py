"""The catalogue as a page, from the definitions: ``python -m lumbar.effects_reference docs/effects.md``."""

from __future__ import annotations

import sys
from pathlib import Path

from lumbar.effects.catalogue import TISSUE
from lumbar.effects.effect import Effect, Form, Place
from lumbar.files import write_text

_PLACES = {
    Place.INPUT: "on the way from the position to the tissue",
    Place.PARALLEL: "beside the tissue",
    Place.OUTPUT: "on the way from the tissue to the sensor",
}
_SCALES = {
    "position": "half the range of the position",
    "speed": "the largest speed",
    "path": "the path travelled",
    "duration": "the duration",
    "time": "1 s",
    "sampling": "the sampling interval",
    "force": "the largest force",
    "one": "1",
}
_SIGNS = {1: "not negative", -1: "not positive", 0: "any"}
_INTRODUCTION = """# The catalogue of effects

Written by `make docs` from the definitions in `workflow/lumbar/effects/`; do not edit. Position z about the record's zero,
speed v, force F; units: x that of the position, y that of the force.

Pictures: the first form of each effect on a standard motion, a sine of amplitude 1, beside a Kelvin–Boltzmann tissue with
kₑ = k_b = 1 and τ = 0.1 s. Left: force over position without and with the effect at 0.5 Hz. Middle: what the effect adds, at 0.5
and 2 Hz. Right: the same over time. The effect is scaled to a third of the tissue's own force.

"""


def effects_page(pictures: str) -> str:
    """Return the page as Markdown.

    Parameters
    ----------
    pictures : str
        Folder of the pictures, relative to the page.
    """
    listed = "\n".join(f"- [`{name}`](#{name}): {effect.mechanism}" for name, effect in TISSUE.items())
    return _INTRODUCTION + listed + "\n" + "".join(_section(effect, pictures) for effect in TISSUE.values())


def _section(effect: Effect, pictures: str) -> str:
    places = dict.fromkeys(_PLACES[form.place] for form in effect.forms)
    rows = "\n".join(row for form in effect.forms for row in _rows(form))
    forms = "\n".join(f"| `{form.name}` | ${_escaped(form.equation)}$ |" for form in effect.forms)
    return f"""
## {effect.name}
{effect.mechanism} It acts {" or ".join(places)}.

![Signature of {effect.name}]({pictures}/{effect.name}.svg)

| form | equation |
|---|---|
{forms}

| form | parameter | unit | range | starts |
|---|---|---|---|---|
{rows}

Source: {effect.source}. Experiment that shows it: {effect.experiment}.
"""


def _escaped(latex: str) -> str:
    """Vertical bars would end a cell of the table."""
    return latex.replace("|", r"\vert ")


def _rows(form: Form) -> list[str]:
    rows = [
        f"| `{form.name}` | `{item.name}` | {_unit(item.unit)} | {_SIGNS[item.sign]} | solved for |"
        for item in form.amplitudes
    ]
    for item in form.shapes:
        scale = _SCALES[item.scale]
        low, high = item.bounds(1.0)
        starts = (
            "strongest lines of the residual"
            if form.starts
            else f"{item.points} from {item.low:g} to {item.high:g}"
        )
        span = (
            f"within {item.lines:g} lines of the start"
            if item.lines is not None
            else f"{low:.3g} to {high:.3g} × {scale}"
        )
        rows.append(f"| `{form.name}` | `{item.name}` | {_unit(item.unit)} | {span} | {starts} |")
    return rows


def _unit(template: str) -> str:
    return template.replace("{x}", "x").replace("{y}", "y")


def write_reference(page: Path) -> None:
    """Write the page, and its pictures to ``images/effects`` beside it."""
    from lumbar.figures.signatures import signature_figure
    from lumbar.figures.style import save

    for effect in TISSUE.values():
        stem = page.parent / "images" / "effects" / effect.name
        save(signature_figure([effect]), stem, "")
        stem.with_suffix(".pdf").unlink()
    write_text(page, effects_page("images/effects"))


if __name__ == "__main__":
    write_reference(Path(sys.argv[1]))
