"""Linear dynamics of higher order as a base: an equation with states, as models' files, pages and FMUs hold it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lumbar.tissue.effects.notation import carried_bases
from lumbar.tissue.models.state_equation import MOST_STATES

if TYPE_CHECKING:
    from lumbar.tissue.diagnosis.linear.linear_dynamics import LinearDynamics
    from lumbar.tissue.models.bases import Base

NAME = "linear_dynamics"
_DIRECT = (
    ("k", "z", "stiffness", "{y}/{x}"),
    ("b", "v", "viscosity", "{y} s/{x}"),
    ("m", "a", "mass", "{y} s^2/{x}"),
)
"""Symbol, signal, name and unit of what acts beside the poles."""


def linear_base(model: LinearDynamics) -> Base | None:
    """The base whose equation a linear model is, its poles where a fit begins.

    None for an input that is held between jumps, behind a delay, and for more poles than an equation has states.
    """
    poles = model.poles
    if model.held or poles.delay or poles.order > MOST_STATES:
        return None
    direct = _DIRECT[: poles.direct - 1]
    terms = [f"{symbol}*{signal}" for symbol, signal, *_ in direct]
    parameters = {symbol: _linear(name, unit) for symbol, _, name, unit in direct}
    states = {}
    for number, (damping, square) in enumerate(poles.sections, 1):
        # A pair of poles, s² + a s + c: its state p and the rate w of that.
        slow, fast, a, c, f, g = (f"{letter}_{number}" for letter in "pwacfg")
        states |= {slow: fast, fast: f"v - {a}*{fast} - {c}*{slow}"}
        terms += [f"{f}*{slow}", f"{g}*{fast}"]
        parameters |= {
            f: _linear(f"pair_stiffness_rate_{number}", "{y}/({x} s)"),
            g: _linear(f"pair_stiffness_{number}", "{y}/{x}"),
            a: _nonlinear(f"pair_damping_{number}", "1/s", damping),
            c: _nonlinear(f"pair_frequency_squared_{number}", "1/s^2", square),
        }
    for number, rate in enumerate(poles.rates, 1):
        state, stiffness, symbol = (f"{letter}_{number}" for letter in "qhr")
        states[state] = f"v - {symbol}*{state}"
        terms.append(f"{stiffness}*{state}")
        parameters |= {
            stiffness: _linear(f"branch_stiffness_{number}", "{y}/{x}"),
            symbol: _nonlinear(f"relaxation_rate_{number}", "1/s", rate),
        }
    definition = {
        "name": NAME,
        "mechanism": f"Linear dynamics of {poles.order} poles, without names.",
        "equation": " + ".join(terms),
        "state": states,
        "parameters": parameters,
    }
    return carried_bases({"bases": {NAME: definition}})[NAME]


def _linear(name: str, unit: str) -> dict:
    return {"name": name, "unit": unit, "sign": "any"}


def _nonlinear(name: str, unit: str, value: float) -> dict:
    start = [float(value), float(value)]
    return {"name": name, "unit": unit, "start": start, "scale": "one", "points": 1}
