"""The measures by name: what each is, its unit, which way is safer, and where it comes from."""

from dataclasses import dataclass, field
from pathlib import Path

from lumbar.base.yaml_file import shipped_yaml
from lumbar.lifting.measures.back_load import TRUNK_SOURCE
from lumbar.lifting.measures.balance import ANKLE_SOURCE

ALL, SAGITTAL, FRONTAL = "all", "flexion_extension", "lateral_bending"
"""All directions, or one of the planes of `lumbar.lifting.movement.pendulum_states.PLANES`."""
CARRIED, DEPOSIT = "carried", "deposit"
WINDOWS = {
    CARRIED: "from lift-off to release, or as far of it as was recorded",
    DEPOSIT: "from the start of the deposit to the release",
}
"""Phases of a lift that a number may be of."""
SMALLEST, LARGEST, FARTHEST = "smallest", "largest", "farthest"
AT_RELEASE, INTEGRAL = "at_release", "integral"
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
    """``higher`` or ``lower``: which way is farther from a step, or kinder to the back; empty where neither is."""
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
    told: tuple[str, str] = ("", "")
    """What a value says of the lift, above and below zero; ``{size}`` is the value without its sign."""


def measure_in_words(name: str) -> str:
    """Return a measure, or what a plane adds to it, as print has it: ``l5s1_moment`` as ``L5/S1 moment``."""
    words = name.replace("flexion_extension", "flexion/extension").replace("_", " ").replace("l5s1", "L5/S1")
    return words[:1].upper() + words[1:]


def _measures() -> dict[str, Measure]:
    said = shipped_yaml(Path(__file__).with_name("measures.yaml"))
    sources: dict[str, str] = {"ankles": ANKLE_SOURCE, "strength": TRUNK_SOURCE}
    for name, words in said["sources"].items():
        sources[name] = words.format(**sources)
    return {
        name: Measure(name, **fields | {"source": fields["source"].format(**sources)})
        for name, fields in said["measures"].items()
    }


MEASURES = _measures()
"""All measures by name, in the order of the tables."""
