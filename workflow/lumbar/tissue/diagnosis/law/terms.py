"""The library of physical terms that a missing force may be a sum of, each with the units of its parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

from lumbar.tissue.models.expression import Symbol, parse, substitute, to_text
from lumbar.tissue.models.form import Place
from lumbar.tissue.models.parameter import Constant, NonlinearParameter

FASTEST = Constant("t_f", 0.001, "s")
"""Time in which a state follows at once: a latch closes, a largest depth is reached. A step sees where it begins, so the
force asks the present position too."""
_UNIT_SPEED = Constant("v_1", 1.0, "{x}/s")


@dataclass(frozen=True)
class Term:
    """Something that a force may be proportional to."""

    name: str
    """Unique in the library."""
    words: str
    """What it is, for a reader of the proposal."""
    parts: tuple[str, ...]
    """Expressions; each gets a linear parameter of its own. Of a term at the output, one: what the sensor makes of F."""
    nonlinear: tuple[NonlinearParameter, ...] = ()
    state: tuple[tuple[str, str], ...] = ()
    constants: tuple[Constant, ...] = ()
    knows: str = ""
    """What of the motion it needs, beside the present: ``""``, ``"memory"``, ``"path"`` or ``"time"``."""
    place: Place = Place.PARALLEL
    becomes: str = ""
    """Name of the term that it becomes at the largest lengths: of an exponential growth, what grows."""

    def rename(self, names: dict[str, str]) -> Term:
        """The term with other symbols for its states and nonlinear parameters."""
        trees = {symbol: Symbol(name) for symbol, name in names.items()}

        def text(expression: str) -> str:
            return to_text(substitute(parse(expression), trees))

        return replace(
            self,
            parts=tuple(map(text, self.parts)),
            nonlinear=tuple(
                replace(item, symbol=names.get(item.symbol, item.symbol)) for item in self.nonlinear
            ),
            state=tuple((names.get(name, name), text(rate)) for name, rate in self.state),
        )


def _scaled(symbol: str, name: str, unit: str, scale: str, *grid, reach=(0.2, 5.0)) -> NonlinearParameter:
    return NonlinearParameter(name, unit, scale, *grid, reach=reach, symbol=symbol)


_DEPTH = _scaled("z_d", "depth", "{x}", "position", 0.15, 0.8, 4, reach=(0.3, 1.25))
_WIDTH = _scaled("w", "width", "{x}", "position", 0.1, 0.8, 4)
_LENGTH = _scaled("z_e", "length", "{x}", "position", 0.2, 1.5, 4)
_SPEED = _scaled("v_s", "speed", "{x}/s", "speed", 0.005, 0.8, 5)
_FALL = _scaled("v_t", "speed_of_fall", "{x}/s", "speed", 0.05, 0.8, 3)
_TAU = _scaled("tau", "relaxation_time", "s", "time", 0.01, 20.0, 8, reach=(0.3, 4.0))
_DISTANCE = _scaled("d", "presliding_distance", "{x}", "position", 0.01, 1.0, 5)
_ALONG = _scaled("s_0", "path_constant", "{x}", "path", 0.003, 1.0, 5)
_WEAR = _scaled("d", "breakdown_distance", "{x}", "position", 0.3, 30.0, 4)
_HEALING = _scaled("tau", "recovery_time", "s", "time", 0.1, 30.0, 4)
_WELL = _scaled("w", "width", "{x}", "position", 0.05, 1.2, 4)
_SNAPPING = _scaled("tau", "snapping_time", "s", "time", 0.005, 1.0, 5, reach=(0.3, 4.0))
_EXPONENT = _scaled("p", "exponent", "1", "one", 0.3, 2.5, 4, reach=(0.5, 1.5))


@dataclass(frozen=True)
class _Factor:
    """What terms are products of."""

    text: str
    words: str = ""
    nonlinear: tuple[NonlinearParameter, ...] = ()
    state: tuple[tuple[str, str], ...] = ()
    constants: tuple[Constant, ...] = ()
    knows: str = ""


_DEPTHS = {
    "": _Factor("1"),
    "z": _Factor("z", "growing with position"),
    "z2": _Factor("z**2", "growing with the square of position"),
    "abs_z": _Factor("abs(z)", "growing with the distance from zero"),
    "push": _Factor("max(z, 0)", "growing with depth, on one side only"),
    "deep": _Factor("max(z - z_d, 0)", "beyond a depth", (_DEPTH,)),
    "shallow": _Factor("min(z + z_d, 0)", "beyond a depth on the other side", (_DEPTH,)),
    "exp": _Factor("exp(z/z_e)", "growing exponentially with position", (_LENGTH,)),
    "bump": _Factor("exp(-(z/w)**2)", "near zero position", (_WIDTH,)),
}
_POSITIONS = {
    "constant": _Factor("1", "a constant force"),
    "z": _Factor("z", "stiffness"),
    "z2": _Factor("z**2", "stiffness that differs between directions"),
    "abs_z": _Factor("abs(z)", "a kink of the stiffness at zero"),
    "z3": _Factor("z**3", "cubic stiffness"),
    "z5": _Factor("z**5", "stiffness of the fifth order"),
    "deep": _Factor("max(z - z_d, 0)", "stiffness beyond a depth", (_DEPTH,)),
    "shallow": _Factor("min(z + z_d, 0)", "stiffness beyond a depth on the other side", (_DEPTH,)),
    "step": _Factor("tanh(z/w)", "a step of the force at zero position", (_WIDTH,)),
    "bump": _Factor("exp(-(z/w)**2)", "a hump of the force about zero", (_WIDTH,)),
    "odd_bump": _Factor("z*exp(-(z/w)**2)", "a spring that gives way (snap-through)", (_WIDTH,)),
    "bump_deep": _Factor("exp(-((z - z_d)/w)**2)", "a hump of the force at a depth", (_DEPTH, _WIDTH)),
    "bump_shallow": _Factor(
        "exp(-((z + z_d)/w)**2)", "a hump of the force at a depth on the other side", (_DEPTH, _WIDTH)
    ),
    "expm1": _Factor("expm1(z/z_e)", "exponential stiffness of one direction", (_LENGTH,)),
    "exponential": _Factor("sign(z)*expm1(abs(z)/z_e)", "exponential stiffness", (_LENGTH,)),
}
_RATES = {
    "viscous": _Factor("v", "viscous damping"),
    "quadratic": _Factor("v*abs(v)", "quadratic damping"),
    "friction": _Factor("tanh(v/v_s)", "friction", (_SPEED,)),
    "falling_friction": _Factor(
        "tanh(v/v_s)*exp(-abs(v)/v_t)", "friction that falls with speed", (replace(_SPEED, points=4), _FALL)
    ),
    "saturating": _Factor("v/(1 + (v/v_s)**2)", "damping that fades with speed", (_SPEED,)),
    "power": _Factor("sign(v)*abs(v/v_1)**p", "power-law damping", (_EXPONENT,), (), (_UNIT_SPEED,)),
    "even": _Factor("abs(v)", "a force that grows with speed in either direction"),
    "advancing": _Factor("max(v, 0)", "damping while advancing only"),
}
_RELAXED = (("q", "v - q/tau"),)
_MEMORIES = {
    "branch": _Factor("q", "a relaxing branch", (_TAU,), _RELAXED, (), "memory"),
    "settling_branch": _Factor(
        "(z - u)", "a relaxing branch that was at rest at zero position before the record", (_TAU,),
        (("u", "(z - u)/tau"),), (), "memory",
    ),
    "branch_squared": _Factor("q**2", "an even force of a relaxing branch", (_TAU,), _RELAXED, (), "memory"),
    "branch_cubed": _Factor("q**3", "a relaxing branch that stiffens", (_TAU,), _RELAXED, (), "memory"),
    "presliding": _Factor(
        "r", "friction that builds up after reversals", (_DISTANCE,),
        (("r", "v/d*(1 - r*sign(v))"),), (), "memory",
    ),
}  # fmt: skip
_WITH = {
    "falling_friction": ("", "z", "abs_z", "push"),
    "settling_branch": ("", "exp"),
    "branch_squared": ("",),
    "branch_cubed": ("",),
}
"""Depths that factors are multiplied by, where not by all."""
_BROKEN = (("l", "abs(v)/d*(1 - l) - l/tau"),)
_DEEPEST = (("m", "max(abs(z) - m, 0)/t_f"),)
_DEEPEST_PUSH = (("m", "max(z - m, 0)/t_f"),)
_STATES = {
    "broken": _Factor(
        "l", "of a structure that motion breaks down and rest rebuilds (thixotropy)", (_WEAR, _HEALING),
        _BROKEN, (), "memory",
    ),
    "deepest": _Factor("max(m, abs(z))", "with the largest distance from zero so far", (), _DEEPEST, (FASTEST,), "memory"),
    "virgin": _Factor(
        "exp(-max(m, abs(z))/z_e)", "lost with the largest distance from zero so far (damage)", (_LENGTH,), _DEEPEST, (FASTEST,),
        "memory",
    ),
    "unloading": _Factor(
        "tanh(max(m - abs(z), 0)/z_e)", "lost below the largest distance from zero so far (Mullins)", (_LENGTH,), _DEEPEST,
        (FASTEST,), "memory",
    ),
    "unloading_push": _Factor(
        "tanh(max(m - max(z, 0), 0)/z_e)", "lost below the largest depth so far (Mullins)", (_LENGTH,), _DEEPEST_PUSH,
        (FASTEST,), "memory",
    ),
    "worn": _Factor("exp(-s/s_0)", "worn off with the path travelled", (_ALONG,), (), (), "path"),
}  # fmt: skip
_SPEED_OF_FEW = replace(_SPEED, points=3)
_CARRIERS = {
    "stiffness": _Factor("z", "stiffness"),
    "push": _Factor("max(z, 0)", "stiffness of one direction"),
    "cubic": _Factor("z**3", "cubic stiffness"),
    "viscous": _Factor("v", "viscous damping"),
    "friction": _Factor("tanh(v/v_s)", "friction", (_SPEED_OF_FEW,)),
}


def _product(name: str, words: str, *factors: _Factor) -> Term:
    text = "*".join(item.text for item in factors if item.text != "1") or "1"
    joined = {
        field: tuple(entry for item in factors for entry in getattr(item, field))
        for field in ("nonlinear", "state", "constants")
    }
    becomes = name.removesuffix("_exp") if name.endswith("_exp") else ""
    return Term(
        name, words, (text,), **joined, knows="".join(item.knows for item in factors), becomes=becomes
    )


def _products() -> list[Term]:
    """Position alone, rate times depth, memory times depth, and what a state of the material acts on."""
    found = [_product(f"position_{name}", item.words, item) for name, item in _POSITIONS.items()]
    for name, item in {**_RATES, **_MEMORIES}.items():
        found += [
            _product(f"{name}_{depth}".rstrip("_"), f"{item.words} {factor.words}".strip(), factor, item)
            for depth, factor in _DEPTHS.items()
            if depth in _WITH.get(name, _DEPTHS)
        ]
    found += [
        _product(f"{carrier}_{name}", f"{item.words} {state.words}", item, state)
        for name, state in _STATES.items()
        for carrier, item in _CARRIERS.items()
    ]
    return found


_FROM_ZERO = "at rest at zero position before the record"
_SPREAD = 8
"""Ratio of neighbouring relaxation times of a power law: four branches span nearly three decades."""


def _power_law() -> tuple[Term, Term]:
    """Springpot: relaxation that falls as a power of time, by four branches (Schiessel and Blumen, J. Phys. A 26, 1993)."""
    words = "relaxation as a power of time (fractional damping)"
    times = _scaled("tau", "shortest_time", "s", "time", 0.003, 0.3, 4, reach=(0.3, 4.0))
    exponent = _scaled("p", "exponent", "1", "one", 0.15, 0.8, 3, reach=(0.3, 1.5))
    taus = ["tau", *(f"({_SPREAD**n}*tau)" for n in range(1, 4))]
    weights = [f"{_SPREAD**n}**(-p)*" for n in range(1, 4)]
    moving = " + ".join(["q0", *(f"{weight}q{n}" for n, weight in enumerate(weights, 1))])
    from_zero = " + ".join(["z - u0", *(f"{weight}(z - u{n})" for n, weight in enumerate(weights, 1))])
    states = tuple((f"q{n}", f"v - q{n}/{tau}") for n, tau in enumerate(taus))
    zeros = tuple((f"u{n}", f"(z - u{n})/{tau}") for n, tau in enumerate(taus))
    return _both("power_law", words, (times, exponent), (moving, states), (from_zero, zeros))


def _diffusion() -> tuple[Term, Term]:
    """Fluid pressed out of a layer: relaxation times as 1, 1/9, 1/25, strengths alike (Biot, J. Appl. Phys. 12, 1941)."""
    words = "fluid that is pressed out and flows back (poroelastic)"
    times = _scaled("tau", "consolidation_time", "s", "time", 0.03, 30.0, 7, reach=(0.3, 4.0))
    states = tuple((f"q{n}", f"v - {n * n}*q{n}/tau") for n in (1, 3, 5))
    zeros = tuple((f"u{n}", f"{n * n}*(z - u{n})/tau") for n in (1, 3, 5))
    from_zero = "z - u1 + (z - u3)/9 + (z - u5)/25"
    return _both("diffusion", words, (times,), ("q1 + q3/9 + q5/25", states), (from_zero, zeros))


def _both(name: str, words: str, nonlinear, moving, from_zero) -> tuple[Term, Term]:
    """A relaxation at rest where the record begins, and one at rest at zero; each as its force and its states."""
    return (
        Term(name, words, (moving[0],), nonlinear, moving[1], (), "memory"),
        Term(
            f"settling_{name}",
            f"{words}, {_FROM_ZERO}",
            (from_zero[0],),
            nonlinear,
            from_zero[1],
            (),
            "memory",
        ),
    )


def _special() -> list[Term]:
    """Terms that are no products."""
    waves = tuple(f"{wave}(2*pi*z/lambda_z)" for wave in ("sin", "cos"))
    pitch = _scaled("lambda_z", "pitch", "{x}", "position", 0.1, 2.0, 24, reach=(0.9, 1.1))
    strength = _scaled("z_e", "length", "{x}", "position", 0.2, 1.5, 3)
    tear = _scaled("z_d", "depth", "{x}", "position", 0.05, 0.9, 16, reach=(0.8, 1.25))
    memory = {"knows": "memory"}
    return [
        Term("cogging", "a force that repeats along the position (cogging)", waves, (pitch,)),
        *(term for pair in zip(_power_law(), _diffusion(), strict=True) for term in pair),
        Term(
            "eased_branch", "a relaxing branch that flows more easily at large force", ("q",),
            (_TAU, strength), (("q", "v - q/tau*(1 + abs(q)/z_e)"),), **memory,
        ),
        Term(
            "tight_branch", "a branch that relaxes more slowly with depth (permeability falls)", ("q",),
            (_TAU, strength), (("q", "v - q/tau*exp(-z/z_e)"),), **memory,
        ),
        Term(
            "loose_branch", "a branch that relaxes faster with depth", ("q",),
            (_TAU, strength), (("q", "v - q/tau*exp(z/z_e)"),), **memory,
        ),
        Term(
            "push_branch", "a relaxing branch that is loaded by pushing only", ("q",),
            (_TAU,), (("q", "max(v, 0) - q/tau"),), **memory,
        ),
        Term(
            "adhesion", "adhesion: after contact it pulls back until it tears", ("where(z < -z_d, 0, b*min(z, 0))",), (tear,),
            (("b", "where(z > 0, (1 - b)/t_f, where(z < -z_d, -b/t_f, 0))"),), (FASTEST,), **memory,
        ),
        Term(
            "detachment", "adhesion about a surface: a pull that is there only after it was touched",
            ("where(z < -z_d, 0, b*exp(z/z_e))",),
            (tear, strength), (("b", "where(z > 0, (1 - b)/t_f, where(z < -z_d, -b/t_f, 0))"),), (FASTEST,),
            **memory,
        ),
        Term(
            "snap_through", "a part that snaps through: it rests in two places and takes its time from one to the other", ("u",),
            (_WELL, _SNAPPING), (("u", "(z + u*(1 - (u/w)**2))/tau"),), **memory,
        ),
        Term(
            "snap", "a part that snaps from one place to another and back", ("where(z > z_d, 1, where(z < -z_d, -1, b))",),
            (tear,), (("b", "where(z > z_d, (1 - b)/t_f, where(z < -z_d, -(1 + b)/t_f, 0))"),), (FASTEST,), **memory,
        ),
    ]  # fmt: skip


def _at_the_sensor() -> list[Term]:
    """What a sensor makes of the force: gains that change."""
    share = _scaled("g", "share", "1", "one", 0.05, 0.2, 2, reach=(0.05, 4.0))
    phase = _scaled("p", "phase", "1", "one", 0.8, 5.5, 4, reach=(0.01, 1.6))
    frequency = _scaled("f", "frequency", "Hz", "rate", 0.01, 2.0, 1)
    level = _scaled("F_g", "force_scale", "{y}", "force", 1.0, 8.0, 3, reach=(0.3, 10.0))
    warming = _scaled("T", "settling_time", "s", "duration", 0.05, 1.0, 3, reach=(0.3, 3.0))
    out = {"place": Place.OUTPUT}
    return [
        Term(
            "gain_cycle", "a gain that swells and fades (temperature)", ("F*(1 + g*sin(2*pi*f*t + p))",),
            (share, frequency, phase), knows="time", **out,
        ),
        Term("gain_rises", "a gain that settles upwards", ("F*(1 - g*expm1(-t/T))",), (share, warming), knows="time", **out),
        Term("gain_falls", "a gain that settles downwards", ("F*(1 + g*expm1(-t/T))",), (share, warming), knows="time", **out),
        Term("gain_up", "a gain that rises with the force", ("F*(1 + F/F_g)",), (level,), **out),
        Term("gain_down", "a gain that falls with the force", ("F*(1 - F/F_g)",), (level,), **out),
    ]  # fmt: skip


@cache
def library() -> tuple[Term, ...]:
    """All terms."""
    return (*_products(), *_special(), *_at_the_sensor())


def knows(terms: tuple[Term, ...]) -> set[str]:
    """What terms need of the motion beside the present."""
    return {word for term in terms for word in ("memory", "path", "time") if word in term.knows}
