"""The benchmark of the diagnosis: synthetic tissue tests with an effect that the diagnosis must find."""

from __future__ import annotations

from typing import Annotated

from lumbar.settings.key import Each, Positive, key, section, settings

PositiveRange = tuple[Positive, Positive]
Correlation = Annotated[float, Each(ge=0, lt=1)]


@settings
class NoiseColours:
    """How often each colour of the noise occurs, as weights."""

    white: float = key("White noise.", default=3.0, ge=0)
    autoregressive: float = key("Autoregressive noise of first order.", default=1.0, ge=0)
    flicker: float = key("Noise with a spectrum of 1/f above 0.1 Hz.", default=1.0, ge=0)


@settings
class HiddenEffectsSettings:
    """Benchmark of the diagnosis on synthetic experiments whose hidden effect is known."""

    seed: int = key(
        "Seed of all experiments; each depends on it and on its own kind and number.", default=2718, ge=0
    )
    experiments_per_form: int = key(
        "Experiments of each mathematical form of the catalogue's mechanisms.", default=1, ge=1
    )
    experiments_per_pair: int = key("Experiments of each pair of mechanisms.", default=1, ge=0)
    experiments_per_outside_form: int = key(
        "Experiments of each form of a mechanism that the catalogue does not hold.", default=1, ge=0
    )
    nulls: int = key("Experiments in which nothing is hidden.", default=20, ge=0)
    slices: int = key(
        "Jobs over which one experiment of each form, pair or outside form is spread.", default=4, ge=1, le=7
    )
    nulls_per_batch: int = key("How many of these one job makes or diagnoses.", default=10, ge=1)
    keep_recordings: bool = key(
        "Whether the recordings stay after they are diagnosed (0.3 MB per experiment).", default=True
    )
    residual_over_noise: PositiveRange = key(
        "Range of strengths, even in the logarithm: RMS that the best Kelvin–Boltzmann model leaves "
        "of the noise-free multisine, over the RMS of the noise.",
        default=(1.5, 26.0),
    )
    noise_share: PositiveRange = key(
        "RMS of the noise over that of the force without the effect.", default=(0.005, 0.015)
    )
    noise_colours: NoiseColours = section(default_factory=NoiseColours)
    autoregressive_correlation: tuple[Correlation, Correlation] = key(
        "Range of the correlation of neighbouring samples of autoregressive noise.", default=(0.3, 0.8)
    )
    elastic_N_per_mm: PositiveRange = key("Range of the stiffness at rest.", default=(0.25, 0.9), unit="N/mm")
    relaxing_over_elastic: PositiveRange = key(
        "Range of the relaxing branch's stiffness over the stiffness at rest.", default=(0.7, 2.5)
    )
    relaxing_N_per_mm: PositiveRange = key(
        "Limits of the relaxing branch's stiffness.", default=(0.2, 1.9), unit="N/mm"
    )
    relaxation_s: PositiveRange = key("Range of the branch's time constant.", default=(0.05, 0.35), unit="s")
    amplitude_mm: PositiveRange = key("Range of the largest displacement.", default=(3.0, 8.0), unit="mm")
    periods: int = key("Periods of 10 s in the multisine.", default=10, ge=2, le=100)
    strong_residual_over_noise: float = key(
        "Residual over noise from which an effect counts as strong in the scores.", default=4.0, gt=0
    )
    named_share: float = key(
        "Share of effects named at which the power curve is read off.", default=0.95, gt=0, lt=1
    )
    confidence: float = key("Confidence of all intervals of the scores.", default=0.95, gt=0, lt=1)
    bootstrap_resamples: int = key(
        "Resamples for the interval of the strength at which that share is named.", default=200, ge=20
    )
