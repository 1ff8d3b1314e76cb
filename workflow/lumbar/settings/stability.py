"""Chapter stability: pendulum, regulator, methods and their checks."""

from typing import Annotated, Literal, get_args

from lumbar.base.errors import Problems
from lumbar.settings.key import UNIQUE, Each, Word, key, section, settings

GROUPS = ("expert", "novice")
"""Whom the thesis compares."""
Share = Annotated[float, Each(ge=0, le=10)]
Check = Literal["simulation", "thesis_method", "cvxpy", "proof"]


@settings
class PendulumSettings:
    """The pendulum of Eq. 4.1."""

    sign: Literal["hanging", "inverted"] = key(default="inverted")
    time: Literal["real", "unit"] = key(default="real")
    mass: Literal["with_box", "without_box"] = key(default="with_box")
    damping_N_m_s: float = key(default=1.0, unit="N·m·s/rad", within="[0, 1000]")
    gravity_m_s2: float = key(default=9.81, within="[0, 30]")


@settings
class RegulatorSettings:
    """Weights of the linear-quadratic regulator on angle (rad) and angular velocity (rad/s), the same for everybody."""

    state_weight: tuple[tuple[float, float], tuple[float, float]] = key(default=((1.0, 0.0), (0.0, 0.1)))
    control_weight: float = key(default=0.003, gt=0)
    terminal_weight: tuple[tuple[float, float], tuple[float, float]] = key(
        default=((100.0, 0.0), (0.0, 10.0))
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

    margin_1_s: float = key(default=0.005, within="(0, 100]")


@settings
class ThesisMethodSettings:
    """The thesis's bilinear alternation (Eqs 4.5–4.7) on the thesis's wording (check ``thesis_method``)."""

    knots: int = key(default=1000, within="[2, 10000]")
    initial_level: float = key(default=1.0, within="(0, 1000000.0]")
    ratio: float = key(default=0.8, within="[0.1, 0.99]")
    alternations: int = key(default=2, within="[1, 20]")


@settings
class AttackSettings:
    """Simulated starts in every basin (check ``simulation``)."""

    starts: int = key(default=200, within="[2, 1000000]")
    control_overstated: float = key(default=1.0, within="[0.01, 10]")


@settings
class LimitSettings:
    """The torque that foot or hips allow a pendulum, for the pushes on the page of a lift."""

    foot_ahead_m: float = key(default=0.2, within="(0, 0.5]")
    foot_behind_m: float = key(default=0.06, within="(0, 0.5]")
    feet_half_width_m: float = key(default=0.17, within="(0, 1]")
    hip_extension_N_m: float = key(default=440.0, within="(0, 10000]")
    hip_flexion_N_m: float = key(default=310.0, within="(0, 10000]")
    hip_abduction_N_m: float = key(default=200.0, within="(0, 10000]")


@settings
class CompareSettings:
    """What Table 4.1 compares."""

    groups: Annotated[tuple[Word, Word], UNIQUE] = key(default=GROUPS)


@settings
class MeasureSettings:
    """Measures that see movement (margin of stability, impulse to a step, capturability, posture, moment about L5/S1)."""

    functional_share: float = key(default=0.6, within="(0, 1]")
    contact_height_m: float = key(default=0.03, within="(0, 0.2]")
    contact_speed_m_s: float = key(default=0.3, within="(0, 5]")


@settings
class StabilitySettings:
    """From pendulum states to basins of attraction."""

    pendulum: PendulumSettings = section(default_factory=PendulumSettings)
    regulator: RegulatorSettings = section(default_factory=RegulatorSettings)
    goal_level: float = key(default=1.0, within="(0, 1000000.0]")
    knots: int = key(default=1000, within="[50, 100000]")
    fewer_knots: int = key(default=334, within="[50, 100000]")
    checks: Annotated[tuple[Check, ...], UNIQUE] = key(default=get_args(Check))
    proof: ProofSettings = section(default_factory=ProofSettings)
    thesis_method: ThesisMethodSettings = section(default_factory=ThesisMethodSettings)
    attack: AttackSettings = section(default_factory=AttackSettings)
    limits: LimitSettings = section(default_factory=LimitSettings)
    compare: CompareSettings = section(default_factory=CompareSettings)
    measures: MeasureSettings = section(default_factory=MeasureSettings)
    lyapunov_shares: tuple[Share, ...] = key(default=(0.0, 0.1, 0.25, 0.5, 1.0), min_length=1)
    sensitivity_factor: float = key(default=2.0, within="[1.01, 100]")
