"""The measures by name: what each is, its unit, which way is safer, and where it comes from."""

from __future__ import annotations

from dataclasses import dataclass, field

from lumbar.lifting.measures.back_load import TRUNK_SOURCE
from lumbar.lifting.measures.balance import ANKLE_SOURCE

ALL, SAGITTAL, FRONTAL = "all", "flexion_extension", "lateral_bending"
"""All directions, or one of the planes of `lumbar.lifting.movement.pendulum_states.PLANES`."""
HIGHER, LOWER = "higher", "lower"
CARRIED, DEPOSIT = "carried", "deposit"
WINDOWS = {
    CARRIED: "from lift-off to release, or as far of it as was recorded",
    DEPOSIT: "from the start of the deposit to the release",
}
"""Phases of a lift that a number may be of."""
SMALLEST, LARGEST, FARTHEST, AT_RELEASE, INTEGRAL = (
    "smallest",
    "largest",
    "farthest",
    "at_release",
    "integral",
)
"""How one number is made of a course in time; farthest is the largest from zero."""


@dataclass(frozen=True)
class Measure:
    """One measure of a lift."""

    name: str
    """Identifier in all tables."""
    symbol: str
    unit: str
    """`symbol`, `unit`: for print."""
    safer: str
    """Which way is farther from a step, or kinder to the back."""
    meaning: str
    """One sentence, with the sign."""
    source: str
    """Equation and paper."""
    columns: dict[str, str] = field(hash=False)
    """By plane: the column of `lumbar.lifting.measures.course.course_of_lift` that it is made of."""
    how: str
    """One of the words above."""
    phase: str = DEPOSIT
    """One of `WINDOWS`."""
    headline: bool = False
    """Whether it is among those that a summary names."""


HOF = "Hof, Gazendam and Sinke, J. Biomech. 38 (2005) 1-8"
FUNCTIONAL = (
    "functional part of the base: Holbein and Redfern, Int. J. Ind. Ergon. 19 (1997) 387-395; length and breadth of the foot: "
    "Drillis and Contini (1966)"
)
KOOLEN = f"Koolen et al., Int. J. Robotics Research 31 (2012) 1094-1113; ankle torques: {ANKLE_SOURCE}"
PLAMONDON = "Plamondon et al., Ergonomics 53 (2010) 1239-1253"
DYNAMICS = (
    "top-down inverse dynamics, Winter, Biomechanics and Motor Control of Human Movement, 4th ed. (2009), section 5; radii of "
    "gyration: Winter (2009), Table 4.1, and de Leva, J. Biomech. 29 (1996) 1223-1230"
)


def _planes(stem: str, unit: str) -> dict[str, str]:
    return {plane: f"{stem}_{plane}_{unit}" for plane in (SAGITTAL, FRONTAL)}


MEASURES = {
    measure.name: measure
    for measure in (
        Measure(
            "l5s1_moment_peak_carried",
            "M_c",
            "N·m",
            LOWER,
            "Largest resultant net moment about L5/S1 over the whole lift",
            f"{DYNAMICS}; {PLAMONDON}",
            {ALL: "l5s1_moment_N_m"},
            LARGEST,
            phase=CARRIED,
            headline=True,
        ),
        Measure(
            "lumbar_flexion_peak_carried",
            "β_c",
            "°",
            LOWER,
            "Largest flexion between thorax and pelvis beyond that of standing upright, over the whole lift",
            PLAMONDON,
            {SAGITTAL: "lumbar_flexion_deg"},
            LARGEST,
            phase=CARRIED,
            headline=True,
        ),
        Measure(
            "margin_of_stability",
            "b",
            "m",
            HIGHER,
            "Smallest signed distance of the extrapolated centre of mass, body with box, to the edge of the functional base of "
            "support; negative outside; in a plane the smaller of both directions",
            f"{HOF}, Eq. 5; {FUNCTIONAL}",
            {ALL: "margin_of_stability_m", **_planes("margin_of_stability", "m")},
            SMALLEST,
            headline=True,
        ),
        Measure(
            "smallest_impulse",
            "J",
            "N·s",
            HIGHER,
            "Smallest horizontal push that takes the extrapolated centre over that edge, m·ω0·b",
            f"{HOF}; {FUNCTIONAL}",
            {ALL: "smallest_impulse_N_s", **_planes("smallest_impulse", "N_s")},
            SMALLEST,
            headline=True,
        ),
        Measure(
            "capture_margin",
            "c",
            "m",
            HIGHER,
            "Smallest distance of the instantaneous capture point to where feet and ankles can bring the centre of pressure; "
            "positive: capturable without a step",
            KOOLEN,
            _planes("capture_margin", "m"),
            SMALLEST,
        ),
        Measure(
            "viability_margin",
            "J_v",
            "N·s",
            HIGHER,
            "Smallest impulse after which the nonlinear pendulum with the same limits of torque cannot be stopped without a step",
            f"separatrix in closed form (lumbar.lifting.measures.balance); {KOOLEN}",
            _planes("viability_margin", "N_s"),
            SMALLEST,
        ),
        Measure(
            "trunk_inclination_peak",
            "α",
            "°",
            LOWER,
            "Largest inclination of the line L5/S1 to C7/T1 from straight up, forward positive",
            PLAMONDON,
            {SAGITTAL: "trunk_inclination_deg"},
            LARGEST,
        ),
        Measure(
            "trunk_inclination_release",
            "α_r",
            "°",
            LOWER,
            "Inclination of the line L5/S1 to C7/T1 when the box is released, forward positive",
            PLAMONDON,
            {SAGITTAL: "trunk_inclination_deg"},
            AT_RELEASE,
        ),
        Measure(
            "lumbar_flexion_peak",
            "β",
            "°",
            LOWER,
            "Largest flexion between thorax and pelvis beyond that of standing upright",
            PLAMONDON,
            {SAGITTAL: "lumbar_flexion_deg"},
            LARGEST,
        ),
        Measure(
            "lumbar_flexion_release",
            "β_r",
            "°",
            LOWER,
            "Flexion between thorax and pelvis beyond that of standing upright when the box is released",
            PLAMONDON,
            {SAGITTAL: "lumbar_flexion_deg"},
            AT_RELEASE,
        ),
        Measure(
            "l5s1_moment_peak",
            "M",
            "N·m",
            LOWER,
            "Largest net moment about L5/S1 of trunk, head, arms and box: resultant, extension, and lateral to either side",
            DYNAMICS,
            {ALL: "l5s1_moment_N_m", SAGITTAL: "l5s1_extension_N_m", FRONTAL: "l5s1_lateral_N_m"},
            FARTHEST,
        ),
        Measure(
            "l5s1_moment_per_kg",
            "M/m",
            "N·m/kg",
            LOWER,
            "Largest resultant net moment about L5/S1 per kilogram of body mass",
            DYNAMICS,
            {ALL: "l5s1_moment_per_kg_N_m_kg"},
            LARGEST,
        ),
        Measure(
            "l5s1_moment_strength_share",
            "M/M_max",
            "1",
            LOWER,
            "Largest share of the mean extension strength at the trunk's inclination that the extension moment takes",
            f"{DYNAMICS}; strength: {TRUNK_SOURCE}",
            {SAGITTAL: "l5s1_strength_share"},
            LARGEST,
        ),
        Measure(
            "l5s1_moment_integral",
            "∫M dt",
            "N·m·s",
            LOWER,
            "Resultant net moment about L5/S1 added up over the deposit",
            f"{DYNAMICS}; cumulative load: Coenen et al., Occup. Environ. Med. 71 (2014) 332-337",
            {ALL: "l5s1_moment_N_m"},
            INTEGRAL,
        ),
    )
}
"""All measures by name, in the order of the tables."""
