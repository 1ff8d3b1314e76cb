"""``lumbar.bandwidth`` and ``lumbar.design_signals``: surgeons' motion, and signals that excite as it does."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lumbar.base.errors import InputError
from lumbar.base.files import read_json
from lumbar.interface.result import Result, label_of
from lumbar.records.record import Record
from lumbar.settings.section import SEED
from lumbar.settings.signals import SignalsSettings, SurgeonSettings
from lumbar.tables.table import Table
from lumbar.tissue.signals.excitation import (
    Excitation,
    assumptions,
    design_excitation,
    excited_band,
    machine_file,
    multisine_description,
    signal_properties,
)
from lumbar.tissue.signals.surgeon_motion import (
    MotionSpectra,
    motion_bandwidths,
    motion_spectra,
    spectra_table,
)

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
    """Find the bandwidth of surgeons' tool motion by Welch's method.

    Parameters
    ----------
    trials : sequence of Record
        With the channel ``position``.
    surgeons : sequence of str, optional
        Who moved the tool, by trial; default the part of the trial's name before ``_trial``.
    seed : int
        Of the intervals.
    source_label : str
        Name of the source of the data; default the folder or file they were read from.

    Examples
    --------
    >>> import lumbar
    >>> import numpy as np
    >>> from lumbar.records.record import Channel, Record
    >>> time = np.arange(0, 40, 0.01)
    >>> wobble = np.sin(2 * np.pi * 0.7 * time) + 0.3 * np.sin(2 * np.pi * 2.1 * time)
    >>> trials = [Record("anna_trial_1", time, {"position": Channel(wobble, "position", "mm")})]
    >>> found = lumbar.bandwidth(trials)
    >>> found
    <Bandwidth of 1 surgeon>
    >>> f"{found.values['position']['power_share']['value_Hz']:.1f} Hz"
    '2.1 Hz'
    """
    source_label = label_of(source_label, trials)
    settings, trials = settings or SurgeonSettings(), list(trials)
    surgeons = list(surgeons or (trial.name.split("_trial")[0] for trial in trials))
    spectra = motion_spectra(trials, surgeons, settings.welch)
    return Bandwidth(spectra, motion_bandwidths(spectra, settings.bandwidth, seed), settings, source_label)


@dataclass(frozen=True, eq=False, repr=False)
class Bandwidth(Result):
    """Bandwidth of surgeons' motion."""

    spectra: MotionSpectra
    """Spectra of every trial."""
    values: dict
    """By quantity (position, velocity) and rule: ``value_Hz``, ``low_Hz``, ``high_Hz``."""
    settings: SurgeonSettings
    source_label: str

    @property
    def table(self) -> list[dict]:
        """The bandwidths, see `rows`."""
        return self.rows()

    def figure(self) -> Figure:
        """Return the spectra with the bandwidths read off them."""
        from lumbar.publishing.figures.signal_figures import psd_figure

        pooled = {quantity: self.spectra.pooled(quantity) for quantity in self.spectra.psd}
        return psd_figure(
            self.spectra.frequency,
            self.spectra.psd,
            pooled,
            self.spectra.surgeons,
            self.values,
            self.settings.reference_Hz,
        )

    def files(self) -> Iterator[tuple[str, Any]]:
        """``bandwidth.json`` and ``psd.csv``."""
        yield (
            "bandwidth.json",
            {**self.values, "welch": self.settings.welch.model_dump(mode="json"), "data": self.source_label},
        )
        yield "psd.csv", spectra_table(self.spectra).assign(data=self.source_label)

    def rows(self) -> list[dict]:
        """One dict per quantity and rule."""
        return [
            {"quantity": quantity, "rule": rule, **value}
            for quantity in self.spectra.psd
            for rule, value in self.values[quantity].items()
        ]

    def __repr__(self) -> str:
        count = len(set(self.spectra.surgeons))
        return f"<Bandwidth of {count} surgeon{'s' * (count != 1)}>"

    def __str__(self) -> str:
        return "\n".join(f"{row['quantity']}, {row['rule']}: {_text(row)}" for row in self.rows())


def _text(row: dict) -> str:
    if row["value_Hz"] is None:
        return "none within the analysis band"
    ends = [row["low_Hz"], row["high_Hz"]]
    interval = "no interval" if None in ends else f"interval {ends[0]:.3g} to {ends[1]:.3g} Hz"
    return f"{row['value_Hz']:.3g} Hz ({interval})"


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
        Upper end of the band to excite in hertz; or the surgeons' bandwidth, or its file, from which it follows.
    source_label : str
        Name of the source of the band; default that of the bandwidth, or that it was given.

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
    >>> signals.properties.frame["signal"].tolist()
    ['multisine', 'noise', 'chirp']
    """
    settings, values = settings or SignalsSettings(), {}
    if isinstance(band, Bandwidth):
        values = {**band.values, "data": band.source_label}
    elif isinstance(band, str | os.PathLike):
        if not Path(band).is_file():
            raise InputError(
                f"{band}: no such file of 'lumbar bandwidth'; hertz are given as a number (--band)"
            )
        values = read_json(Path(band))
    elif not 0 < band < settings.rate_Hz / 2:
        raise InputError(f"the band is {band:g} Hz; allowed: above 0 and below {settings.rate_Hz / 2:g} Hz")
    source_label = source_label or values.get("data", "" if values else "band given by hand")
    highest = band if isinstance(band, int | float) else excited_band(values, settings)
    return Signals(
        design_excitation(highest, settings, seed), highest, settings, source_label, values or None
    )


@dataclass(frozen=True, eq=False, repr=False)
class Signals(Result):
    """Excitation signals for a testing machine."""

    excitation: Excitation
    band_Hz: float
    """Upper end of what is excited."""
    settings: SignalsSettings
    source_label: str
    bandwidths: dict | None = None
    """The surgeons', from which the band follows."""

    @property
    def table(self) -> Table:
        """The signals' `properties`."""
        return self.properties

    @property
    def properties(self) -> Table:
        """Properties of the signals and their demands on the machine."""
        return signal_properties(self.excitation, self.settings, self.source_label, self.bandwidths)

    def figure(self) -> Figure:
        """Return the signals in time and in frequency."""
        from lumbar.publishing.figures.signal_figures import excitation_figure

        return excitation_figure(self.excitation.signals, self.band_Hz, assumptions(self.settings))

    def files(self) -> Iterator[tuple[str, Any]]:
        """Every signal as ``<name>.csv``, ``multisine.json`` and ``properties.csv``."""
        for signal in self.excitation.signals:
            yield f"{signal.name}.csv", machine_file(signal)
        described = multisine_description(self.excitation, self.settings)
        yield "multisine.json", {**described, "data": self.source_label}
        yield "properties.csv", self.properties.frame.assign(data=self.source_label)

    def __repr__(self) -> str:
        return f"<Signals up to {self.band_Hz:g} Hz>"

    def __str__(self) -> str:
        names = ", ".join(signal.name for signal in self.excitation.signals)
        return f"{names}: excited up to {self.band_Hz:g} Hz"
