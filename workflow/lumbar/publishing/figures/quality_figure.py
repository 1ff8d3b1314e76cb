"""Picture of a quality sheet: heights of the landmarks, and when each marker was not seen or cannot be a body's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from lumbar.lifting.quality.landmarks import landmarks
from lumbar.lifting.quality.sheet import QualitySheet
from lumbar.lifting.quality.trajectories import LABORATORY_M
from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    MEASURED,
    SERIES,
    house_style,
    new_figure,
    say_instead,
)
from lumbar.records.stretches import runs

_DRAWN = {
    "C7": ("C7", "T1"),
    "sternum": ("MANUBRIUM", "XIPHOID"),
    "pelvis": ("SACRUM", "L_PSIS", "R_PSIS", "L5"),
    "right wrist": ("R_WRIST",),
    "left wrist": ("L_WRIST",),
    "right foot": ("R_HEEL", "R_ANKLE", "R_TOE"),
    "left foot": ("L_HEEL", "L_ANKLE", "L_TOE"),
    "box": tuple(f"BOX_{number}" for number in range(1, 9)),
}
"""What is drawn: the first of these landmarks that a file holds."""
_STYLES = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (5, 1, 1, 1)))
_GAP = "#bbbbbb"
_FINDING = "#D55E00"
_WHOLE = 0.98
_MOST_ROWS = 40


@house_style
def quality_figure(
    sheet: QualitySheet, points: dict[str, np.ndarray], time: np.ndarray, meant: dict[str, str]
) -> Figure:
    """Draw heights over time, and below them one row per marker with gaps or findings.

    Parameters
    ----------
    points : dict of str to ndarray, shape (n_frames, 3)
        Measured markers by the file's labels; metres, z up.
    time : ndarray, shape (n_frames,)
        Seconds.
    meant : dict of str to str
        Standard name to label, by a laboratory's aliases.
    """
    rows = _rows(sheet)
    figure, axes = new_figure(
        DOUBLE_COLUMN,
        2.9 + 0.14 * max(len(rows), 3),
        nrows=2,
        sharex=True,
        height_ratios=[2.2, 0.14 * max(len(rows), 3)],
    )
    _heights(axes[0], sheet, points, time, meant)
    _stretches(axes[1], sheet, points, time, rows)
    axes[1].set(xlabel="Time (s)", xlim=(float(time[0]), float(time[-1]) + 1 / sheet.rate_Hz))
    whole = [str(finding.kind) for finding in sheet.findings if not finding.markers]
    title = f"{Path(sheet.file).name}: {len(sheet.markers)} markers, {sheet.rate_Hz:g} Hz"
    figure.suptitle(title + (f"; {', '.join(whole)}!" if whole else ""), x=0.01, ha="left", fontweight="bold")
    return figure


def _rows(sheet: QualitySheet) -> list[str]:
    """Return the markers with findings, then those with gaps, longest first."""
    found = [label for finding in sheet.findings for label in finding.markers]
    return list(dict.fromkeys([*found, *(gap.marker for gap in sheet.gaps)]))[:_MOST_ROWS]


def _heights(axis, sheet: QualitySheet, points, time, meant) -> None:
    known = landmarks(points, meant)
    for index, (words, names) in enumerate(_DRAWN.items()):
        label = next((known[name] for name in names if name in known), None)
        if label is None:
            continue
        text = words if words == label else f"{words} ({label})"
        color, line = SERIES[index % len(SERIES)], _STYLES[index % len(_STYLES)]
        height = points[label][:, 2]
        with np.errstate(invalid="ignore"):  # one number would flatten all others
            shown = np.where(np.abs(height) < LABORATORY_M, height, np.nan)
        axis.plot(time, shown, color=color, linestyle=line, label=text)
    for finding in sheet.findings:
        if finding.markers and finding.n_frames < _WHOLE * len(time):
            axis.axvspan(
                finding.start_s, finding.start_s + finding.length_s, color=_FINDING, alpha=0.15, lw=0
            )
    for event in sheet.events:
        axis.axvline(event.time, color=MEASURED, linewidth=0.6, linestyle=(0, (1, 2)))
    axis.set_ylabel("Height (m)")
    if axis.lines:
        axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _stretches(axis, sheet: QualitySheet, points, time, rows: list[str]) -> None:
    axis.grid(False)
    axis.set_yticks(range(len(rows)), rows, fontsize=6)
    axis.set_ylim(max(len(rows), 1) - 0.4, -0.6)
    if not rows:
        say_instead(axis, "no gaps, no findings", color="#555555")
        return
    for row, label in enumerate(rows):
        missing = ~np.isfinite(points[label]).all(axis=1)
        bars = [(time[gap.start], (gap.stop - gap.start) / sheet.rate_Hz) for gap in runs(missing)]
        axis.broken_barh(bars, (row - 0.4, 0.8), color=_GAP, linewidth=0)
        for finding in sheet.findings:
            if label in finding.markers:
                bar = [(finding.start_s, finding.length_s)]
                axis.broken_barh(bar, (row - 0.4, 0.8), facecolor=_FINDING, alpha=0.6, linewidth=0)
                middle = finding.start_s + finding.length_s / 2
                axis.text(middle, row, finding.kind, fontsize=5, ha="center", va="center")
    axis.set_title("grey: not seen; orange: cannot be a body's", loc="right", fontsize=6, color="#555555")
