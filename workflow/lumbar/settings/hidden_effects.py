"""The benchmark of the diagnosis: synthetic tissue tests with an effect that the diagnosis must find."""

from __future__ import annotations

from typing import Annotated

from lumbar.settings.key import Each, Positive, key, section, settings

PositiveRange = tuple[Positive, Positive]
Correlation = Annotated[float, Each(ge=0, lt=1)]


@settings
class NoiseColours:
    """How often each colour of the noise occurs, as weights."""

    white: float = key(3.0, "White noise.", ge=0)
    autoregressive: float = key(1.0, "Autoregressive noise of first order.", ge=0)
    flicker: float = key(1.0, "Noise with a spectrum of 1/f above 0.1 Hz.", ge=0)


@settings
class HiddenEffectsSettings:
    """Benchmark of the diagnosis on synthetic experiments whose hidden effect is known."""

    seed: int = key(2718, "Seed of all experiments; each depends on it and on its own kind and number.", ge=0)
    experiments_per_form: int = key(
        1, "Experiments of each mathematical form of the catalogue's mechanisms.", ge=1
    )
    experiments_per_pair: int = key(1, "Experiments of each pair of mechanisms.", ge=0)
    experiments_per_outside_form: int = key(
        1, "Experiments of each form of a mechanism that the catalogue does not hold.", ge=0
    )
    nulls: int = key(20, "Experiments in which nothing is hidden.", ge=0)
    slices: int = key(
        4, "Jobs over which one experiment of each form, pair or outside form is spread.", ge=1, le=7
    )
    nulls_per_batch: int = key(10, "How many of these one job makes or diagnoses.", ge=1)
    keep_recordings: bool = key(
        True, "Whether the recordings stay after they are diagnosed (0.3 MB per experiment)."
    )
    residual_over_noise: PositiveRange = key(
        (1.5, 26.0),
        "Range of strengths, even in the logarithm: RMS that the best Kelvin–Boltzmann model leaves "
        "of the noise-free multisine, over the RMS of the noise.",
    )
    noise_share: PositiveRange = key(
        (0.005, 0.015), "RMS of the noise over that of the force without the effect."
    )
    noise_colours: NoiseColours = section(NoiseColours)
    autoregressive_correlation: tuple[Correlation, Correlation] = key(
        (0.3, 0.8), "Range of the correlation of neighbouring samples of autoregressive noise."
    )
    elastic_N_per_mm: PositiveRange = key((0.25, 0.9), "Range of the stiffness at rest.", unit="N/mm")
    relaxing_over_elastic: PositiveRange = key(
        (0.7, 2.5), "Range of the relaxing branch's stiffness over the stiffness at rest."
    )
    relaxing_N_per_mm: PositiveRange = key(
        (0.2, 1.9), "Limits of the relaxing branch's stiffness.", unit="N/mm"
    )
    relaxation_s: PositiveRange = key((0.05, 0.35), "Range of the branch's time constant.", unit="s")
    amplitude_mm: PositiveRange = key((3.0, 8.0), "Range of the largest displacement.", unit="mm")
    periods: int = key(10, "Periods of 10 s in the multisine.", ge=2, le=100)
    strong_residual_over_noise: float = key(
        4.0, "Residual over noise from which an effect counts as strong in the scores.", gt=0
    )
    named_share: float = key(0.95, "Share of effects named at which the power curve is read off.", gt=0, lt=1)
    confidence: float = key(0.95, "Confidence of all intervals of the scores.", gt=0, lt=1)
    bootstrap_resamples: int = key(
        200, "Resamples for the interval of the strength at which that share is named.", ge=20
    )
