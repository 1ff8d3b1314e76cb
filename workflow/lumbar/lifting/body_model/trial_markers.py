"""Which marker of a file is which landmark, point of a limb, or corner of the box; the others ride on what they fit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lumbar.lifting.quality.landmarks import landmarks
from lumbar.records.markers import MarkerRecording
from lumbar.settings.layout import Alias


def measured_markers(raw: MarkerRecording, aliases: Mapping[str, Alias | None]) -> MarkerRecording:
    """Measured markers under standard names; nothing is derived, and labels without a standard name keep theirs.

    Parameters
    ----------
    raw : MarkerRecording
        Read without aliases, so that every marker has its label in the file.
    aliases : mapping of str to Alias
        Of the laboratory: labels go before the usual meaning, rules (means, points between) are left out.
    """
    meant = {}
    for name, alias in aliases.items():
        choices = alias if isinstance(alias, tuple) else (alias,)
        label = next((choice for choice in choices if isinstance(choice, str) and choice in raw), None)
        if label is not None:
            meant[name] = label
    named = landmarks(raw.positions, meant)
    standard = {label: name for name, label in named.items()}
    positions = {standard.get(label, label): points for label, points in raw.positions.items()}
    return MarkerRecording(raw.name, raw.time, raw.rate, positions, raw.source)


def at_nodes(recording: MarkerRecording, rate: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times and markers at no more than `rate` instants per second: means of the frames about each.

    Parameters
    ----------
    rate : float
        Hertz.

    Returns
    -------
    time : ndarray, shape (n,)
        Seconds; n is even.
    markers : dict of str to ndarray, shape (n, 3)
        NaN where fewer than half of the frames show the marker.
    """
    frames = max(1, int(np.floor(recording.rate / rate + 0.01)))
    nodes = len(recording) // (2 * frames) * 2
    time = recording.time[: nodes * frames].reshape(nodes, frames).mean(axis=1)
    markers = {}
    for name, points in recording.positions.items():
        blocks = points[: nodes * frames].reshape(nodes, frames, 3)
        seen = np.isfinite(blocks).all(axis=2)
        count = seen.sum(axis=1)
        total = np.where(seen[..., None], blocks, 0.0).sum(axis=1)
        enough = 2 * count >= frames
        markers[name] = np.where(enough[:, None], total / np.maximum(count, 1)[:, None], np.nan)
    return time, markers
