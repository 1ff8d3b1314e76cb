"""Chapter stability: pendulum, regulator, methods and their checks."""

from __future__ import annotations

from typing import Annotated, Literal

from lumbar.settings.key import UNIQUE, Each, Word, key, section, settings

GROUPS = ("expert", "novice")
"""Whom the thesis compares."""
Share = Annotated[float, Each(ge=0, le=10)]


@settings
class PendulumSettings:
    """The pendulum of Eq. 4.1."""

    sign: Literal["hanging", "inverted"] = key(
        "Sign of the gravity term: hanging (+, as published) or inverted (−). Tables take this one; "
        "the other is computed beside it.",
        default="hanging",
    )
    mass: Literal["with_box", "without_box"] = key(
        "Whether the box counts to the pendulum's mass.", default="with_box"
    )
    damping_N_m_s: float = key("Damping b.", default=1.0, unit="N·m·s/rad", ge=0, le=1000)
    gravity_m_s2: float = key(
        "Gravitational acceleration: of the basins, of the effects on a pendulum, and of the twin's hip moments.",
        default=9.81,
        unit="m/s²",
        ge=0,
        le=30,
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


@settings
class ProofSettings:
    """Proof between the knots by interval branch-and-bound; null leaves it out."""

    margin_1_s: float = key(
        "By how much, in 1/s, ρ̇/ρ of the funnel that is proved exceeds the largest V̇/ρ on its "
        "boundary; its area is about 1 − margin·T/2 of the exact one's.",
        default=0.005,
        unit="1/s",
        gt=0,
        le=100,
    )


@settings
class SumOfSquaresSettings:
    """Certificates by sum-of-squares programmes beside the exact basins; null leaves them out."""

    degree: Literal[3, 5, 7] = key("Degree of the sine's Taylor polynomial.", default=5)
    knots: int = key(
        "Knots of ρ, with a certificate between each two; the nearest number that divides the basin's "
        "knots evenly is taken.",
        default=38,
        ge=2,
        le=100000,
    )
    alternations: int = key("Programmes per interval.", default=2, ge=2, le=8)
    margin_1_s: float = key(
        "Margin left in ρ̇/ρ, in 1/s, above the solver's tolerance.",
        default=2e-05,
        unit="1/s",
        gt=0,
        le=1,
    )


@settings
class ThesisMethodSettings:
    """The thesis's bilinear alternation (Eqs 4.5–4.7) beside the exact basins; null leaves it out."""

    degree: Literal[3, 5] = key("Degree of the sine's Taylor polynomial.", default=3)
    knots: int = key(
        "Knots of the alternation (the thesis: 1000); the nearest number that divides the basin's "
        "knots evenly is taken.",
        default=10,
        ge=2,
        le=1000,
    )
    initial_level: float = key("First guess of ρ at every knot.", default=1.0, gt=0, le=1000000.0)
    ratio: float = key(
        "Ratio of the geometric progression by which ρ is decreased.", default=0.8, ge=0.1, le=0.99
    )
    alternations: int = key("Alternations (the thesis: 2).", default=2, ge=1, le=20)


@settings
class AttackSettings:
    """Simulated starts in every basin."""

    starts: int = key("Starts per basin, half on the boundary, half inside.", default=500, ge=2, le=1000000)
    control_overstated: float = key(
        "Negative control: share of |d ln ρ/dt| by which ρ is made to fall too fast, so that starts "
        "must leave.",
        default=1.0,
        ge=0.01,
        le=10,
    )


@settings
class LimitSettings:
    """What the real loop may add to the nominal one, for the table of extended basins."""

    torque_N_m: float = key(
        "Largest torque |u| in N·m about the pivot.", default=60.0, unit="N·m", gt=0, le=10000
    )
    mass_share: float = key(
        "The true mass lies within the pendulum's mass times 1 ± this share.", default=0.05, ge=0, le=0.9
    )
    knots: int = key(
        "Points in time at which these basins, those of the Taylor polynomials in Table 4.1 and the "
        "figure that compares methods are computed.",
        default=334,
        ge=50,
        le=100000,
    )
    certified_knots: int = key(
        "Knots of ρ of the sum-of-squares method for these basins; the nearest number that divides "
        "their knots evenly is taken.",
        default=10,
        ge=2,
        le=100000,
    )
    proved: bool = key(
        "Whether these basins are proved between their knots too, with the margin of stability.proof; "
        "takes some ten seconds per lift.",
        default=False,
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
        gt=0,
        le=1,
    )
    contact_height_m: float = key(
        "How far above its lowest level heel or toe still stand on the ground.",
        default=0.03,
        unit="m",
        gt=0,
        le=0.2,
    )
    contact_speed_m_s: float = key(
        "Speed below which heel or toe stand on the ground.", default=0.3, unit="m/s", gt=0, le=5
    )


@settings
class StabilitySettings:
    """From pendulum states to basins of attraction."""

    pendulum: PendulumSettings = section(default_factory=PendulumSettings)
    regulator: RegulatorSettings = section(default_factory=RegulatorSettings)
    goal_level: float = key("ρ at the end of the trajectory.", default=1.0, gt=0, le=1000000.0)
    knots: int = key(
        "Points in time at which a basin is computed (the thesis: 1000).", default=1000, ge=50, le=100000
    )
    proof: ProofSettings | None = section(default_factory=ProofSettings)
    sum_of_squares: SumOfSquaresSettings | None = section(default_factory=SumOfSquaresSettings)
    thesis_method: ThesisMethodSettings | None = section(default_factory=ThesisMethodSettings)
    attack: AttackSettings = section(default_factory=AttackSettings)
    limits: LimitSettings = section(default_factory=LimitSettings)
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
        ge=1.01,
        le=100,
    )
