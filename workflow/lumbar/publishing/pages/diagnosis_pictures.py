"""Pictures of a diagnosis as files, with figures of its proposed law and linear dynamics."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import scipy
from matplotlib.figure import Figure

from lumbar.base.templates import typeset_minus_signs
from lumbar.publishing.figures.comparison_figures import (
    draw_error_bars,
    ladder_figure,
    record_comparison_figure,
    signature_figure,
)
from lumbar.publishing.figures.location_figures import (
    location_figure,
    spatial_comparison_figure,
    spatial_location_figure,
)
from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    SERIES,
    add_head_room,
    house_style,
    label_panels,
    new_figure,
    save,
)
from lumbar.publishing.pages.html import LOCATION_CAPTION, SPACE_CAPTION
from lumbar.tissue.diagnosis.law.law_validation import motions
from lumbar.tissue.diagnosis.law.proposal import Proposal
from lumbar.tissue.diagnosis.residuals.locate import ResidualReport, axis_reports
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisResult
from lumbar.tissue.diagnosis.selection.sentences import runner_up
from lumbar.tissue.diagnosis.spatial.spatial_reports import SpatialReport
from lumbar.tissue.effects.signature import pictured_form
from lumbar.tissue.models.form import Effect

_CELLS = 24
_SECTIONS = (0.1, 0.5, 0.9)
"""Quantiles of the velocity at the centres of the sections."""
_HALF_WIDTH_SHARE = 0.08
"""Share of all samples that a section has on either side of its centre."""
_MIN_CELL_SAMPLES = 5
"""Least number of samples in a drawn cell."""
_SEGMENTS = 2
"""Number of segments in a spectral estimate."""
_MIN_POWER_SHARE = 1e-5
"""Least power of the motion at drawn frequencies, relative to its largest power."""
_SECTION_STYLES = (("o", "-"), ("s", (0, (4, 1.5))), ("^", (0, (1, 1))))


@house_style
def law_figure(proposal: Proposal) -> Figure:
    """Draw the missing force over the position at three velocities, and the errors of base, catalogue and law with the noise."""
    figure, axes = new_figure(DOUBLE_COLUMN, 2.8, ncols=2)
    _draw_sections(axes[0], proposal)
    _draw_errors(axes[1], proposal)
    label_panels(axes)
    return figure


def _means(values: np.ndarray, force: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the mean force between edges; NaN for few samples."""
    cell = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    count = np.bincount(cell, minlength=len(edges) - 1)
    total = np.bincount(cell, force, minlength=len(edges) - 1)
    return np.where(count >= _MIN_CELL_SAMPLES, total / np.maximum(count, 1), np.nan)


def _draw_sections(axis, proposal: Proposal) -> None:
    """Draw the model's residual and the law's force over the position, for velocities near each quantile."""
    experiment, start = proposal.experiment, proposal.start.fit
    records = [item.drop_whitening() for item in (experiment.training, *experiment.tests)]
    position, velocity = (
        [item.trim(np.concatenate([getattr(motion, name) for motion in motions(item)])) for item in records]
        for name in ("position", "velocity")
    )
    position, velocity = np.concatenate(position), np.concatenate(velocity)
    missing = np.concatenate([-start.errors(item) for item in records])
    law = None if proposal.law is None else proposal.law.fit
    added = law and np.concatenate(
        [item.trim(law.simulate(item.motion) - start.simulate(item.motion)) for item in records]
    )
    edges = np.linspace(*np.quantile(position, [0.005, 0.995]), _CELLS + 1)
    middle = (edges[1:] + edges[:-1]) / 2
    ranks = np.argsort(np.argsort(velocity)) / len(velocity)
    for quantile, (marker, line), color in zip(_SECTIONS, _SECTION_STYLES, SERIES, strict=False):
        inside = np.abs(ranks - quantile) <= _HALF_WIDTH_SHARE
        typical = float(np.median(velocity[inside]))
        label = f"$v$ ≈ {typeset_minus_signs(f'{typical:.0f}' if abs(typical) >= 100 else f'{typical:.2g}')}"
        measured = _means(position[inside], missing[inside], edges)
        axis.plot(middle, measured, marker, color=color, markersize=2.5, label=label)
        if added is not None:
            of_law = _means(position[inside], added[inside], edges)
            axis.plot(middle, of_law, linestyle=line, color=color, linewidth=1)
    axis.set(xlabel=f"Position ({experiment.input_unit})", ylabel=f"Missing force ({experiment.output_unit})")
    title = f"marks: measured{'' if added is None else ', lines: the law'}; $v$ in {experiment.input_unit}/s"
    add_head_room(axis, 0.4)
    close = {"ncols": 3, "columnspacing": 0.6, "handletextpad": 0.1}
    axis.legend(loc="upper center", title=title, title_fontsize=6, fontsize=6, **close)


def _draw_errors(axis, proposal: Proposal) -> None:
    rows = [(proposal.base.fit.structure.base.name, proposal.base)]
    if proposal.before.effects:
        rows.append(("with the catalogue", proposal.before))
    if proposal.law is not None:
        start = "catalogue" if proposal.law.start.effects else "base"
        rows.append((f"{start} and law", proposal.law.candidate))
    floor = proposal.experiment.floor
    train, test = [item.train_rms for _, item in rows], [item.test_rms for _, item in rows]
    texts = [f"{value:#.2g}" for value in [*train, *test]]
    draw_error_bars(
        axis, {"training": train, proposal.experiment.test_data: test}, texts, floor and floor.rms
    )
    axis.set_ylim(0, 1.35 * axis.get_ylim()[1])
    axis.set_xticks(range(len(rows)), [name.replace(" ", "\n", 1) for name, _ in rows])
    axis.set_ylabel(f"RMS of the simulation error ({proposal.experiment.output_unit})")
    axis.legend(loc="upper center", ncols=2)


@house_style
def linear_figure(diagnosis: DiagnosisResult) -> Figure:
    """Draw the linear dynamics of higher order with base and record: gain, phase and poles.

    All three responses are Welch estimates (cross spectrum of force and motion divided by the motion's spectrum) at the
    frequencies of the training record's motion, so that they have equal bias.
    """
    part = max(diagnosis.experiment.training.records, key=lambda item: item.size)
    rate, unit = 1 / part.motion.sampling_time, diagnosis.experiment.output_unit
    drawn = {
        "measured": part.force,
        "base": diagnosis.base.fit.simulate(part.motion),
        "linear dynamics": diagnosis.linear.fit.simulate(part.motion),
    }
    settings = {"fs": rate, "nperseg": len(part.drop_history(part.force)) // _SEGMENTS}
    position = part.drop_history(part.motion.position)
    frequency, power = scipy.signal.csd(position, position, **settings)
    moved = np.flatnonzero(np.abs(power) > _MIN_POWER_SHARE * np.abs(power).max())
    moved = moved[moved > 0]
    figure, (gain, phase, plane) = new_figure(DOUBLE_COLUMN, 2.4, ncols=3)
    for (label, force), color in zip(drawn.items(), SERIES, strict=False):
        response = (
            scipy.signal.csd(position, part.drop_history(force), **settings)[1][moved] / power[moved].real
        )
        look = {"color": color, "label": label, "linestyle": "" if label == "measured" else "-"}
        look["marker"], look["markersize"] = "." if label == "measured" else "", 2
        gain.loglog(frequency[moved], np.abs(response), **look)
        phase.semilogx(frequency[moved], np.degrees(np.unwrap(np.angle(response))), **look)
    # The poles (1/s) are rates and pairs among the nonlinear parameters of the linear base.
    fit = diagnosis.linear.fit
    values = dict(zip((item.name for item in fit.structure.base.nonlinear), fit.nonlinear, strict=False))
    poles = [complex(-value) for name, value in values.items() if name.startswith("relaxation_rate")]
    for name, damping in values.items():
        if name.startswith("pair_damping"):
            poles += [*np.roots([1.0, damping, values[name.replace("damping", "frequency_squared")]])]
    plane.plot(np.real(poles), np.imag(poles), "x", color=SERIES[2])
    gain.set(xlabel="Frequency (Hz)", ylabel=f"Gain ({unit}/{diagnosis.experiment.input_unit})")
    phase.set(xlabel="Frequency (Hz)", ylabel="Phase (°)")
    plane.set(xlabel="Real part of the poles (1/s)", ylabel="Imaginary part (1/s)")
    add_head_room(gain, 0.3)
    gain.legend(loc="upper left", fontsize=6)
    label_panels((gain, phase, plane))
    return figure


def draw_pictures(
    diagnosis: DiagnosisResult,
    reports: Sequence[ResidualReport | SpatialReport],
    catalogue: dict[str, Effect],
    folder: Path,
    source_label: str,
) -> dict[str, Path]:
    """Write ``comparison``, ``location``, ``ladder``, ``signatures``, and, if the diagnosis has them, ``proposed_law`` and
    ``linear_dynamics``.

    The SVG files, written to `folder` with the origin of the data (`source_label`), are returned by caption. `diagnosis`
    has path, ranking, law and linear dynamics; `reports` are those of the base model; `catalogue` is of one axis, along
    which signatures are drawn.
    """
    simulated, base = axis_reports(reports), diagnosis.base.fit.structure.base
    # The record of whose output the model explains the smallest share.
    shown = min(simulated, key=lambda item: item.comparison.vaf.value)
    whole = next(report for report in reports if shown in report.axes)
    trained = next(item for item in reports if item.record.name == diagnosis.experiment.floor_from)
    if isinstance(trained, SpatialReport):
        location = SPACE_CAPTION
        figures = {
            "comparison": spatial_comparison_figure(whole, base.name),
            "location": spatial_location_figure(trained),
        }
    else:
        comparisons, location = [item.comparison for item in simulated], LOCATION_CAPTION
        figures = {
            "comparison": record_comparison_figure(shown.record, shown.values, comparisons, base.name),
            "location": location_figure(trained.location),
        }
    figures["ladder"] = ladder_figure(diagnosis.path, diagnosis.experiment)
    # Signatures of the selected effects and of the runner-up's, or of the latter only.
    second = runner_up(diagnosis)
    names = [*diagnosis.selected, *(second.candidate.effects if second is not None else ())]
    effects = [catalogue[name] for name in dict.fromkeys(names) if name in catalogue]
    drawn = [effect for effect in effects if pictured_form(effect) is not None]
    figures["signatures"] = signature_figure(drawn, base.system)
    if diagnosis.proposal is not None and diagnosis.proposal.law is not None:
        figures["proposed_law"] = law_figure(diagnosis.proposal)
    if diagnosis.linear is not None:
        figures["linear_dynamics"] = linear_figure(diagnosis)
    for name, figure in figures.items():
        save(figure, folder / name, "" if name == "signatures" else source_label)
    captions = {
        "comparison": f"The {base.name} model with {whole.record.name}, the record it explains least, and what it leaves "
        "of every record.",
        "location": f"Where the {base.name} model fails on {trained.record.name}. {location}",
        "ladder": f"Error in training and on {diagnosis.experiment.test_data}, effect by effect, down to the noise floor.",
        "signatures": "Signature of the selected effects and of the runner-up, each in its first form on a standard motion: "
        "force over position, added force at two rates and over time; arbitrary units.",
        "proposed_law": "The missing force over the position at three speeds, the proposed law (lines), and the "
        "errors without and with it.",
        "linear_dynamics": "The linear dynamics of higher order with base and record: gain and phase (Welch's estimate "
        "from the same motion), and the poles.",
    }
    return {captions[name]: folder / f"{name}.svg" for name in figures}
