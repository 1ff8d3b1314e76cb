"""From recordings to a device: four numbers with their intervals, or why the recordings do not tell them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lumbar.base.errors import Problems
from lumbar.base.files import write_text
from lumbar.records.record import Record
from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.haptics.device_identification.free_motion import PARAMETERS
from lumbar.tissue.haptics.device_identification.output_error import DeviceFit, fit_device
from lumbar.tissue.haptics.device_identification.regression import regress
from lumbar.tissue.haptics.device_identification.stretches import cut

_KEYS = {"mass": "mass_kg", "damping": "damping_N_s_m", "friction": "friction_N", "delay": "delay_ms"}
"""Key of ``runtime.device`` for each number that is asked for."""
_UNITS = ("kg", "N·s/m", "N", "ms", "N", "N/m")
_IN_UNITS = np.array([1.0, 1.0, 1.0, 1e3, 1.0, 1.0])
TOLD, NEGLIGIBLE = 0.25, 0.02
"""Half an interval's largest size: as a share of the number, or, of damping and friction, of the commanded force (root mean
square); of the delay a share of the servo's period will do too."""
NOTICED, TOO_MUCH = 0.002, 0.05
"""Share of the motion that is unexplained from which intervals come with a warning, and from which the equation is refused."""
LARGEST_SPRING = 0.05
"""Force of a spring that is not in the recording, as a share of the commanded force."""
_CONFOUNDED = 0.9
_CAUSES = (
    "possible causes: a hand or a cable at the stylus, motors that do not give what is commanded, cogging, friction that "
    "changes with place or speed, parts that swing on their own"
)
_MORE = {
    "mass": "command forces that change faster",
    "damping": "let it slide faster and longer, as after a push",
    "friction": "let it slide both slowly and fast, and come to rest by itself",
    "delay": "command forces that change faster, as a chirp to higher frequencies",
}


@dataclass(frozen=True)
class Interval:
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float
    unit: str

    def __str__(self) -> str:
        return f"{self.text(self.value)} {self.unit} ({self.text(self.low)} to {self.text(self.high)})"

    def text(self, value: float) -> str:
        """A number with the digits that the interval leaves it."""
        half = max(self.high - self.low, 1e-9) / 2
        return f"{value:.{int(np.clip(1 - np.floor(np.log10(half)), 0, 7))}f}"

    @property
    def not_negative(self) -> Interval:
        """What of it is not below 0."""
        return Interval(max(self.value, 0.0), max(self.low, 0.0), max(self.high, 0.0), self.unit)


@dataclass(frozen=True)
class IdentifiedDevice:
    """What recordings tell of a device."""

    mass: Interval
    damping: Interval
    friction: Interval
    delay: Interval
    offset: Interval
    spring: Interval
    """`offset`, `spring`: a constant force and a weak spring that act besides."""
    rate_Hz: float
    encoder_um: float
    """Step between the positions; 0 where there is none to be seen."""
    duration: float
    """Seconds that were compared."""
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
        lines = [f"# {line}" for line in str(self).splitlines()]
        lines += ["runtime:", "  device:"]
        lines += [f"    {key}: {getattr(self, name).value:.6g}" for name, key in _KEYS.items()]
        lines += [f"    rate_Hz: {self.rate_Hz:.6g}", f"    encoder_um: {self.encoder_um:.4g}"]
        write_text(path, "\n".join([*lines, ""]))

    def __str__(self) -> str:
        numbers = [f"{name:9}{getattr(self, name)}" for name in _KEYS]
        steps = f"steps of {self.encoder_um:.4g} µm" if self.encoder_um else "no steps to be seen"
        left = f"left     {self.unexplained:.2%} of the motion, beyond the encoder's errors"
        if self.unexplained > NOTICED:
            left += f": the intervals do not hold what follows from that; {_CAUSES}"
        return "\n".join(
            [
                f"{self.data}, {self.duration:.3g} s at {self.rate_Hz:.6g} Hz, with 95 % intervals",
                *numbers,
                f"besides  a constant force of {self.offset}, a spring of {self.spring}",
                f"encoder  {steps}",
                left,
            ]
        )


def identify(recordings: Sequence[Record], data: str = "") -> IdentifiedDevice:
    """Identify a device.

    Parameters
    ----------
    recordings : sequence of Record
        ``input`` is the position that the encoder reads at each tick, ``output`` the force in N that is commanded upon it
        and held until the next one, counted as it pushes towards growing positions. Nobody holds the stylus.
    data : str, optional
        Words for the source of the data.

    Raises
    ------
    InputError
        If the recordings do not tell the four numbers, or the motion is that of something else.
    """
    stretches = cut(recordings)
    subject = data or recordings[0].source or recordings[0].name
    problems = Problems(subject)
    fit = fit_device(stretches, regress(stretches))
    share = fit.unexplained()
    if share > TOO_MUCH:
        turned = replace(stretches, forces=-stretches.forces)
        if fit_device(turned, regress(turned)).unexplained() < NOTICED:
            problems.add(
                "",
                "the stylus moves as if every force were turned round",
                "a positive force must push towards growing positions: turn the sign of one of the two columns",
            )
        else:
            problems.add(
                "",
                f"{share:.1%} of the motion is not that of a mass with damping, dry friction and a delay",
                f"at most {TOO_MUCH:.0%} may be left; {_CAUSES}",
            )
        problems.raise_if_any()
    half, correlations = fit.intervals()
    ends = _IN_UNITS * (fit.parameters + np.array([[0.0], [-1.0], [1.0]]) * half)
    found = {
        name: Interval(*map(float, numbers), unit)
        for name, numbers, unit in zip(PARAMETERS, ends.T, _UNITS, strict=True)
    }
    _check_told(fit, found, correlations, problems)
    return IdentifiedDevice(
        **found | {name: found[name].not_negative for name in _KEYS},
        rate_Hz=1.0 / stretches.step,
        encoder_um=1e6 * stretches.resolution,
        duration=len(stretches.starts) * stretches.length * stretches.step,
        unexplained=share,
        data=subject,
    )


def _check_told(
    fit: DeviceFit, found: dict[str, Interval], correlations: np.ndarray, problems: Problems
) -> None:
    """Refuse numbers whose interval is too wide, or below 0, and a spring that should not be there."""
    stretches = fit.stretches
    force, speed = stretches.rms(stretches.forces), stretches.rms(stretches.velocity)
    # Of a size that does not matter no more need be known.
    delay, friction = 1e3 * TOLD * stretches.step, NEGLIGIBLE * force
    enough = {"mass": 0.0, "damping": friction / speed, "friction": friction, "delay": delay}
    others = np.abs(correlations - np.eye(len(PARAMETERS)))
    for index, name in enumerate(_KEYS):
        item, other = found[name], int(others[index].argmax())
        if (item.high - item.low) / 2 > max(TOLD * abs(item.value), enough[name]):
            why = "the motion depends on it too little, or as on the others together"
            if others[index, other] > _CONFOUNDED:
                why = f"in this motion another {PARAMETERS[other]} makes up for it"
            problems.add(name, f"not told: {why}", _MORE[name])
    if found["delay"].high < -0.2 * delay:
        early = f"forces act {-found['delay'].value:.2g} ms before they are commanded"
        problems.add("delay", early, "each row needs the force that is commanded upon its own position")
    if found["friction"].high < -friction:
        problems.add("friction", f"negative, {found['friction']}", "something drives the stylus besides")
    spring, size = found["spring"], abs(found["spring"].value)
    share = size * float(np.std(stretches.readings)) / force
    # Where another number is not told a spring may be that one's error.
    problems.raise_if_any()
    if share > LARGEST_SPRING and (spring.high - spring.low) / 2 < TOLD * size:
        problems.add(
            "",
            f"a spring of {spring.value:.3g} N/m that is not in the forces pulls at the stylus, with {share:.0%} of theirs",
            "nobody may hold it; a spring of the device or its controller belongs into the column of forces",
        )
        problems.raise_if_any()
