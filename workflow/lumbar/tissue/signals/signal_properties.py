"""What the designed signals are, as tables and plain data: files for the machine, lines, properties."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lumbar.tissue.signals.excitation import Excitation, Signal
from lumbar.tissue.signals.machine_limits import peak_kinematics

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.signals import SignalsSettings
    from lumbar.tables.table import Table


def machine_file(signal: Signal) -> pd.DataFrame:
    """Columns ``time_s, position_mm`` as the testing machine loads them, to a nanometre."""
    import pandas as pd

    return pd.DataFrame({"time_s": np.round(signal.time, 9), "position_mm": np.round(signal.position, 6)})


def multisine_description(excitation: Excitation, settings: SignalsSettings) -> dict:
    """Lines, amplitudes, phases and detection lines of the multisine, as plain data."""
    multisine = excitation.multisine
    return {
        "schema": "lumbar.multisine/1",
        "period_s": multisine.period,
        "periods": settings.multisine.periods,
        "rate_Hz": settings.rate_Hz,
        "ramp_s": settings.ramp_s,
        "grid": settings.multisine.grid,
        "phase_rule": settings.multisine.phases,
        "crest_factor": multisine.crest_factor,
        "lines": multisine.lines,
        "frequency_Hz": multisine.frequencies,
        "amplitude_mm": multisine.amplitudes,
        "phase_rad": multisine.phases,
        "detection_lines": {"even": multisine.detection_even, "odd": multisine.detection_odd},
    }


def signal_properties(excitation: Excitation, data: str) -> Table:
    """Table of what each signal is and what it asks of the machine.

    Parameters
    ----------
    data : str
        Where the surgeon recordings behind the band come from.
    """
    import pandas as pd

    from lumbar.tables.table import Table

    rows = []
    for signal in excitation.signals:
        motion = peak_kinematics(signal.position, signal.rate)
        steady = signal.steady
        rms = float(np.sqrt(np.mean(steady**2)))
        peak = motion.displacement if signal.name != "multisine" else excitation.multisine.peak
        rows.append(
            {
                "signal": signal.name,
                "duration_s": len(signal.position) / signal.rate,
                "rate_Hz": float(signal.rate),
                "band_Hz": excitation.band,
                "rms_mm": rms,
                "crest_factor": peak / rms,
                "band_power_percent": 100 * signal.band_power_share(excitation.band),
                "peak_displacement_mm": motion.displacement,
                "peak_velocity_mm_s": motion.velocity,
                "peak_acceleration_mm_s2": motion.acceleration,
                "start_jump_mm": float(abs(machine_file(signal)["position_mm"].iloc[0])),
            }
        )
    return Table(
        title="Excitation signals of the tissue tests.",
        frame=pd.DataFrame(rows),
        definitions=_DEFINITIONS,
        data=data,
        notes=(
            "Peaks are those of the smooth motion through the samples (quintic spline), so between samples "
            "too; all lie within the testing machine's limits of the study (signals.machine).",
            "The machine is brought to the first position before the signal is played; signals.ramp_s > 0 "
            "raises every signal from zero instead.",
        ),
        decimals={"duration_s": 0, "rate_Hz": 0, "band_Hz": 2, "crest_factor": 2, "band_power_percent": 2},
    )


_DEFINITIONS = {
    "signal": "multisine: Eq. 3.1; noise: Gaussian, low-pass filtered without phase shift; chirp: Eq. 3.2",
    "duration_s": "samples over sampling rate, s",
    "rate_Hz": "samples per second, Hz",
    "band_Hz": "upper end of the excited band: band factor times the surgeons' bandwidth, rounded, Hz",
    "rms_mm": "root mean square about zero, over one period of the multisine, over all of the others, mm",
    "crest_factor": "peak displacement (of one period of the multisine) over rms_mm",
    "band_power_percent": "share of the power (mean left out) up to band_Hz, from the Fourier series, %",
    "peak_displacement_mm": "largest absolute position, mm",
    "peak_velocity_mm_s": "largest absolute velocity, mm/s",
    "peak_acceleration_mm_s2": "largest absolute acceleration, mm/s²",
    "start_jump_mm": "absolute position of the first sample, where the machine has to be before, mm",
}
