"""Small pictures of effects for the cards of a page: lines of a few hundred points, drawn without a plotting library."""

from xml.sax.saxutils import escape

import numpy as np

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
    bottom, middle = _HEIGHT - _BELOW, (_HEIGHT - _BELOW) / 2
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_WIDTH}" height="{_HEIGHT}" viewBox="0 0 {_WIDTH} {_HEIGHT}" '
        'fill="none" stroke-width="1.5" font-family="DejaVu Sans, Arial, sans-serif" font-size="11" text-anchor="middle">'
        f'<path d="M{_LEFT} 0V{bottom}H{_WIDTH}" stroke="#000000" stroke-width="1"/>'
        f'<path d="{_line(across, without)}" stroke="#999999" stroke-dasharray="5 2"/>'
        f'<path d="{_line(across, within)}" stroke="{SERIES[3]}"/>'
        f'<g fill="#000000"><text x="{(_LEFT + _WIDTH) / 2:g}" y="{_HEIGHT - 6}">{escape(moved)}</text>'
        f'<text transform="translate(13 {middle:g}) rotate(-90)">{escape(response.capitalize())}</text></g></svg>'
    )


def _line(across: np.ndarray, down: np.ndarray) -> str:
    return "M" + " ".join(f"{x:.1f} {y:.1f}" for x, y in zip(across, down, strict=True))
