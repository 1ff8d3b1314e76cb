"""``lumbar.bandwidth`` and ``lumbar.design_signals``: surgeons' motion, and excitation signals with the same bandwidth."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lumbar.base.errors import InputError
from lumbar.base.files import read_json
from lumbar.interface.result import Result, records_label
from lumbar.records.record import Record
from lumbar.settings.section import SEED
from lumbar.settings.tissue import SignalsSettings, SurgeonSettings
from lumbar.tables.table import Table
from lumbar.tissue.signals import excitation as design
from lumbar.tissue.signals import surgeon_motion

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def bandwidth(
    trials: Sequence[Record],
    surgeons: Sequence[str] | None = None,
    *,
    settings: SurgeonSettings | None = None,
    seed: int = SEED,
    source_label: str = "",
) -> Bandwidth:
    """Estimate the bandwidth of surgeons' tool motion by Welch's method.

    Parameters
    ----------
    trials : sequence of Record
        Records with the channel ``position``.
    surgeons : sequence of str, optional
        Surgeon of each trial; default the part of the trial's name before ``_trial``.
    settings : SurgeonSettings, optional
        Welch's method, and the rules for a bandwidth.
    seed : int
        Random seed of the intervals.
    source_label : str
        Name of the source of the data; default the folder or file they were read from.

    Examples
    --------
    >>> import lumbar
    >>> import numpy as np
    >>> time = np.arange(0, 40, 0.01)
    >>> motion = np.sin(2 * np.pi * 0.7 * time) + 0.3 * np.sin(2 * np.pi * 2.1 * time)
    >>> channels = {"position": lumbar.Channel(motion, "position", "mm")}
    >>> bandwidth = lumbar.bandwidth([lumbar.Record("anna_trial_1", time, channels)])
    >>> bandwidth
    <Bandwidth of 1 surgeon>
    >>> f"{bandwidth.values['position']['power_share']['value_Hz']:.1f} Hz"
    '2.1 Hz'
    """
    source_label = records_label(source_label, trials)
    settings, trials = settings or SurgeonSettings(), list(trials)
    surgeons = list(surgeons or (trial.name.split("_trial")[0] for trial in trials))
    spectra = surgeon_motion.motion_spectra(trials, surgeons, settings.welch)
    return Bandwidth(
        spectra, surgeon_motion.motion_bandwidths(spectra, settings.bandwidth, seed), settings, source_label
    )


@dataclass(frozen=True, eq=False, repr=False)
class Bandwidth(Result):
    """Bandwidth of surgeons' motion."""

    spectra: surgeon_motion.MotionSpectra
    """Spectra of every trial."""
    values: dict
    """Bandwidth by quantity (position, velocity) and rule: ``value_Hz``, ``low_Hz``, ``high_Hz``."""
    settings: SurgeonSettings
    source_label: str

    @property
    def table(self) -> list[dict]:
        """The bandwidths: one dict per quantity and rule."""
        return [
            {"quantity": quantity, "rule": rule, **value}
            for quantity in self.spectra.psd
            for rule, value in self.values[quantity].items()
        ]

    def figure(self) -> Figure:
        """Return the picture of the spectra, with the bandwidths."""
        from lumbar.publishing.figures.signal_figures import psd_figure

        return psd_figure(self.spectra, self.values, self.settings.reference_Hz)

    def files(self) -> Iterator[tuple[str, Any]]:
        """Yield ``bandwidth.json`` and ``psd.csv``."""
        yield (
            "bandwidth.json",
            {**self.values, "welch": self.settings.welch.model_dump(mode="json"), "data": self.source_label},
        )
        yield "psd.csv", surgeon_motion.spectra_table(self.spectra).assign(data=self.source_label)

    def __repr__(self) -> str:
        count = len(set(self.spectra.surgeons))
        return f"<Bandwidth of {count} surgeon{'s' * (count != 1)}>"

    def __str__(self) -> str:
        lines = []
        for row in self.table:
            text = "none within the analysis band"
            if row["value_Hz"] is not None:
                low, high = row["low_Hz"], row["high_Hz"]
                interval = (
                    f"interval {low:.3g} to {high:.3g} Hz" if None not in (low, high) else "no interval"
                )
                text = f"{row['value_Hz']:.3g} Hz ({interval})"
            lines.append(f"{row['quantity']}, {row['rule']}: {text}")
        return "\n".join(lines)


def design_signals(
    band: float | Bandwidth | str | os.PathLike,
    *,
    settings: SignalsSettings | None = None,
    seed: int = SEED,
    source_label: str = "",
) -> Signals:
    """Design multisine, noise and chirp for a testing machine, and check them against it.

    Parameters
    ----------
    band : float, Bandwidth or path
        Upper end of the excited band in hertz; or the surgeons' bandwidth or its file, with this value.
    settings : SignalsSettings, optional
        Rate, length and limits of the machine.
    seed : int
        Random seed of the noise.
    source_label : str
        Name of the source of the band; default the source of the bandwidth.

    Raises
    ------
    InputError
        If the band is not within the Nyquist frequency, or the machine cannot play a signal.

    Examples
    --------
    >>> import lumbar
    >>> signals = lumbar.design_signals(2.5)
    >>> print(signals)
    multisine, noise, chirp: excited up to 2.5 Hz
    >>> signals.table.frame["signal"].tolist()
    ['multisine', 'noise', 'chirp']
    """
    settings, values = settings or SignalsSettings(), {}
    if isinstance(band, Bandwidth):
        values = {**band.values, "data": band.source_label}
    elif isinstance(band, str | os.PathLike):
        if not Path(band).is_file():
            raise InputError(f"{band}: no such file of 'lumbar bandwidth'; give hertz as a number (--band)")
        values = read_json(Path(band))
    elif not 0 < band < settings.rate_Hz / 2:
        raise InputError(f"the band is {band:g} Hz; allowed: above 0 and below {settings.rate_Hz / 2:g} Hz")
    source_label = source_label or values.get("data", "" if values else "band given by hand")
    highest = band if isinstance(band, int | float) else design.excited_band(values, settings)
    excitation = design.design_excitation(highest, settings, seed)
    return Signals(excitation, highest, settings, source_label, values or None)


@dataclass(frozen=True, eq=False, repr=False)
class Signals(Result):
    """Excitation signals for a testing machine."""

    excitation: design.Excitation
    band_Hz: float
    """Upper end of the excited band."""
    settings: SignalsSettings
    source_label: str
    bandwidths: dict | None = None
    """Bandwidths of the surgeons from which the band was chosen."""

    @property
    def table(self) -> Table:
        """Table with properties of the signals and their demands on the machine."""
        return design.signal_properties(self.excitation, self.settings, self.source_label, self.bandwidths)

    def figure(self) -> Figure:
        """Return the signals in time and in frequency."""
        from lumbar.publishing.figures.signal_figures import excitation_figure

        return excitation_figure(self.excitation.signals, self.band_Hz, design.assumptions(self.settings))

    def files(self) -> Iterator[tuple[str, Any]]:
        """Yield every signal as ``<name>.csv``, ``multisine.json`` and ``properties.csv``."""
        for signal in self.excitation.signals:
            yield f"{signal.name}.csv", design.machine_file(signal)
        description = design.multisine_description(self.excitation, self.settings)
        yield "multisine.json", {**description, "data": self.source_label}
        yield "properties.csv", self.table.frame.assign(data=self.source_label)

    def __repr__(self) -> str:
        return f"<Signals up to {self.band_Hz:g} Hz>"

    def __str__(self) -> str:
        names = ", ".join(signal.name for signal in self.excitation.signals)
        return f"{names}: excited up to {self.band_Hz:g} Hz"
