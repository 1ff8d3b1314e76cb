"""A law that is proposed, over the missing force, and how the error falls; a static curve between linear filters."""

import numpy as np
import scipy
from matplotlib.figure import Figure

from lumbar.base.templates import in_print
from lumbar.publishing.figures.comparison_figures import draw_error_bars
from lumbar.publishing.figures.palette import SERIES
from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    head_room,
    house_style,
    label_panels,
    new_figure,
    say_instead,
)
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.law.block_structure import BlockStructure, Filter
from lumbar.tissue.diagnosis.law.proposal import Proposal
from lumbar.tissue.diagnosis.law.surface import Coordinate, Surface
from lumbar.tissue.diagnosis.selection.verdict import Verdict
from lumbar.tissue.models.model_data import unit_of
from lumbar.tissue.models.motion import JoinedMotions

_CELLS = (24, 12)
_SECTIONS = (0.1, 0.5, 0.9)
"""Quantiles of the second coordinate about which the sections are taken."""
_WIDTH = 0.08
"""Share of the samples on either side that a section takes in."""
_FEWEST = 5
"""Samples of a cell that is drawn."""
_LOOKS = (("o", "-"), ("s", (0, (4, 1.5))), ("^", (0, (1, 1))))


@house_style
def law_figure(proposal: Proposal) -> Figure:
    """Draw the missing force as a map and in sections, and the errors of base, catalogue, law and noise.

    Parameters
    ----------
    proposal : Proposal
        With surfaces: something is missing.
    """
    figure, (plane, sections, errors) = new_figure(DOUBLE_COLUMN, 2.8, ncols=3)
    surface, unit = proposal.surfaces[0], proposal.experiment.output_unit
    _draw_map(figure, plane, surface, proposal)
    _draw_sections(sections, surface, _added(proposal), proposal)
    _draw_errors(errors, proposal)
    label_panels((plane, sections, errors))
    for axis in (plane, sections):
        axis.set_xlabel(_label(surface.first, proposal))
    sections.set_ylabel(f"Missing force ({unit})")
    return figure


def _label(place: Coordinate, proposal: Proposal) -> str:
    unit = unit_of(place.unit, proposal.experiment.input_unit, proposal.experiment.output_unit)
    return f"{place.words.capitalize()} ({unit})"


def _added(proposal: Proposal) -> np.ndarray | None:
    """What the model with the law gives more than that without it, over all samples that count."""
    if proposal.law is None:
        return None
    records = (proposal.experiment.training, *proposal.experiment.tests)
    before, after = proposal.start.fit, proposal.law.fit
    return np.concatenate(
        [item.trim(after.simulate(item.motion) - before.simulate(item.motion)) for item in records]
    )


def _means(values: np.ndarray, force: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Mean force between edges; NaN where samples are few."""
    cell = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    count = np.bincount(cell, minlength=len(edges) - 1)
    total = np.bincount(cell, force, minlength=len(edges) - 1)
    return np.where(count >= _FEWEST, total / np.maximum(count, 1), np.nan)


def _edges(values: np.ndarray, cells: int) -> np.ndarray:
    low, high = np.quantile(values, [0.005, 0.995])
    return np.linspace(low, high, cells + 1)


def _draw_map(figure, axis, surface: Surface, proposal: Proposal) -> None:
    first, second = surface.values
    columns, rows = _edges(first, _CELLS[0]), _edges(second, _CELLS[1])
    row = np.searchsorted(rows, second, side="right") - 1
    mean = np.array(
        [_means(first[row == one], surface.force[row == one], columns) for one in range(_CELLS[1])]
    )
    largest = np.nanmax(np.abs(mean))
    drawn = axis.pcolormesh(columns, rows, mean, cmap="Greys", vmin=-largest, vmax=largest, rasterized=True)
    middle = [(edges[1:] + edges[:-1]) / 2 for edges in (columns, rows)]
    axis.contour(*middle, np.ma.masked_invalid(mean), levels=[0.0], colors=SERIES[3], linewidths=0.8)
    bar = figure.colorbar(drawn, ax=axis, location="top", shrink=0.9)
    bar.set_label(f"Missing force ({proposal.experiment.output_unit}), line at 0", size=7)
    axis.set_ylabel(_label(surface.second, proposal))
    axis.grid(visible=False)
    axis.patch.set(hatch="///", edgecolor="#bbbbbb")  # where nothing was measured


def _draw_sections(axis, surface: Surface, added: np.ndarray | None, proposal: Proposal) -> None:
    first, second = surface.values
    edges = _edges(first, _CELLS[0])
    middle = (edges[1:] + edges[:-1]) / 2
    ranks = np.argsort(np.argsort(second)) / len(second)
    symbol = surface.second.symbol
    for quantile, (marker, line), color in zip(_SECTIONS, _LOOKS, SERIES, strict=False):
        inside = np.abs(ranks - quantile) <= _WIDTH
        label = f"${symbol}$ ≈ {_short(float(np.median(second[inside])))}"
        measured = _means(first[inside], surface.force[inside], edges)
        axis.plot(middle, measured, marker, color=color, markersize=2.5, label=label)
        if added is not None:
            law = _means(first[inside], added[inside], edges)
            axis.plot(middle, law, linestyle=line, color=color, linewidth=1)
    told = "marks: measured" + ("" if added is None else ", lines: the law")
    head_room(axis, 0.4)
    close = {"ncols": 3, "columnspacing": 0.6, "handletextpad": 0.1}
    axis.legend(loc="upper center", title=told, title_fontsize=6, fontsize=6, **close)


def _short(value: float) -> str:
    return in_print(f"{value:.0f}" if abs(value) >= 100 else f"{value:.2g}")


def _draw_errors(axis, proposal: Proposal) -> None:
    rows = [(proposal.base.fit.structure.base.name, proposal.base)]
    if proposal.before.effects:
        rows.append(("with the catalogue", proposal.before))
    if proposal.law is not None:
        on = proposal.law.start.effects
        rows.append(("catalogue and law" if on else "base and law", proposal.law.candidate))
    floor = proposal.experiment.floor
    errors = {"training": [item.train_rms for _, item in rows], "unseen": [item.test_rms for _, item in rows]}
    draw_error_bars(
        axis,
        errors,
        lambda values: [f"{value:#.2g}" for value in values],
        None if floor is None else floor.rms,
    )
    axis.set_ylim(0, 1.35 * axis.get_ylim()[1])
    axis.set_xticks(range(len(rows)), [name.replace(" ", "\n", 1) for name, _ in rows])
    axis.set_ylabel(f"RMS of the simulation error ({proposal.experiment.output_unit})")
    axis.legend(loc="upper center", ncols=2)


_LINES, _DECADES = 400, 3
_DRAWN = 400
_BARS = 40


@house_style
def linear_figure(found: Verdict) -> Figure:
    """Draw a verdict's linear dynamics of higher order: gain and phase beside those of base and record, and its poles.

    All three responses are cross spectra of force and motion over the motion's own spectrum (Welch's estimate), so that its bias
    is the same, at the frequencies where the training record moves.
    """
    part = max(found.experiment.training.records, key=lambda item: item.size)
    rate, unit = 1 / part.motion.sampling_time, found.experiment.output_unit
    drawn = {
        "measured": part.force,
        "base": found.base.fit.simulate(part.motion),
        "linear dynamics": found.linear.fit.simulate(part.motion),
    }
    settings = {"fs": rate, "nperseg": len(part.own(part.force)) // _SEGMENTS}
    position = part.own(part.motion.position)
    frequency, power = scipy.signal.csd(position, position, **settings)
    moved = np.flatnonzero(np.abs(power) > _MOVED * np.abs(power).max())
    moved = moved[moved > 0]
    figure, (gain, phase, plane) = new_figure(DOUBLE_COLUMN, 2.4, ncols=3)
    for (label, force), color in zip(drawn.items(), SERIES, strict=False):
        response = scipy.signal.csd(position, part.own(force), **settings)[1][moved] / power[moved].real
        look = {"color": color, "label": label, "linestyle": "" if label == "measured" else "-"}
        look["marker"], look["markersize"] = "." if label == "measured" else "", 2
        gain.loglog(frequency[moved], np.abs(response), **look)
        phase.semilogx(frequency[moved], np.degrees(np.unwrap(np.angle(response))), **look)
    poles = poles_of(found.linear.fit)
    plane.plot(poles.real, poles.imag, "x", color=SERIES[2])
    for axis, words in ((gain, f"Gain ({unit}/{found.experiment.input_unit})"), (phase, "Phase (°)")):
        axis.set_xlabel("Frequency (Hz)")
        axis.set_ylabel(words)
    plane.set_xlabel("Real part of the poles (1/s)")
    plane.set_ylabel("Imaginary part (1/s)")
    head_room(gain, 0.3)
    gain.legend(loc="upper left", fontsize=6)
    label_panels((gain, phase, plane))
    return figure


_SEGMENTS, _MOVED = 2, 1e-5
"""Segments of a spectral estimate; power of the motion beside its largest, below which nothing is told."""


def poles_of(fit: Fit) -> np.ndarray:
    """Poles (1/s) of linear dynamics of higher order, from the rates and pairs that are its base's nonlinear parameters."""
    values = dict(zip((item.name for item in fit.structure.base.nonlinear), fit.nonlinear, strict=False))
    found = [complex(-value) for name, value in values.items() if name.startswith("relaxation_rate")]
    for name, damping in values.items():
        if name.startswith("pair_damping"):
            found += [*np.roots([1.0, damping, values[name.replace("damping", "frequency_squared")]])]
    return np.array(found, complex)


@house_style
def chain_figure(found: Verdict) -> Figure:
    """Draw a verdict's chain in the order in which a signal passes it: filter, curve, filter."""
    chain, experiment = found.chain, found.experiment
    figure, (front, curve, back) = new_figure(DOUBLE_COLUMN, 2.4, ncols=3)
    _draw_filter(front, chain.front, chain.sampling_time, "in front")
    _draw_filter(back, chain.back, chain.sampling_time, "behind")
    _draw_curve(curve, chain, found)
    label_panels((front, curve, back))
    before = f"{'' if chain.front.is_static else 'filtered '}{experiment.input_quantity}"
    after = f"{'' if chain.back.is_static else 'unfiltered '}{experiment.output_quantity}"
    curve.set_xlabel(f"{before.capitalize()} ({experiment.input_unit})")
    curve.set_ylabel(f"{after.capitalize()} ({experiment.output_unit})")
    return figure


def _draw_filter(axis, filter_: Filter, step: float, place: str) -> None:
    axis.set_xlabel("Frequency (Hz)")
    axis.set_ylabel(f"Gain of the filter {place}")
    if filter_.is_static:
        say_instead(axis, f"no filter {place}")
        return
    highest = 0.5 / step
    frequency = np.geomspace(highest / 10**_DECADES, highest, _LINES)
    axis.loglog(frequency, np.abs(filter_.response(2 * np.pi * frequency * step)), color=SERIES[0])


def _draw_curve(axis, chain: BlockStructure, found: Verdict) -> None:
    motion = found.experiment.training.motion
    parts = motion.parts if isinstance(motion, JoinedMotions) else (motion,)
    inner = np.concatenate([chain.front.apply(part.position) for part in parts])
    low, high = chain.curve.knots[[0, -1]]
    drawn = np.linspace(low, high, _DRAWN)
    count, edges = np.histogram(inner, _BARS)
    values = chain.curve.apply(drawn)
    height = 0.25 * np.ptp(values) * count / count.max()
    axis.bar(
        edges[:-1],
        height,
        np.diff(edges),
        values.min(),
        align="edge",
        color="#cccccc",
        label="training data",
    )
    axis.plot(drawn, values, color=SERIES[3], label="curve")
    side = "right" if values[-1] > values[0] else "left"  # beside the curve, above the bars
    axis.legend(loc=f"lower {side}", bbox_to_anchor=(float(side == "right"), 0.25))
