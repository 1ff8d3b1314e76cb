"""Both methods behind one interface: closed loops and settings in, funnels and their checks out.

========================= ======================================================================================
`exact`                   largest funnel of the given V, with the true sine (`exact_funnel`); proved between its knots
                          (`interval_proof`) with a small margin
`thesis`                  Eqs 4.5–4.7 to the letter, ρ̇ frozen: no certificate (`eqs_4_5_to_4_7_alternation`)
========================= ======================================================================================

Both read the same keys of the section ``stability``, take the same loops (either sign of gravity, any Q, R, Qf, b, mass),
and raise `NumericalError` naming subject, COM and plane rather than return what is not a result.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from lumbar.lifting.stability.funnel.exact_funnel import Funnels, funnel_variants
from lumbar.lifting.stability.funnel.interval_proof import proved_share
from lumbar.lifting.stability.model.eq_4_2_regulator import ClosedLoops
from lumbar.lifting.stability.programme.eqs_4_5_to_4_7_alternation import (
    EVIDENCE,
    RESOLUTION,
    alternate,
)
from lumbar.settings.stability import StabilitySettings


@dataclass(frozen=True)
class MethodResult:
    """What a method returns."""

    funnels: Funnels
    checks: dict[str, np.ndarray] = field(default_factory=dict)
    """Shape (pendulums,): by column of ``boa.csv``."""
    control: Funnels | None = None
    """Funnels that are too large on purpose, for the negative control of the Monte Carlo check."""
    resolution: dict[str, float] = field(default_factory=dict)
    """How far an area may be trusted, relative, by column; an area without entry has all its digits."""


def exact(loops: ClosedLoops, settings: StabilitySettings) -> MethodResult:
    """Compute the largest funnels and prove those with a margin between the knots."""
    simulated, proved = "simulation" in settings.checks, "proof" in settings.checks
    overstated = settings.attack.control_overstated if simulated else 0.0
    margin = settings.proof.margin_1_s if proved else 0.0
    found, checks = funnel_variants(loops, settings.goal_level, margin, overstated), {}
    if proved:
        checks["proved_share"] = proved_share(loops, found.with_margin)
        checks["proved_area_ratio"] = found.with_margin.mean_area / found.exact.mean_area
    return MethodResult(found.exact, checks, found.negative_control if simulated else None)


def thesis(loops: ClosedLoops, settings: StabilitySettings) -> MethodResult:
    """Run the thesis's procedure and say what its areas rest on."""
    found = alternate(loops, **vars(settings.thesis_method))
    areas = {f"mean_area_after_{number}": found.after[number - 1].mean_area for number in EVIDENCE}
    checks = {name: getattr(found, name) for name in ("violation_share", "unsolved_share", "euler_error")}
    checks |= {
        "jumped_knots": (found.jumps != 1).sum(axis=0),
        "largest_jump": found.jumps.max(axis=0),
        **dict(zip(("first_jump", "last_jump"), found.jump_range, strict=True)),
        **areas,
    }
    return MethodResult(
        found.funnels, checks, resolution=RESOLUTION | dict.fromkeys(areas, RESOLUTION["mean_area"])
    )


METHODS: dict[str, Callable[..., MethodResult]] = {"exact": exact, "thesis": thesis}
"""By the name in the column ``method``."""


def thesis_methods(settings: StabilitySettings) -> list[str]:
    """Names of the methods that a configuration asks for on the pendulums of the thesis's wording; the exact one always."""
    return ["exact", *(["thesis"] if "thesis_method" in settings.checks else [])]
