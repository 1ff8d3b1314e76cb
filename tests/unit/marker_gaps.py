"""How much of a marker recording is missing, for tests."""

from __future__ import annotations

import numpy as np

from lumbar.records.markers import MarkerRecording


def missing_share(recording: MarkerRecording) -> float:
    """Share of samples in which a marker was not seen, over all markers."""
    return float(np.mean([np.isnan(points[:, 0]).mean() for points in recording.positions.values()]))
