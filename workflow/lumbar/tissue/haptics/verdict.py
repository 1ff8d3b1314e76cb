"""What is found of a model on a device in a hand: the numbers of the analysis, the simulated loop, and the verdict in words."""

from dataclasses import dataclass

import numpy as np

from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.haptics.rendered_model import RenderedModel
from lumbar.tissue.haptics.simulation import LoopRun
from lumbar.tissue.models.fitted_model import FittedModel


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
    reach: tuple[float, float] | None = None
    beside: str = ""
    """`reach`, `beside`: as of `RenderedModel`."""
    directions: str = ""
    """Along several axes: which directions decide, in words."""

    @property
    def passive(self) -> bool:
        """Whether the device is passive with the model, in any passive hand."""
        return self.damping <= self.device.damping_N_s_m and self.stable and not self.beside

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
        return self.in_step and not self.device.delay_ms

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
            return "UNSTABLE"
        why = f" with {self.beside}" if self.damping <= self.device.damping_N_s_m else ""
        return f"stable in this hand{within}, not passive{why}"

    @property
    def numbers(self) -> str:
        """A few words on damping and gain, and along several axes where they are so."""
        return "; ".join(filter(None, (self._numbers, self.directions)))

    @property
    def _numbers(self) -> str:
        needs = f"it needs {self.damping:.3g} N·s/m to be passive"
        if np.isinf(self.damping):
            needs = "no damping makes it passive: its static stiffness is negative"
        elif self.beside:
            needs += f" without {self.beside}"
        if self.gain == 0 or np.isinf(self.gain):
            return f"{needs}; no gain is {'too large' if self.gain else 'stable'}"
        begins = f"it oscillates at {self.gain_frequency:.3g} Hz" if self.gain_frequency else "it runs away"
        return f"{needs}; largest stable gain {self.gain:.3g}, where {begins}"


@dataclass(frozen=True)
class WorstHand:
    """The corner of the hand's range, of stiffness and damping, in which a loop is least stable."""

    stiffness: float
    """In N/m."""
    damping: float
    """In N·s/m."""
    stable: bool
    """Whether the loop is stable there, by its poles."""

    @property
    def words(self) -> str:
        """Stiffness and damping with their units."""
        return f"a hand of {self.stiffness:g} N/m and {self.damping:g} N·s/m"


@dataclass(frozen=True)
class Judgement:
    """A model at one rate on the device of the settings: of analysis and simulation the worse one is the verdict."""

    model: RenderedModel
    analysis: Analysis
    run: LoopRun
    fitted: FittedModel | None = None
    """What was exported."""
    worst_hand: WorstHand | None = None
    """None where a loop has too many states to look for it."""
    lowest_passive_rate: float | None = None
    lowest_stable_rate: float | None = None
    """`lowest_passive_rate`, `lowest_stable_rate`: in Hz; None where there is none, or where the model has effects and
    only its own rate was looked at."""

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
        hand = ""
        if self.worst_hand:
            hand = f"; {'stable' if self.worst_hand.stable else 'UNSTABLE'} in {self.worst_hand.words}"
        return f"{analysis.name} at {analysis.clocks}: {state} ({analysis.numbers}; simulated, {run.outcome}{hand})"

    @property
    def safe(self) -> bool:
        """Whether it is stable in the hand of the settings and in the worst corner of the hand's range."""
        return self.stable and (self.worst_hand is None or self.worst_hand.stable)
