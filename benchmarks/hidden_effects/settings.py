"""How many experiments the benchmark makes, from which ranges they are drawn, and how they are scored."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

from lumbar.base.errors import Problems
from lumbar.twin.two_hidden_effects import TissueTestRanges


@dataclass(frozen=True)
class HiddenEffectsSettings(TissueTestRanges):
    """Settings of a quick run; ``run.WHOLE`` are those of the whole benchmark."""

    seed: int = 2718
    """Seed of all experiments; each depends on it and on its kind and number."""
    experiments_per_form: int = 1
    """Experiments of each mathematical form of the catalogue's mechanisms."""
    experiments_per_pair: int = 1
    """Experiments of each pair of mechanisms."""
    experiments_per_outside_form: int = 1
    """Experiments of each form of a mechanism that the catalogue does not hold."""
    nulls: int = 20
    """Experiments in which nothing is hidden."""
    slices: int = 4
    """Batches over which one experiment of each form, pair or outside form is spread."""
    nulls_per_batch: int = 10
    """Number of these experiments in one batch."""
    keep_recordings: bool = True
    """True if the recordings are kept after their diagnosis (0.3 MB per experiment)."""
    residual_over_noise: tuple[float, float] = (1.5, 26.0)
    """Range of strengths, even in the logarithm: RMS that the best Kelvin–Boltzmann model leaves of the noise-free
    multisine, over the RMS of the noise."""
    noise_share: tuple[float, float] = (0.005, 0.015)
    """RMS of the noise over that of the force without the effect."""
    noise_colours: dict[str, float] = field(
        default_factory=lambda: {"white": 3.0, "autoregressive": 1.0, "flicker": 1.0}
    )
    """Weights of the colours of the noise."""
    autoregressive_correlation: tuple[float, float] = (0.3, 0.8)
    """Range of the correlation of neighbouring samples of autoregressive noise."""
    strong_residual_over_noise: float = 4.0
    """Residual over noise from which an effect counts as strong in the scores."""
    confidence: float = 0.95
    """Confidence of all intervals of the scores."""

    def __post_init__(self):
        """Refuse ranges that do not run upward, and noise of no colour.

        Raises
        ------
        InputError
            With every wrong key.
        """
        problems = Problems("settings of the benchmark")
        for key in (each.name for each in fields(self)):
            value = getattr(self, key)
            if isinstance(value, tuple) and value[0] > value[1]:
                problems.add(key, f"[{value[0]:g}, {value[1]:g}]", "the smaller value comes first")
        if sum(self.noise_colours.values()) <= 0:
            problems.add("noise_colours", "all weights are 0", "at least one colour must occur")
        problems.raise_if_any()


DRAWN = (
    *(each.name for each in fields(TissueTestRanges)),
    "seed",
    "residual_over_noise",
    "noise_share",
    "noise_colours",
    "autoregressive_correlation",
)
"""Settings that change an experiment; the number of experiments and their scoring do not."""
