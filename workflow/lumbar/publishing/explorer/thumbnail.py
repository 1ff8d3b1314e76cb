"""Small pictures of effects for the cards of a page: lines of a few hundred points, drawn without a plotting library."""

import numpy as np

from lumbar.base.templates import template
from lumbar.publishing.figures.palette import SERIES
from lumbar.tissue.effects.signature import AXES, pictured_form, signatures
from lumbar.tissue.models.form import Effect

_WIDTH, _HEIGHT = 210, 135
_LEFT, _BELOW, _MARGIN = 20, 20, 6
"""Pixels beside the picture for its labels, and around it."""


def signature_thumbnail(effect: Effect, system: str = "tissue") -> str:
    """Force over position on a standard motion, with the effect and without, as the text of an SVG."""
    slow, _ = signatures(effect, pictured_form(effect), system)
    moved, response = AXES[system]
    position, base, force = (
        values[slow.last_cycle] for values in (slow.motion.position, slow.base, slow.force)
    )
    low, high = min(base.min(), force.min()), max(base.max(), force.max())
    across = np.interp(position, (position.min(), position.max()), (_LEFT + _MARGIN, _WIDTH - _MARGIN))
    without, within = (
        np.interp(values, (low, high), (_HEIGHT - _BELOW - _MARGIN, _MARGIN)) for values in (base, force)
    )
    return template("publishing/explorer/thumbnail.svg.jinja").render(
        width=_WIDTH,
        height=_HEIGHT,
        left=_LEFT,
        bottom=_HEIGHT - _BELOW,
        colour=SERIES[3],
        middle=f"{(_LEFT + _WIDTH) / 2:g}",
        without=_line(across, without),
        within=_line(across, within),
        moved=moved,
        response=response.capitalize(),
    )


def _line(across: np.ndarray, down: np.ndarray) -> str:
    return "M" + " ".join(f"{x:.1f} {y:.1f}" for x, y in zip(across, down, strict=True))
