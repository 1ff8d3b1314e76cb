"""Where the body model says that a marker is: what its gaps are judged by, in tests and benchmarks."""

import numpy as np

from lumbar.lifting.body_model.fit import BodyFit


def predicted_marker(fit: BodyFit, name: str) -> np.ndarray:
    """Where a marker is, shape (n, 3) in metres: what it showed, and the model's prediction where it did not.

    Across a gap the displacement of the skin that was last seen fades out and the next one in, as a Gauss-Markov process
    goes from one to the other on average.
    """
    measurement = next(m for m in fit.model.measurements if m.name == name and m.observed is not None)
    kept, residual = fit.kept[name], fit.residuals[name]
    predicted = measurement.residual(fit.model.structure, fit.best)[1].value
    phi, frames, seen = fit.noise[name].phi, np.arange(len(kept)), np.flatnonzero(kept)
    if not seen.size:
        return predicted
    before = seen[np.clip(np.searchsorted(seen, frames, side="right") - 1, 0, None)]
    after = seen[np.clip(np.searchsorted(seen, frames), None, len(seen) - 1)]
    back, ahead = np.abs(frames - before), np.abs(after - frames)
    inside = (before < frames) & (after > frames)
    whole = np.where(inside, 1 - phi ** (2.0 * (back + ahead)), 1.0)
    whole = np.maximum(whole, 1e-12)
    early = np.where(inside, (phi**back - phi ** (back + 2.0 * ahead)) / whole, phi**back)
    late = np.where(inside, (phi**ahead - phi ** (ahead + 2.0 * back)) / whole, 0.0)
    late = np.where(~inside & (before > frames), phi**ahead, late)
    bridge = early[:, None] * residual[before] + late[:, None] * residual[after]
    return np.where(kept[:, None], measurement.observed, predicted + bridge)
