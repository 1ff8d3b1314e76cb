"""Chapters pushes and perturbations: bodies of three links, their controller, the pushes; perturbed trials."""

from typing import Literal

from lumbar.settings.key import key, required, section, settings
from lumbar.settings.layout import ColumnLayout, MarkerLayout, columns


@settings
class PushRecords:
    """Recorded forces of the pushes, for the person's own feedback."""

    files: tuple[str, ...] = required(min_length=1)
    arm_m: float = required(within="(0, 2]")
    layout: ColumnLayout = section(
        default_factory=ColumnLayout,
        columns=columns(time=("time_s", "s", "time"), force=("force_N", "N", "force")),
    )


@settings
class PerturbationsSettings:
    """Trials with and without perturbation; null where a study has none."""

    subject: str = required(min_length=1)
    body_mass_kg: float = required(within="[20, 300]")
    mass_share: float = required(within="(0, 1]")
    pivot: tuple[str, ...] = required(min_length=1)
    top: tuple[str, ...] = required(min_length=1)
    centre_share: float = required(within="(0, 1.5]")
    plane: Literal["lateral_bending", "flexion_extension"] = required()
    unperturbed: tuple[str, ...] = required(min_length=3)
    perturbed: tuple[str, ...] = required(min_length=1)
    pushes: PushRecords | None = key(default=None)
    markers: MarkerLayout = section(default_factory=MarkerLayout)

    def __post_init__(self):
        if self.pushes is not None and len(self.pushes.files) != len(self.perturbed):
            raise ValueError(
                f"pushes.files: {len(self.pushes.files)} files for {len(self.perturbed)} perturbed trials; one of each is "
                "needed, in the same order"
            )


@settings
class BodySettings:
    """Feet and strength of the simulated bodies: legs, trunk with head, and arms with the box, in the sagittal plane."""

    toe_share: float = key(default=0.95, within="(0, 1.5]")
    heel_share: float = key(default=0.95, within="(0, 1.5]")
    plantarflexion_share: float = key(default=0.095, within="(0, 1]")
    dorsiflexion_share: float = key(default=0.033, within="(0, 1]")
    hip_extension_share: float = key(default=0.161, within="(0, 1]")
    hip_flexion_share: float = key(default=0.113, within="(0, 1]")
    shoulder_share: float = key(default=0.06, within="(0, 1]")
    stiffness_share: float = key(default=0.19, within="[0, 1]")
    damping_s: float = key(default=0.05, within="[0, 1]")


@settings
class ControllerSettings:
    """The assumed controller: linear-quadratic about the lift's posture, knowing its own delay."""

    step_s: float = key(default=0.02, within="(0, 0.1]")
    delay_s: float = key(default=0.12, within="[0.02, 0.3]")
    angle_rad: float = key(default=0.1, within="(0, 10]")
    rate_rad_s: float = key(default=0.5, within="(0, 100]")
    torque_share: float = key(default=0.2, within="(0, 10]")


@settings
class PersonalSpreadSettings:
    """How simulated people differ in what no measure is told: standard deviations, drawn once per person."""

    strength: float = key(default=0.15, within="[0, 0.5]")
    foot: float = key(default=0.03, within="[0, 0.5]")
    gain: float = key(default=0.5, within="[0, 3]")
    delay_s: float = key(default=0.02, within="[0, 0.1]")


@settings
class PushSettings:
    """The pushes: forces of constant size on the trunk, drawn at random."""

    per_lift: int = key(default=24, within="[1, 100000]")
    forward_N_s: tuple[float, float] = key(default=(0.5, 20.0))
    backward_N_s: tuple[float, float] = key(default=(10.0, 60.0))
    equal_forward_N_s: float = key(default=9.0, gt=0)
    equal_backward_N_s: float = key(default=40.0, gt=0)
    duration_s: float = key(default=0.1, within="(0, 1]")
    height_share: float = key(default=0.75, within="[0, 1]")


@settings
class OutcomeSettings:
    """When a simulated person counts as one who steps."""

    step_s: float = key(default=0.01, within="(0, 0.02]")
    horizon_s: float = key(default=4.0, within="[0.5, 20]")
    return_s: float = key(default=1.2, within="(0, 5]")
    lean_deg: float = key(default=35.0, within="(0, 90]")


@settings
class ScoringSettings:
    """How predictions are scored."""

    folds: int = key(default=5, within="[2, 100]")
    fewest_persons: int = key(default=8, within="[3, 1000]")


@settings
class PushesSettings:
    """Pushes against simulated bodies, and which measure tells beforehand who must step."""

    body: BodySettings = section(default_factory=BodySettings)
    controller: ControllerSettings = section(default_factory=ControllerSettings)
    spread: PersonalSpreadSettings = section(default_factory=PersonalSpreadSettings)
    push: PushSettings = section(default_factory=PushSettings)
    outcome: OutcomeSettings = section(default_factory=OutcomeSettings)
    scoring: ScoringSettings = section(default_factory=ScoringSettings)
