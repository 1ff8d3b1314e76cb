"""From a recording to a device: four numbers with their intervals, or why the recording does not tell them."""

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.base.files import write_text
from lumbar.base.yaml_file import shipped_yaml
from lumbar.records.record import Record
from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.haptics.device_identification.free_motion import PARAMETERS, cut
from lumbar.tissue.haptics.device_identification.output_error import (
    NOTICED,
    DeviceFit,
    fit_device,
    nearest_fit,
    regress,
)

_KEYS = {"mass": "mass_kg", "damping": "damping_N_s_m", "friction": "friction_N", "delay": "delay_ms"}
"""Key of ``runtime.device`` for each number that is asked for."""
_UNITS = {"kg": 1.0, "N·s/m": 1.0, "N": 1.0, "ms": 1e3}
"""Of these, with how many are one of the unit that is computed in."""
TOLD, NEGLIGIBLE = 0.25, 0.02
"""Half an interval's largest size: as a share of the number, or, of damping and friction, of the commanded force (root mean
square); of the delay a share of the servo's period will do too."""
TOO_MUCH, LARGEST_SPRING = 0.05, 0.05
"""Share of the motion that is unexplained from which the equation is refused; force of a spring that is not in the recording,
as a share of the commanded force."""
_CONFOUNDED = 0.9
_SAID: dict[str, str] = shipped_yaml(Path(__file__).with_suffix(".yaml"))


@dataclass(frozen=True)
class Interval:
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float
    unit: str

    def __str__(self) -> str:
        half = max(self.high - self.low, 1e-9) / 2
        digits = int(np.clip(1 - np.floor(np.log10(half)), 0, 7))
        value, low, high = (f"{item:.{digits}f}" for item in (self.value, self.low, self.high))
        return f"{value} {self.unit} ({low} to {high})"


@dataclass(frozen=True)
class IdentifiedDevice:
    """What a recording tells of a device."""

    mass: Interval
    damping: Interval
    friction: Interval
    delay: Interval
    rate_Hz: float
    encoder_um: float
    """Step between the positions; 0 where there is none to be seen."""
    offset_N: float
    spring_N_m: float
    """`offset_N`, `spring_N_m`: a constant force and a weak spring that act besides."""
    unexplained: float
    """Share of the motion that is not that of the equation; 0 where only the encoder's errors are left."""
    data: str
    """Words for the source of the data."""

    @property
    def device(self) -> DeviceSettings:
        """The device for ``runtime.device``; the hand is that of the defaults."""
        numbers = {key: getattr(self, name).value for name, key in _KEYS.items()}
        return DeviceSettings(**numbers, rate_Hz=self.rate_Hz, encoder_um=self.encoder_um)

    def save(self, path: str | os.PathLike) -> None:
        """Write a configuration for ``--config`` of ``lumbar render`` and ``lumbar export``."""
        said = [f"# {line}" for line in str(self).splitlines()]
        keys = [
            f"    {key}: {getattr(self.device, key):.6g}"
            for key in (*_KEYS.values(), "rate_Hz", "encoder_um")
        ]
        write_text(path, "\n".join([*said, "runtime:", "  device:", *keys, ""]))

    def __str__(self) -> str:
        steps = f"steps of {self.encoder_um:.4g} µm" if self.encoder_um else "no steps to be seen"
        more = _SAID["more_is_left"].format(causes=_SAID["causes"]) if self.unexplained > NOTICED else ""
        return _SAID["device"].format(device=self, steps=steps) + more


def identify(recording: Record) -> IdentifiedDevice:
    """Identify a device.

    Parameters
    ----------
    recording : Record
        ``input`` is the position that the encoder reads at each tick, ``output`` the force in N that is commanded upon it
        and held until the next one, counted as it pushes towards growing positions. Nobody holds the stylus.

    Raises
    ------
    InputError
        If it does not tell the four numbers, or the motion is that of something else.
    """
    stretches, name = cut(recording), recording.source or recording.name
    fit = nearest_fit(stretches)
    share = fit.unexplained()
    if share > TOO_MUCH:
        turned = replace(stretches, forces=-stretches.forces)
        if fit_device(turned, regress(turned)[0]).unexplained() < NOTICED:
            raise InputError(_SAID["turned"].format(name=name))
        words = {"share": share, "most": TOO_MUCH, "causes": _SAID["causes"]}
        raise InputError(_SAID["unlike"].format(name=name, **words))
    half, correlations = fit.intervals()
    _check_told(fit, share, half, correlations, Problems(name))
    intervals = [
        Interval(*(max(scale * float(number), 0.0) for number in (value, value - width, value + width)), unit)
        for value, width, (unit, scale) in zip(fit.parameters, half, _UNITS.items(), strict=False)
    ]
    steps, besides = 1e6 * stretches.resolution, map(float, fit.parameters[len(_KEYS) :])
    return IdentifiedDevice(*intervals, 1.0 / stretches.step, steps, *besides, share, name)


def _check_told(
    fit: DeviceFit, share: float, half: np.ndarray, correlations: np.ndarray, problems: Problems
) -> None:
    """Refuse numbers whose interval is too wide, or below 0, and a spring that should not be there."""
    stretches, values, highs = fit.stretches, fit.parameters, fit.parameters + half
    force, speed = stretches.rms(stretches.forces), stretches.rms(stretches.velocity)
    # Of a size that does not matter no more need be known.
    enough = [0.0, NEGLIGIBLE * force / speed, NEGLIGIBLE * force, TOLD * stretches.step]
    others = np.abs(correlations - np.eye(len(PARAMETERS)))
    for index, name in enumerate(_KEYS):
        if half[index] > max(TOLD * abs(values[index]), enough[index]):
            why = "the motion depends on it too little, or as on the others together"
            more = _SAID[name]
            if share > NOTICED:
                why, more = f"{share:.1%} of the motion is left", _SAID["causes"]
            elif others[index].max() > _CONFOUNDED:
                why = f"in this motion another {PARAMETERS[others[index].argmax()]} makes up for it"
            problems.add(name, f"not told: {why}", more)
    *_, friction, delay, _, spring = range(len(PARAMETERS))
    if highs[delay] < -0.2 * enough[delay]:
        early = f"forces act {-1e3 * values[delay]:.2g} ms before they are commanded"
        problems.add("delay", early, "each row needs the force that is commanded upon its own position")
    if highs[friction] < -enough[friction]:
        problems.add("friction", f"negative, {values[friction]:.2g} N", "something drives the stylus besides")
    # Where another number is not told a spring may be that one's error.
    problems.raise_if_any()
    pull = abs(values[spring]) * float(np.std(stretches.readings)) / force
    if pull > LARGEST_SPRING and half[spring] < TOLD * abs(values[spring]):
        raise InputError(_SAID["spring"].format(name=problems.subject, spring=values[spring], pull=pull))
