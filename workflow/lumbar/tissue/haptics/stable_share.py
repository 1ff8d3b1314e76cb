"""In which share of the fits and hands a loop is stable: hands from loose to firm, fits within their parameters' intervals."""

from dataclasses import dataclass, replace

import numpy as np
import scipy

from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.haptics.closed_loop import SampledModel
from lumbar.tissue.haptics.passive_fit import Branches
from lumbar.tissue.haptics.rendered_model import RenderedModel
from lumbar.tissue.haptics.simulation import on_servo
from lumbar.tissue.haptics.ticks.sequence import in_ticks
from lumbar.tissue.models.fitted_model import FittedModel

_PARAMETERS = ("spring_stiffness", "branch_stiffness", "relaxation_time")
_NORMAL_95 = 1.959964
_PRIMES = (2, 3, 5, 7, 11)
_LARGEST = 100
"""States of a loop that is looked at in many hands: a linearisation that is kept as its long impulse response has more."""


@dataclass(frozen=True)
class StableShare:
    """What was found over the draws."""

    share: float
    """Of the draws in which the loop is stable."""
    stiffness: float
    damping: float
    """`stiffness`, `damping`: of the hand in which it is least so, N/m and N·s/m."""
    fit: dict[str, float]
    """Parameters of the fit in that draw; empty where the file has no intervals, and hands alone vary."""

    @property
    def worst(self) -> str:
        """The draw in which the loop is least stable, in words."""
        fit = "".join(f", {name.replace('_', ' ')} {value:.3g}" for name, value in self.fit.items())
        return f"a hand of {self.stiffness:.0f} N/m and {self.damping:.2g} N·s/m{fit}"

    @property
    def finding(self) -> str:
        """A few words with the numbers."""
        return f"stable in {100 * self.share:.0f} % of the {'fits and ' if self.fit else ''}hands, least so in {self.worst}"


def stable_share(
    meets: RenderedModel, moving_average: int, fitted: FittedModel | None, device: DeviceSettings
) -> StableShare | None:
    """Draw hands, and fits where their intervals are known, and look at the poles of each loop.

    Hands are drawn evenly in the logarithm of their stiffness and in their damping, within the settings' ranges; parameters
    of a fit one by one, normal with their 95 % intervals, as the file holds no covariance of them. The draws are Halton's
    points and the same for every model.

    `moving_average` is the number of samples of the average before the model. None where no hands are asked for, or a
    linearisation has too many states.
    """
    parameters = _parameters(fitted) if len(meets.sampled) == 1 else {}
    loops = [in_ticks(loop) for loop in meets.loops]
    if not device.hands or any(len(loop.states[0]) > _LARGEST for loop in loops):
        return None
    radii, draws = [], []
    for number in range(1, device.hands + 1):
        hand, lean, *chances = (_mirrored(number, base) for base in _PRIMES[: 2 + len(parameters)])
        held = _hand(device, hand, lean)
        fit = {
            name: _drawn(item, chance)
            for (name, item), chance in zip(parameters.items(), chances, strict=True)
        }
        own = _loops_of(fit, meets, moving_average, held) if fit else loops
        radii.append(max(float(np.abs(np.linalg.eigvals(loop.monodromy(held))).max()) for loop in own))
        draws.append((held.hand_stiffness_N_m, held.hand_damping_N_s_m, fit))
    return StableShare(float(np.mean(np.array(radii) < 1.0)), *draws[int(np.argmax(radii))])


def _mirrored(number: int, base: int) -> float:
    """A number's digits behind the point, the last one first: a coordinate of Halton's points."""
    found, place = 0.0, 1.0 / base
    while number:
        number, digit = divmod(number, base)
        found, place = found + digit * place, place / base
    return found


def _hand(device: DeviceSettings, hand: float, lean: float) -> DeviceSettings:
    (loose, firm), (low, high) = device.hands_stiffness_N_m, device.hands_damping_N_s_m
    stiffness = loose * (firm / loose) ** hand
    return replace(device, hand_stiffness_N_m=stiffness, hand_damping_N_s_m=low + lean * (high - low))


def _parameters(fitted: FittedModel | None) -> dict:
    """Those of a spring, a Maxwell branch or both, where all have intervals."""
    if fitted is None or not fitted.discrete:
        return {}
    found = {item.name: item for item in fitted.parameters if item.name in _PARAMETERS and not item.derived}
    return found if found and all(item.low is not None for item in found.values()) else {}


def _drawn(parameter, chance: float) -> float:
    at = scipy.special.ndtri(chance) / _NORMAL_95
    end = parameter.high if at > 0 else parameter.low
    return max(parameter.value + abs(at) * (end - parameter.value), 1e-9 * parameter.value)


def _loops_of(
    fit: dict[str, float], meets: RenderedModel, moving_average: int, device: DeviceSettings
) -> list:
    """The loops of a model whose parameters are drawn."""
    times = {"spring_stiffness": np.inf, "branch_stiffness": fit.get("relaxation_time", np.inf)}
    springs = [name for name in times if name in fit]
    nominal = meets.sampled[0]
    branches = Branches(tuple(fit[name] for name in springs), tuple(times[name] for name in springs))
    step = nominal.sampling_time
    drawn = SampledModel.of(nominal.name, branches.transfer_function(step), step)
    average = np.full(moving_average, meets.newton / meets.metre / moving_average)
    model = replace(drawn, numerator=np.convolve(drawn.numerator, average))
    uneven = [replace(item.loop, model=model) for item in meets.timings]
    return [in_ticks(loop) for loop in on_servo(model, device)] + uneven
