"""Chapter stability: pendulum, regulator, methods and their checks."""

from typing import Annotated, Literal

from lumbar.base.errors import Problems
from lumbar.settings.key import UNIQUE, Each, Word, key, section, settings

GROUPS = ("expert", "novice")
"""Whom the thesis compares."""
Share = Annotated[float, Each(ge=0, le=10)]
Check = Literal["simulation", "thesis_method", "sum_of_squares", "cvxpy", "proof", "extended"]


@settings
class PendulumSettings:
    """The pendulum of Eq. 4.1."""

    sign: Literal["hanging", "inverted"] = key(
        "Sign of the gravity term in the headline of Table 4.1 and in the figures: inverted (−), as people stand, or hanging "
        "(+), as Eq. 4.1 is published. Table 4.1 shows the thesis's wording and all signs beside it whatever stands here.",
        default="inverted",
    )
    time: Literal["real", "unit"] = key(
        "Duration of the trajectories in the headline: real, as recorded, or unit, every deposit played in one second.",
        default="real",
    )
    mass: Literal["with_box", "without_box"] = key(
        "Whether the box counts to the pendulum's mass in the headline.", default="with_box"
    )
    damping_N_m_s: float = key("Damping b.", default=1.0, unit="N·m·s/rad", within="[0, 1000]")
    gravity_m_s2: float = key(
        "Gravitational acceleration: of the basins, of the effects on a pendulum, and of the twin's hip moments.",
        default=9.81,
        within="[0, 30]",
    )


@settings
class RegulatorSettings:
    """Weights of the linear-quadratic regulator on angle (rad) and angular velocity (rad/s), the same for everybody."""

    state_weight: tuple[tuple[float, float], tuple[float, float]] = key(
        "Q, symmetric and positive semidefinite, per second.", default=((1.0, 0.0), (0.0, 0.1))
    )
    control_weight: float = key("R in 1/(N²·m²·s), positive.", default=0.003, gt=0)
    terminal_weight: tuple[tuple[float, float], tuple[float, float]] = key(
        "Qf, symmetric and positive definite; the goal set is x̄ᵀ·Qf·x̄ ≤ goal_level.",
        default=((100.0, 0.0), (0.0, 10.0)),
    )


def weight_problems(state_weight, control_weight: float, terminal_weight) -> Problems:
    """Collect what keeps the weights of a configuration from being admissible; arguments as of `RegulatorSettings`."""
    import numpy as np

    problems = Problems("stability.regulator")
    for name, matrix, definite in (
        ("state_weight", state_weight, False),
        ("terminal_weight", terminal_weight, True),
    ):
        values = np.asarray(matrix, dtype=float)
        kind = "definite" if definite else "semidefinite"
        if values.shape != (2, 2) or not np.isfinite(values).all() or values[0, 1] != values[1, 0]:
            problems.add(
                name, f"{np.asarray(matrix).tolist()}", "a symmetric 2×2 matrix of numbers is needed"
            )
            continue
        lowest = np.linalg.eigvalsh(values)[0]
        if lowest < 0 or (definite and lowest == 0):
            problems.add(name, f"smallest eigenvalue {lowest:g}", f"it must be positive {kind}")
    if not (np.isfinite(control_weight) and control_weight > 0):
        problems.add("control_weight", f"{control_weight:g}", "it must be positive")
    return problems


@settings
class ProofSettings:
    """Proof between the knots by interval branch-and-bound (check ``proof``)."""

    margin_1_s: float = key(
        "By how much, in 1/s, ρ̇/ρ of the funnel that is proved exceeds the largest V̇/ρ on its "
        "boundary; its area is about 1 − margin·T/2 of the exact one's.",
        default=0.005,
        within="(0, 100]",
    )


@settings
class SumOfSquaresSettings:
    """Certificates by sum-of-squares programmes beside the exact basins (check ``sum_of_squares``)."""

    degree: Literal[3, 5, 7] = key("Degree of the sine's Taylor polynomial.", default=5)
    knots: int = key(
        "Knots of ρ, with a certificate between each two; the nearest number that divides the basin's "
        "knots evenly is taken.",
        default=1000,
        within="[2, 100000]",
    )
    margin_1_s: float = key(
        "Margin left in ρ̇/ρ, in 1/s, above the solver's tolerance.", default=2e-05, within="(0, 1]"
    )


@settings
class ThesisMethodSettings:
    """The thesis's bilinear alternation (Eqs 4.5–4.7) on the thesis's wording (check ``thesis_method``)."""

    knots: int = key(
        "Knots of the alternation (the thesis: 1000); the nearest number that divides the basin's "
        "knots evenly is taken.",
        default=1000,
        within="[2, 10000]",
    )
    initial_level: float = key("First guess of ρ at every knot.", default=1.0, within="(0, 1000000.0]")
    ratio: float = key(
        "Ratio of the geometric progression by which ρ is decreased.", default=0.8, within="[0.1, 0.99]"
    )
    alternations: int = key(
        "Alternations (the thesis: 2); from the second on few knots have a multiplier, and there ρ jumps (columns jumped_knots, "
        "largest_jump, mean_area_after_4).",
        default=2,
        within="[1, 20]",
    )


@settings
class AttackSettings:
    """Simulated starts in every basin (check ``simulation``)."""

    starts: int = key(
        "Starts per basin, half on the boundary, half inside.", default=200, within="[2, 1000000]"
    )
    control_overstated: float = key(
        "Negative control: share of |d ln ρ/dt| by which ρ is made to fall too fast, so that starts "
        "must leave.",
        default=1.0,
        within="[0.01, 10]",
    )


@settings
class LimitSettings:
    """What the real loop may add to the nominal one, for the table of extended basins (check ``extended``)."""

    foot_ahead_m: float = key(
        "How far the foot reaches ahead of the ankle: about the ankles u ≥ −m·g times this, or the heel lifts. A foot is 0.152 "
        "of the height long (Winter 2009, Figure 4.1), a quarter of it behind the ankle.",
        default=0.2,
        within="(0, 0.5]",
    )
    foot_behind_m: float = key(
        "How far it reaches behind the ankle: u ≤ m·g times this, or the toes lift.",
        default=0.06,
        within="(0, 0.5]",
    )
    feet_half_width_m: float = key(
        "Half the distance between the feet's outer borders, which limits the torque about the ankles to the sides.",
        default=0.17,
        within="(0, 1]",
    )
    hip_extension_N_m: float = key(
        "Largest torque of both hips backward (isometric strength of young men, 0.161 of body weight times height a leg; "
        "Anderson, Madigan and Nussbaum 2007). All of it is left to each pendulum about the hips or L5.",
        default=440.0,
        within="(0, 10000]",
    )
    hip_flexion_N_m: float = key(
        "Largest torque of both hips forward (0.113 of body weight times height a leg; there).",
        default=310.0,
        within="(0, 10000]",
    )
    hip_abduction_N_m: float = key(
        "Largest torque of both hips to a side: an assumption, 100 N·m a leg.",
        default=200.0,
        within="(0, 10000]",
    )
    mass_share: float = key(
        "The true mass lies within the pendulum's mass times 1 ± this share.", default=0.05, within="[0, 0.9]"
    )
    knots: int = key(
        "Points in time at which these basins, the range of Table 4.1 under other weights and the figure that "
        "compares methods are computed.",
        default=334,
        within="[50, 100000]",
    )
    certified_knots: int = key(
        "Knots of ρ of the sum-of-squares method for these basins; the nearest number that divides "
        "their knots evenly is taken. Between few knots a limit that begins to bind is met with reserve: the default study's "
        "certified areas are up to 4.5 % smaller than the exact ones with 38 (and, of the polynomial in place of the sine, up to "
        "0.9 % larger), within 0.7 % with 112, which takes some 4 s of computing more for a lift.",
        default=38,
        within="[2, 100000]",
    )


@settings
class GridSettings:
    """Control weights R about pivots other than the study's own, for the grid of Table 4.1.

    About the hip a trunk segment has some tenth to hundredth of the inertia that it has about the ankles. With one R for
    both, the regulator of one would be asleep or the other's violent.
    """

    mid_ankle_control_weight: float = key("R about the ankles in 1/(N²·m²·s).", default=0.003, gt=0)
    hip_control_weight: float = key("R about the hips in 1/(N²·m²·s).", default=2.0, gt=0)
    knots: int = key(
        "Points in time: from 253 to 1000 areas about the ankles move by 3e-7 of them, about the hips by up to 1e-4.",
        default=253,
        within="[50, 100000]",
    )


@settings
class CompareSettings:
    """What Table 4.1 compares."""

    groups: Annotated[tuple[Word, Word], UNIQUE] = key(
        "Two labels of people (experience in their files): the table compares the first with the second, "
        "100(A_first − A_second)/A_second.",
        default=GROUPS,
    )


@settings
class MeasureSettings:
    """Measures that see movement (margin of stability, impulse to a step, capturability, posture, moment about L5/S1)."""

    functional_share: float = key(
        "How far towards the edge of their feet people lean: the functional base of support, as a share of the whole one's "
        "distance from its centre (0.6 with loads, Holbein and Redfern 1997; 1 takes the whole).",
        default=0.6,
        within="(0, 1]",
    )
    contact_height_m: float = key(
        "How far above its lowest level heel or toe still stand on the ground.",
        default=0.03,
        within="(0, 0.2]",
    )
    contact_speed_m_s: float = key(
        "Speed below which heel or toe stand on the ground.", default=0.3, within="(0, 5]"
    )


@settings
class StabilitySettings:
    """From pendulum states to basins of attraction."""

    pendulum: PendulumSettings = section(default_factory=PendulumSettings)
    regulator: RegulatorSettings = section(default_factory=RegulatorSettings)
    goal_level: float = key("ρ at the end of the trajectory.", default=1.0, within="(0, 1000000.0]")
    knots: int = key(
        "Points in time at which a basin is computed (the thesis: 1000; from 505 to 1000 areas move by some 1e-8 of them).",
        default=1000,
        within="[50, 100000]",
    )
    checks: Annotated[tuple[Check, ...], UNIQUE] = key(
        "What is computed beside the exact basins. simulation: starts that must stay inside; thesis_method: Eqs 4.5–4.7 as "
        "the thesis solves them; sum_of_squares: certificates; cvxpy: some of these once more as Eq. 4.6 is written; proof: "
        "interval arithmetic between the knots; extended: limited torque, uncertain mass and a better V.",
        default=("simulation", "thesis_method", "sum_of_squares", "cvxpy", "proof", "extended"),
    )
    proof: ProofSettings = section(default_factory=ProofSettings)
    sum_of_squares: SumOfSquaresSettings = section(default_factory=SumOfSquaresSettings)
    thesis_method: ThesisMethodSettings = section(default_factory=ThesisMethodSettings)
    attack: AttackSettings = section(default_factory=AttackSettings)
    limits: LimitSettings = section(default_factory=LimitSettings)
    grid: GridSettings = section(default_factory=GridSettings)
    compare: CompareSettings = section(default_factory=CompareSettings)
    measures: MeasureSettings = section(default_factory=MeasureSettings)
    lyapunov_shares: tuple[Share, ...] = key(
        "Shares λ of the decay Q + KᵀRK among which the best Lyapunov function is searched; 1 is the "
        "Riccati solution.",
        default=(0.0, 0.1, 0.25, 0.5, 1.0),
        min_length=1,
    )
    sensitivity_factor: float = key(
        "Factor by which Q, R and b are divided and multiplied for the range beside Table 4.1.",
        default=2.0,
        within="[1.01, 100]",
    )
