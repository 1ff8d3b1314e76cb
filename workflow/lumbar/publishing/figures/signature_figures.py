"""Signatures of effects: what their force looks like over position and over time, from their definitions."""

from __future__ import annotations

import numpy as np

from lumbar.publishing.figures.style import DOUBLE_COLUMN, SERIES, house_style, new_figure, svg_text
from lumbar.tissue.effects.signature import RATES, Signature, pictured_form, signatures
from lumbar.tissue.models.form import Effect

_SHOWN = 8.0
"""Seconds shown over time."""
_BASE = {"color": "#999999", "linestyle": (0, (4, 1.5)), "linewidth": 1.0}


_AXES = {"tissue": ("Position", "force"), "pendulum": ("Angle", "moment")}


@house_style
def signature_figure(effects: list[Effect], system: str = "tissue"):
    """Draw one row per effect: force over position, added force over position at two rates, added force over time.

    Parameters
    ----------
    effects : list of Effect
        Each is drawn in the form of `lumbar.tissue.effects.signature.pictured_form`.
    system : str
        What they are effects of: ``tissue`` or ``pendulum``.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure, axes = new_figure(
        DOUBLE_COLUMN, 0.25 + 1.75 * len(effects), nrows=len(effects), ncols=3, squeeze=False
    )
    for row, effect in zip(axes, effects, strict=True):
        _draw_effect(row, effect, system)
    return figure


@house_style
def signature_thumbnail(effect: Effect, system: str = "tissue") -> str:
    """Small picture of one effect: force over position on a standard motion, with it and without, as the text of an SVG."""
    form = pictured_form(effect)
    slow, _ = signatures(effect, form, system)
    figure, axes = new_figure(2.2, 1.4)
    cycle = _last_cycle(slow, RATES[0])
    axes.plot(slow.motion.position[cycle], slow.base[cycle], **_BASE)
    axes.plot(slow.motion.position[cycle], slow.force[cycle], color=SERIES[3], linewidth=1.2)
    axes.set_xlabel(_AXES[system][0])
    axes.set_ylabel(_AXES[system][1].capitalize())
    axes.set_xticks([])
    axes.set_yticks([])
    return svg_text(figure)


def _draw_effect(row, effect: Effect, system: str) -> None:
    form = pictured_form(effect)
    slow, fast = signatures(effect, form, system)
    moved, response = _AXES[system]
    whole, added, course = row
    settled, cycle = slow.motion.time >= 2 / RATES[0], _last_cycle(slow, RATES[0])
    whole.plot(slow.motion.position[cycle], slow.base[cycle], label=system, **_BASE)
    whole.plot(slow.motion.position[settled], slow.force[settled], color=SERIES[0], label="with the effect")
    whole.set_ylabel(response.capitalize())
    whole.set_title(effect.name.replace("_", " "), loc="left", fontweight="bold")
    styles = ((slow, RATES[0], SERIES[0], "-"), (fast, RATES[1], SERIES[3], (0, (3, 1))))
    for item, rate, color, line in styles:
        kept = _last_cycle(item, rate)
        added.plot(
            item.motion.position[kept],
            item.added[kept],
            color=color,
            linestyle=line,
            linewidth=1.0,
            label=f"{rate:g} Hz",
        )
    added.set_ylabel(f"Added {response}")
    added.set_title(f"${form.latex}$", loc="left")
    for axis in (whole, added):
        axis.set_xlabel(moved)
    _draw_course(course, slow, moved.lower(), response)
    for axis in row:
        _room(axis)
        axis.legend(
            loc="upper left", ncols=2, handlelength=1.4, columnspacing=0.8, borderpad=0.1, fontsize=6.5
        )
        axis.tick_params(labelsize=6.5)


def _last_cycle(item: Signature, rate: float) -> np.ndarray:
    """Samples of the motion's last cycle, its end included."""
    return np.arange(len(item.motion)) >= len(item.motion) - 1 - round(1 / (rate * item.motion.sampling_time))


def _draw_course(axis, item: Signature, moved: str, response: str) -> None:
    shown = item.motion.time <= _SHOWN
    scale = np.abs(item.added[shown]).max() / np.abs(item.motion.position).max()
    axis.plot(item.motion.time[shown], scale * item.motion.position[shown], label=f"{moved}, scaled", **_BASE)
    axis.plot(
        item.motion.time[shown], item.added[shown], color=SERIES[0], linewidth=1.0, label=f"added {response}"
    )
    axis.set_xlabel("Time (s)")


def _room(axis) -> None:
    bottom, top = axis.get_ylim()
    axis.set_ylim(bottom, top + 0.22 * (top - bottom))
