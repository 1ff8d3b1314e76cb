"""Chapter stability: pendulum, regulator, methods and their checks."""

import math
from typing import Annotated, Literal, get_args

from pydantic import Field, ValidationInfo, field_validator

from lumbar.settings.section import REJECT_REPEATED, Section, Unique, Word

GROUPS = ("expert", "novice")
"""Groups that the thesis compares."""
Share = Annotated[float, Field(ge=0, le=10)]
Matrix = tuple[tuple[float, float], tuple[float, float]]
Check = Literal["simulation", "thesis_method", "cvxpy", "proof"]


class PendulumSettings(Section):
    """The pendulum of Eq. 4.1."""

    sign: Literal["hanging", "inverted"] = "inverted"
    """Sign of the gravity term in the headline of Table 4.1 and in the figures: inverted (−), as people stand,
    or hanging (+), as Eq. 4.1 is published. Table 4.1 shows the thesis's definition and all signs for every
    value of this key."""
    time: Literal["real", "unit"] = "real"
    """Duration of the trajectories in the headline: real, as recorded, or unit, one second for every deposit."""
    mass: Literal["with_box", "without_box"] = "with_box"
    """Mass of the pendulum in the headline, with or without the box."""
    damping_N_m_s: float = Field(1.0, ge=0, le=1000, json_schema_extra={"unit": "N·m·s/rad"})
    """Damping b."""
    gravity_m_s2: float = Field(9.81, ge=0, le=30)
    """Gravitational acceleration: of the basins, of the effects on a pendulum, and of the twin's hip moments."""


class RegulatorSettings(Section):
    """Weights of the linear-quadratic regulator on angle (rad) and angular velocity (rad/s), equal for all subjects."""

    state_weight: Matrix = ((1.0, 0.0), (0.0, 0.1))
    """Q, symmetric and positive semidefinite, per second."""
    control_weight: float = Field(0.003, gt=0)
    """R in 1/(N²·m²·s), positive."""
    terminal_weight: Matrix = ((100.0, 0.0), (0.0, 10.0))
    """Qf, symmetric and positive definite; the goal set is x̄ᵀ·Qf·x̄ ≤ goal_level."""

    @field_validator("state_weight", "terminal_weight")
    @classmethod
    def _check_definite(cls, weight: Matrix, info: ValidationInfo) -> Matrix:
        (first, upper), (lower, last) = weight
        if upper != lower:
            raise ValueError(f"{[*map(list, weight)]} is not symmetric")
        lowest = (first + last - math.hypot(first - last, 2 * upper)) / 2
        definite = info.field_name == "terminal_weight"
        if lowest < 0 or (definite and lowest == 0):
            kind = "definite" if definite else "semidefinite"
            raise ValueError(f"smallest eigenvalue {lowest:g}; it must be positive {kind}")
        return weight


class ProofSettings(Section):
    """Proof between the knots by interval branch-and-bound (check ``proof``)."""

    margin_1_s: float = Field(0.005, gt=0, le=100)
    """Margin, in 1/s, by which ρ̇/ρ of the proved funnel exceeds the largest V̇/ρ on its boundary; its area is
    about 1 − margin·T/2 of the exact one."""


class ThesisMethodSettings(Section):
    """The thesis's bilinear alternation (Eqs 4.5–4.7) under the thesis's definitions (check ``thesis_method``)."""

    knots: int = Field(1000, ge=2, le=10000)
    """Knots of the alternation (the thesis: 1000); the nearest number that divides the basin's knots evenly is used."""
    initial_level: float = Field(1.0, gt=0, le=1000000.0)
    """First guess of ρ at every knot."""
    ratio: float = Field(0.8, ge=0.1, le=0.99)
    """Ratio of the geometric progression that decreases ρ."""
    alternations: int = Field(2, ge=1, le=20)
    """Alternations (the thesis: 2). From the second one few knots have a multiplier, and ρ jumps there (columns
    jumped_knots, largest_jump, mean_area_after_4)."""


class AttackSettings(Section):
    """Simulated starts in every basin (check ``simulation``)."""

    starts: int = Field(200, ge=2, le=1000000)
    """Starts per basin, half on the boundary, half inside."""
    control_overstated: float = Field(1.0, ge=0.01, le=10)
    """Negative control: factor on |d ln ρ/dt| by which ρ falls too fast, so that starts must leave."""


class LimitSettings(Section):
    """Torque that foot or hips allow a pendulum, for the pushes on the page of a lift."""

    foot_ahead_m: float = Field(0.2, gt=0, le=0.5)
    """Length of the foot ahead of the ankle: about the ankles u ≥ −m·g times this, or the heel lifts. A foot is
    0.152 of the height long (Winter 2009, Figure 4.1), a quarter of it behind the ankle."""
    foot_behind_m: float = Field(0.06, gt=0, le=0.5)
    """Length of the foot behind the ankle: u ≤ m·g times this, or the toes lift."""
    feet_half_width_m: float = Field(0.17, gt=0, le=1)
    """Half the distance between the feet's outer borders, which limits the torque about the ankles to the
    sides."""
    hip_extension_N_m: float = Field(440.0, gt=0, le=10000)
    """Largest backward torque of both hips (isometric strength of young men, 0.161 of body weight times height
    per leg; Anderson, Madigan and Nussbaum 2007). Each pendulum about the hips or L5 may use all of it."""
    hip_flexion_N_m: float = Field(310.0, gt=0, le=10000)
    """Largest forward torque of both hips (0.113 of body weight times height per leg; same source)."""
    hip_abduction_N_m: float = Field(200.0, gt=0, le=10000)
    """Largest torque of both hips to a side: an assumption, 100 N·m per leg."""


class CompareSettings(Section):
    """Groups that Table 4.1 compares."""

    groups: Annotated[tuple[Word, Word], REJECT_REPEATED] = Field(
        GROUPS, json_schema_extra={"uniqueItems": True}
    )
    """Two labels of subjects (experience in their files): the table compares the first with the second,
    100(A_first − A_second)/A_second."""


class MeasureSettings(Section):
    """Measures of movement (margin of stability, impulse to a step, capturability, posture, moment about L5/S1)."""

    functional_share: float = Field(0.6, gt=0, le=1)
    """Functional base of support: its distance from the centre as a share of that of the whole base (0.6 with
    loads, Holbein and Redfern 1997; 1 uses the whole)."""
    contact_height_m: float = Field(0.03, gt=0, le=0.2)
    """Height above its lowest level below which heel or toe are on the ground."""
    contact_speed_m_s: float = Field(0.3, gt=0, le=5)
    """Speed below which heel or toe are on the ground."""


class StabilitySettings(Section):
    """From pendulum states to basins of attraction."""

    pendulum: PendulumSettings = Field(default_factory=PendulumSettings)
    regulator: RegulatorSettings = Field(default_factory=RegulatorSettings)
    goal_level: float = Field(1.0, gt=0, le=1000000.0)
    """ρ at the end of the trajectory."""
    knots: int = Field(1000, ge=50, le=100000)
    """Instants at which a basin is computed (the thesis: 1000; between 505 and 1000 areas change by some 1e-8
    of them)."""
    fewer_knots: int = Field(334, ge=50, le=100000)
    """Instants for the range of Table 4.1 under other weights, its null control and parts, the check with
    cvxpy, the basins of a cohort, and the figure that compares methods."""
    checks: Unique[Check] = get_args(Check)
    """Checks of the exact basins. simulation: starts that must stay inside; thesis_method: Eqs 4.5–4.7 as the
    thesis solves them; cvxpy: some of its programmes again as Eq. 4.6 is written; proof: interval arithmetic
    between the knots."""
    proof: ProofSettings = Field(default_factory=ProofSettings)
    thesis_method: ThesisMethodSettings = Field(default_factory=ThesisMethodSettings)
    attack: AttackSettings = Field(default_factory=AttackSettings)
    limits: LimitSettings = Field(default_factory=LimitSettings)
    compare: CompareSettings = Field(default_factory=CompareSettings)
    measures: MeasureSettings = Field(default_factory=MeasureSettings)
    lyapunov_shares: tuple[Share, ...] = Field((0.0, 0.1, 0.25, 0.5, 1.0), min_length=1)
    """Shares λ of the decay Q + KᵀRK for the search of the best Lyapunov function; 1 is the Riccati solution."""
    sensitivity_factor: float = Field(2.0, ge=1.01, le=100)
    """Factor by which Q, R and b are divided and multiplied for the range in Table 4.1."""
