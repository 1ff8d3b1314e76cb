"""What is found of a model on a device in a hand: the numbers of the analysis, the simulated loop, and the verdict in words."""

from dataclasses import dataclass

import numpy as np

from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.haptics.rendered_model import RenderedModel
from lumbar.tissue.haptics.simulation import LoopRun
from lumbar.tissue.haptics.stable_share import StableShare
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.perception.felt import Felt


@dataclass(frozen=True)
class Analysis:
    """What the linear analysis says of a model in the loop; of a model with effects the worst of its linearisations."""

    name: str
    rate: float
    """At which the model samples the position, in Hz."""
    device: DeviceSettings
    damping: float
    """Smallest damping of the device for a passive loop in N·s/m."""
    gain: float
    gain_frequency: float
    """`gain`, `gain_frequency`: largest stable factor on the model's force, and the frequency in Hz of the oscillation
    that begins there."""
    loop: str
    """Name of the loop that gain is of: of a model with effects which linearisation."""
    gains: tuple[float, ...]
    """The largest stable gain of each loop."""
    timings: int = 0
    """How many timings were looked at; 0 where ticks are even. `gain` is that of the worst."""
    even_gain: float = 0.0
    proved_gain: float = 0.0
    """`even_gain`, `proved_gain`: that of even ticks, and the one up to which every timing is proved to be stable."""
    reach: tuple[float, float] | None = None
    beside: str = ""
    """`reach`, `beside`: as of `RenderedModel`."""
    directions: str = ""
    """Along several axes: which directions decide, in words."""

    @property
    def passive(self) -> bool:
        """Whether the device is passive with the model, in any passive hand; with uneven ticks that is not known."""
        unknown = self.timings or self.beside
        return self.damping <= self.device.damping_N_s_m and self.stable and not unknown

    @property
    def stable(self) -> bool:
        """Whether the loop is stable in the hand of the settings."""
        return self.gain > 1.0

    @property
    def in_step(self) -> bool:
        """Whether the servo's rate is a whole multiple of the model's."""
        times = self.device.rate_Hz / self.rate
        return round(times) >= 1 and abs(times - round(times)) < 1e-9 * times

    @property
    def prompt(self) -> bool:
        """Whether each force acts from its own sample to the next one, as a bound by the device's damping counts it."""
        return self.in_step and not (self.timings or self.device.delay_ms)

    @property
    def clocks(self) -> str:
        """Rate of the model, and of the servo where that is not a whole multiple of it."""
        return f"{self.rate:.4g} Hz" + ("" if self.in_step else f", served at {self.device.rate_Hz:.6g} Hz")

    @property
    def finding(self) -> str:
        """What the analysis alone says."""
        return f"{self.name} at {self.clocks}: {self.state} ({self.numbers})"

    @property
    def state(self) -> str:
        """The verdict of the analysis in words."""
        within = "" if self.reach is None else f" from {self.reach[0]:.3g} to {self.reach[1]:.3g} mm"
        if self.passive:
            return f"passive in any hand{within}"
        if not self.stable:
            return "UNSTABLE" + (" where ticks are uneven" if self.even_gain > 1.0 else "")
        if not self.timings:
            why = f" with {self.beside}" if self.damping <= self.device.damping_N_s_m else ""
            return f"stable in this hand{within}, not passive{why}"
        if self.proved_gain >= 1.0:
            return f"stable in this hand{within} whenever ticks come"
        return f"stable in this hand{within} in the worst of {self.timings} timings, which is no proof"

    @property
    def numbers(self) -> str:
        """A few words on damping and gain, and along several axes where they are so."""
        return "; ".join(filter(None, (self._numbers, self.directions)))

    @property
    def _numbers(self) -> str:
        least, most = ("at least ", "at most ") if self.timings else ("", "")
        needs = f"it needs {least}{self.damping:.3g} N·s/m to be passive"
        if np.isinf(self.damping):
            needs = "no damping makes it passive: its static stiffness is negative"
        elif self.beside:
            needs += f" without {self.beside}"
        if self.timings:
            needs += f"; all timings are proved to be stable up to a gain of {self.proved_gain:.3g}"
        if self.gain == 0 or np.isinf(self.gain):
            return f"{needs}; no gain is {'too large' if self.gain else 'stable'}"
        begins = f"it oscillates at {self.gain_frequency:.3g} Hz" if self.gain_frequency else "it runs away"
        return f"{needs}; largest stable gain {most}{self.gain:.3g}, where {begins}"


@dataclass(frozen=True)
class Judgement:
    """A model at one rate on the device of the settings: of analysis and simulation the worse one is the verdict."""

    model: RenderedModel
    analysis: Analysis
    run: LoopRun
    fitted: FittedModel | None = None
    """None for an FMU."""
    hands: StableShare | None = None
    """In which share of fits and hands it is stable; None where that was not looked at."""
    lowest_passive_rate: float | None = None
    lowest_stable_rate: float | None = None
    """`lowest_passive_rate`, `lowest_stable_rate`: in Hz; None where there is none, or where the model has effects and
    only its own rate was looked at."""
    felt: Felt | None = None
    """What rate, moving average and delay change to a hand (`felt_on_device`)."""

    @property
    def passive(self) -> bool:
        """Whether the device is passive with the model, in any passive hand, and does nothing else in the simulation."""
        return self.analysis.passive and self.run.calm

    @property
    def stable(self) -> bool:
        """Whether the loop is stable in the hand of the settings, by analysis and simulation."""
        return self.analysis.stable and self.run.calm

    @property
    def finding(self) -> str:
        """The verdict, which of both decided where they differ, and the numbers of both."""
        analysis, run = self.analysis, self.run
        state = analysis.state
        if run.calm and not analysis.stable:
            state += f" by its linearisation{analysis.loop.removeprefix(analysis.name)}"
        elif analysis.stable and not run.calm:
            state = "UNSTABLE by the simulation"
        hands = f"; {self.hands.finding}" if self.hands else ""
        felt = f"; {felt_words(self.felt)}" if self.felt else ""
        return f"{analysis.name} at {analysis.clocks}: {state} ({analysis.numbers}; simulated, {run.outcome}{hands}){felt}"

    @property
    def safe(self) -> bool:
        """Whether it is stable in the hand of the settings, and in as many others as they ask for."""
        return self.stable and (
            self.hands is None or self.hands.share >= self.analysis.device.least_stable_share
        )


def felt_words(felt: Felt) -> str:
    """What rate, moving average and delay change to a hand."""
    return (
        f"to a hand rate, average and delay change a push by {felt.jnd.value:.2g} times what it just notices "
        f"({felt.jnd.low:.2g} to {felt.jnd.high:.2g})"
    )
