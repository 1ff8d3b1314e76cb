"""Chapters pushes and perturbations: bodies of three links, their controller, the pushes; perturbed trials."""

from typing import Literal

from lumbar.settings.key import key, required, section, settings
from lumbar.settings.layout import MarkerLayout


@settings
class LegMarkers:
    """Markers of legs and feet, for measures of the whole body; null leaves them out."""

    knee: tuple[str, ...] = required("Markers (standard names) whose mean is the knee.", min_length=1)
    ankle: tuple[str, ...] = required("Markers whose mean is the ankle.", min_length=1)
    heel: tuple[str, ...] = required("Markers whose mean is the heel's end of the foot.", min_length=1)
    toe: tuple[str, ...] = required("Markers whose mean is the toes' end.", min_length=1)


@settings
class PerturbationsSettings:
    """Trials with and without perturbation; null where a study has none."""

    subject: str = required("Who moved.", min_length=1)
    body_mass_kg: float = required(
        "Body mass in kg (an assumption where it was not recorded).", within="[20, 300]"
    )
    mass_share: float = required("Share of the body mass that the pendulum carries.", within="(0, 1]")
    pivot: tuple[str, ...] = required("Markers (standard names) whose mean is the pivot.", min_length=1)
    top: tuple[str, ...] = required("Markers whose mean is the other end of the segment.", min_length=1)
    centre_share: float = required(
        "Where the centre of mass lies on the way from pivot to top.", within="(0, 1.5]"
    )
    plane: Literal["lateral_bending", "flexion_extension"] = required("Plane of the pendulum.")
    unperturbed: tuple[str, ...] = required("Files of the unperturbed trials.", min_length=3)
    perturbed: tuple[str, ...] = required("Files of the perturbed trials.", min_length=1)
    legs: LegMarkers | None = key(
        "Markers of legs and feet, for measures of the whole body; null leaves them out.", default=None
    )
    markers: MarkerLayout = section(default_factory=MarkerLayout)


@settings
class BodySettings:
    """Feet and strength of the simulated bodies: legs, trunk with head, and arms with the box, in the sagittal plane."""

    toe_share: float = key(
        "How far ahead of the ankle the centre of pressure can go, as a share of the way from ankle to toe marker.",
        default=0.95,
        within="(0, 1.5]",
    )
    heel_share: float = key(
        "How far behind the ankle it can go, as a share of the way from ankle to heel marker.",
        default=0.95,
        within="(0, 1.5]",
    )
    plantarflexion_share: float = key(
        "Strength of one ankle over body weight times stature, toes down (Anderson et al. 2007).",
        default=0.095,
        within="(0, 1]",
    )
    dorsiflexion_share: float = key(
        "Strength of one ankle over body weight times stature, toes up (Anderson et al. 2007).",
        default=0.033,
        within="(0, 1]",
    )
    hip_extension_share: float = key(
        "Strength of one hip over body weight times stature, extension (Anderson et al. 2007).",
        default=0.161,
        within="(0, 1]",
    )
    hip_flexion_share: float = key(
        "Strength of one hip over body weight times stature, flexion (Anderson et al. 2007).",
        default=0.113,
        within="(0, 1]",
    )
    shoulder_share: float = key(
        "Strength of one shoulder over body weight times stature, both ways: an assumption.",
        default=0.06,
        within="(0, 1]",
    )
    stiffness_share: float = key(
        "Stiffness of the joints that acts without delay, as a share of what would just keep all above the joint "
        "upright: at the ankle 0.19 ± 0.05 for turns of 7 degrees (Loram, Maganaris and Lakie 2007), at hip and shoulder an "
        "assumption.",
        default=0.19,
        within="[0, 1]",
    )
    damping_s: float = key(
        "Damping of the joints that acts without delay, as a time: damping over that toppling stiffness; an assumption.",
        default=0.05,
        within="[0, 1]",
    )


@settings
class ControllerSettings:
    """The assumed controller: linear-quadratic about the lift's posture, knowing its own delay."""

    step_s: float = key(
        "Time between two commands; the delay is a whole number of them.", default=0.02, within="(0, 0.1]"
    )
    delay_s: float = key(
        "Time from a change of posture to the torque that answers it: assumed. Restoring forces begin after about 0.125 s "
        "(Bortolami et al. 2003).",
        default=0.12,
        within="[0.02, 0.3]",
    )
    angle_rad: float = key(
        "Deviation of a joint's angle that costs as much as the torque torque_share (Bryson's rule).",
        default=0.1,
        within="(0, 10]",
    )
    rate_rad_s: float = key("Deviation of a joint's rate that costs as much.", default=0.5, within="(0, 100]")
    torque_share: float = key(
        "Torque that costs as much, as a share of the joint's strength: small for a soft controller.",
        default=0.2,
        within="(0, 10]",
    )


@settings
class PersonalSpreadSettings:
    """How simulated people differ in what no measure is told: standard deviations, drawn once per person."""

    strength: float = key("Of strength, as a share.", default=0.15, within="[0, 0.5]")
    foot: float = key("Of the reach of the centre of pressure, as a share.", default=0.03, within="[0, 0.5]")
    gain: float = key(
        "Of the logarithm of the cost of torque: people answer softly or hard.", default=0.5, within="[0, 3]"
    )
    delay_s: float = key("Of the delay, rounded to whole commands.", default=0.02, within="[0, 0.1]")


@settings
class PushSettings:
    """The pushes: forces of constant size on the trunk, drawn at random."""

    per_lift: int = key("Pushes in every lift.", default=24, within="[1, 100000]")
    forward_N_s: tuple[float, float] = key(
        "Smallest and largest impulse forward; sizes between are equally likely.", default=(0.5, 20.0)
    )
    backward_N_s: tuple[float, float] = key(
        "Smallest and largest impulse backward; as many pushes as forward.", default=(10.0, 60.0)
    )
    equal_forward_N_s: float = key(
        "Size of every push forward in the contest of equal pushes, which asks who steps first. It is declared: taken from "
        "the group, it would change with everybody who joins.",
        default=9.0,
        gt=0,
    )
    equal_backward_N_s: float = key("Size of every push backward in that contest.", default=40.0, gt=0)
    duration_s: float = key("How long a push lasts.", default=0.1, within="(0, 1]")
    height_share: float = key(
        "Where the trunk is pushed, as a share of the way from hips to shoulders.",
        default=0.75,
        within="[0, 1]",
    )


@settings
class OutcomeSettings:
    """When a simulated person counts as one who steps."""

    step_s: float = key(
        "Step of the integration; a whole number of them make a command.", default=0.01, within="(0, 0.02]"
    )
    horizon_s: float = key(
        "How long a body is followed after the push has begun; who falls later counts as standing.",
        default=4.0,
        within="[0.5, 20]",
    )
    return_s: float = key(
        "Who is pushed stops the deposit after the controller's delay and takes the box back to where it began, in this time.",
        default=1.2,
        within="(0, 5]",
    )
    lean_deg: float = key(
        "A leg that leans by so much more or less than the lift asks for has no way back without a step: the body falls.",
        default=35.0,
        within="(0, 90]",
    )


@settings
class ScoringSettings:
    """How predictions are scored."""

    folds: int = key(
        "Groups of persons; each group's pushes are told by what was learnt on the others.",
        default=5,
        within="[2, 100]",
    )
    fewest_persons: int = key("Persons below which there is no interval.", default=8, within="[3, 1000]")


@settings
class PushesSettings:
    """Pushes against simulated bodies, and which measure tells beforehand who must step."""

    body: BodySettings = section(default_factory=BodySettings)
    controller: ControllerSettings = section(default_factory=ControllerSettings)
    spread: PersonalSpreadSettings = section(default_factory=PersonalSpreadSettings)
    push: PushSettings = section(default_factory=PushSettings)
    outcome: OutcomeSettings = section(default_factory=OutcomeSettings)
    scoring: ScoringSettings = section(default_factory=ScoringSettings)
