"""Synthetic tissue tests: recordings of a testing machine on a soft, slightly hardening tissue.

The tissue is a Kelvin–Boltzmann solid (spring k1 parallel to a dashpot, both in series with spring k2) parallel to a cubic
spring, which no linear model describes. The machine moves in ramps between the samples of its command; the relaxation then has a
closed form, so that the force has no integration error.
"""

import math
import os

import numpy as np
import scipy

from lumbar.base.errors import InputError
from lumbar.base.files import write_csv
from lumbar.settings.twin import SyntheticTissueSettings


def tissue_force(
    time: np.ndarray, position: np.ndarray, k1: float, k2: float, relaxation_s: float, cubic: float
) -> np.ndarray:
    """Return the noise-free force in N on a tool that moves in ramps between samples; the tissue starts at rest.

    Parameters
    ----------
    time, position : numpy.ndarray, shape (samples,)
        Seconds, evenly spaced, and millimetres.
    k1, k2 : float
        Stiffness parallel to the dashpot and in series with both, N/mm.
    relaxation_s, cubic : float
        Time constant b/(k1 + k2) of the relaxation at constant position, seconds; hardening, N/mm³.

    Notes
    -----
    Elongation w of k1 and the dashpot obeys ẇ = (w∞ − w)/τ with w∞ = k2 x/(k1 + k2). For x that moves at
    speed v the particular solution lags by τ: w = k2 (x − τ v)/(k1 + k2). Force: k2 (x − w).
    """
    step = float(time[-1] - time[0]) / (len(time) - 1)
    decay = math.exp(-step / relaxation_s)
    share = k2 / (k1 + k2)
    elongation = np.empty_like(position)
    elongation[0] = share * position[0]
    for sample in range(1, len(position)):
        speed = (position[sample] - position[sample - 1]) / step
        lagging_before = share * (position[sample - 1] - relaxation_s * speed)
        lagging_now = share * (position[sample] - relaxation_s * speed)
        elongation[sample] = lagging_now + (elongation[sample - 1] - lagging_before) * decay
    return k2 * (position - elongation) + cubic * position**3


def tissue_test(
    time: np.ndarray, position: np.ndarray, tissue: SyntheticTissueSettings, seed: int, number: int
) -> np.ndarray:
    """Return the recorded force in N, shape (samples,): the force of the tissue plus noise of the load cell.

    The noise has the standard deviation ``noise_N``, or the share ``noise_variance_share`` of the variance; it depends on the
    twin's seed and the number of the recording. `time` (s) and `position` (mm) are the machine's command.
    """
    rng = np.random.default_rng(
        [seed, 2, number]
    )  # 2 separates these random numbers from the twin's other recordings
    force = tissue_force(
        time, position, tissue.k1_N_per_mm, tissue.k2_N_per_mm, tissue.relaxation_s, tissue.cubic_N_per_mm3
    )
    if tissue.delay_s:
        force = np.interp(time - tissue.delay_s, time, force)
    noise = tissue.noise_N
    if noise is None:
        share = tissue.noise_variance_share
        noise = math.sqrt(share / (1.0 - share)) * float(force.std())
    white = rng.standard_normal(len(force))
    if tissue.noise_correlation_s:
        decay = math.exp(-(time[1] - time[0]) / tissue.noise_correlation_s)
        # First-order autoregression of variance 1.
        before = [decay * rng.standard_normal()]
        white, _ = scipy.signal.lfilter([math.sqrt(1.0 - decay**2)], [1.0, -decay], white, zi=before)
    return force + noise * white


def play(
    signal: str | os.PathLike,
    recording: str | os.PathLike,
    tissue: SyntheticTissueSettings,
    seed: int,
    number: int,
) -> None:
    """Play a signal file, ``time_s,position_mm``, on the synthetic tissue and write the recording; see `tissue_test`."""
    import pandas as pd

    table = pd.read_csv(signal, dtype=str)  # times and positions are written as they are read
    if list(table) != ["time_s", "position_mm"]:
        raise InputError(f"{signal}: header {','.join(table)}; a signal has time_s,position_mm")
    time, position = table.to_numpy(dtype=float).T
    force = tissue_test(time, position, tissue, seed, number)
    write_csv(recording, table.assign(force_N=[f"{value:.6g}" for value in force]))
