"""Synthetic lifters, drawn from declared distributions for a cohort or for a subject without a declared movement.

A study knows mass and stature only with a measurement error. Every person and every lift has separate random numbers, so that
an additional person or trial changes no others.
"""

import math
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lumbar.settings.lifting import SubjectSettings, TrialSettings
from lumbar.settings.twin import (
    CohortGroup,
    CohortSettings,
    GroupMovement,
    SyntheticLift,
    SyntheticLiftingSettings,
    SyntheticPerson,
    TrueEvents,
)
from lumbar.twin.lifting_recordings import select_lifts, write_lift

MAX_DRAWN_SD = 2.5
"""Largest deviation of a drawn number from its mean, in standard deviations."""
_AFTER_RELEASE_S = 2.0
"""Duration of a recording after the release, in seconds."""
_DRAWN_FIELDS = tuple(
    name
    for name in SyntheticLift.model_fields
    if name in GroupMovement.model_fields.keys() - {"foot_adjustment"}
)
"""Fields of a lift that are drawn at random, in a fixed order."""
_STREAMS = {"person": 11, "lift": 12, "noise": 13}


@dataclass(frozen=True)
class CohortPerson:
    """One person of a cohort."""

    name: str
    group: str
    sex: str
    truth: SyntheticPerson
    """True mass and stature."""
    declared: SyntheticPerson
    """Measured mass and stature."""
    habits: dict[str, float]
    """Mean of the person by drawn field of a lift."""


def _generator(seed: int, stream: str, name: str) -> np.random.Generator:
    return np.random.default_rng([seed, _STREAMS[stream], zlib.crc32(name.encode())])


def _normal(rng: np.random.Generator) -> float:
    """Draw a standard normal number within `MAX_DRAWN_SD`."""
    while abs(number := rng.standard_normal()) > MAX_DRAWN_SD:
        pass
    return float(number)


def draw_person(cohort: CohortSettings, name: str, group: str, seed: int) -> CohortPerson:
    """Draw the person with this name, e.g. ``expert_0001``; `seed` is the seed of the twin."""
    rng, number = _generator(seed, "person", name), int(name.rsplit("_", 1)[1])
    share = cohort.female_share
    sex = "female" if math.floor(number * share) > math.floor((number - 1) * share) else "male"
    tall, heavy = _normal(rng), _normal(rng)
    correlation = cohort.stature_mass_correlation
    heavy = correlation * tall + math.sqrt(1 - correlation**2) * heavy
    (stature, stature_sd), (mass, mass_sd) = cohort.stature_m[sex], cohort.mass_kg[sex]
    truth = SyntheticPerson(mass_kg=mass + mass_sd * heavy, height_m=stature + stature_sd * tall)
    declared = SyntheticPerson(
        mass_kg=round(truth.mass_kg + cohort.mass_error_kg * _normal(rng), 1),
        height_m=round(truth.height_m + cohort.stature_error_m * _normal(rng), 3),
    )
    return CohortPerson(name, group, sex, truth, declared, _habits(cohort.groups[group], rng))


def _habits(group: GroupMovement, rng: np.random.Generator) -> dict[str, float]:
    drawn = {item: getattr(group, item) for item in (*_DRAWN_FIELDS, "tempo")}
    return {item: max(mean + between * _normal(rng), 0.0) for item, (mean, between, _) in drawn.items()}


def lift_name(person: str, box_mass_kg: float, trial: int) -> str:
    """Return the name of a lift in a study."""
    return f"{person}_{box_mass_kg:g}kg" + (f"_{trial}" if trial > 1 else "")


def draw_lift(
    cohort: CohortSettings, person: CohortPerson, box_mass_kg: float, lift: str, seed: int
) -> SyntheticLift:
    """Draw the lift with this name."""
    rng = _generator(seed, "lift", lift)
    content = cohort.groups[person.group]
    numbers = {
        item: max(habit + getattr(content, item)[2] * _normal(rng), 0.0)
        for item, habit in person.habits.items()
    }
    heavier = max(box_mass_kg - min(cohort.box_masses_kg), 0.0)
    # No movement lasts less than half of its mean time, so that the events remain in order.
    slowness = max(numbers.pop("tempo"), 0.5) * (1 + cohort.slower_per_kg * heavier)
    times = np.cumsum(np.multiply(slowness, cohort.durations_s))
    return SyntheticLift.model_construct(
        person=person.name,
        box_mass_kg=box_mass_kg,
        foot_adjustment=bool(rng.random() < content.foot_adjustment),
        events_s=TrueEvents.model_construct(
            **{name: round(float(time), 3) for name, time in zip(TrueEvents.model_fields, times, strict=True)}
        ),
        **numbers,
    )


def cohort_lifts(cohort: CohortSettings) -> Iterator[tuple[float, int]]:
    """Yield box mass (kg) and number of every trial of a person."""
    for mass in cohort.box_masses_kg:
        yield from ((mass, trial) for trial in range(1, cohort.trials + 1))


def marker_file(person: str, box_mass_kg: float, trial: int) -> str:
    """Return the path of a lift's marker file below the folder of recordings."""
    return f"lifting/{person}/{lift_name(person, box_mass_kg, trial)}.c3d"


def single_person_cohort(cohort: CohortSettings, group: str) -> CohortSettings:
    """Return the settings on which one person's lifts depend: without other groups and without numbers of persons."""
    single = cohort.groups[group].model_copy(update={"persons": 1})
    return cohort.model_copy(update={"groups": {group: single}})


def cohort_subjects(cohort: CohortSettings, seed: int) -> dict[str, SubjectSettings]:
    """Return all persons as subjects of a study, with measured mass and stature."""
    subjects, groups = {}, cohort.groups.items()
    for group, number in ((name, number) for name, content in groups for number in range(content.persons)):
        name = f"{group}_{number + 1:04d}"
        person = draw_person(cohort, name, group, seed)
        trials = tuple(
            TrialSettings(box_mass_kg=mass, markers=marker_file(name, mass, trial))
            for mass, trial in cohort_lifts(cohort)
        )
        subjects[name] = SubjectSettings(
            name=name, sex=person.sex, experience=group, trials=trials, **vars(person.declared)
        )
    return subjects


def write_person(
    settings: SyntheticLiftingSettings,
    cohort: CohortSettings,
    name: str,
    group: str,
    seed: int,
    files: Mapping,
) -> None:
    """Write the C3D file of every lift of one person; `files` are paths by box mass and trial."""
    person = draw_person(cohort, name, group, seed)
    for (mass, trial), path in files.items():
        key = lift_name(name, mass, trial)
        lift = draw_lift(cohort, person, mass, key, seed)
        noise = [seed, _STREAMS["noise"], zlib.crc32(key.encode())]
        write_lift(_single_lift(settings, key, lift, person.truth), key, noise, Path(path), None)


def _single_lift(
    settings: SyntheticLiftingSettings, name: str, lift: SyntheticLift, truth: SyntheticPerson
) -> SyntheticLiftingSettings:
    """Return settings with a single drawn lift, and with a recording as long as this lift."""
    duration = math.ceil(lift.events_s.release + _AFTER_RELEASE_S)
    changes = {"people": {lift.person: truth}, "lifts": {name: lift}, "duration_s": duration}
    return settings.model_copy(update=changes)


def single_lift_settings(
    settings: SyntheticLiftingSettings, subject: SubjectSettings, lift: str, box_mass_kg: float, seed: int
) -> SyntheticLiftingSettings:
    """Return the settings on which one lift of a study depends: the person, and the declared or drawn movement.

    A movement is drawn from the subject's group. The declared mass and stature of the subject change no recording.
    """
    selected = select_lifts(settings, [lift] if lift in settings.lifts else [])
    moment = settings.hip_moment.model_copy(update={"trials": {}})
    selected = selected.model_copy(update={"hip_moment": moment})
    if lift in settings.lifts:
        return selected
    group = subject.experience
    cohort = CohortSettings(groups={group: CohortGroup(**vars(settings.groups[group]))})
    truth = settings.people[subject.name]
    habits = _habits(settings.groups[group], _generator(seed, "person", subject.name))
    person = CohortPerson(subject.name, group, subject.sex, truth, truth, habits)
    return _single_lift(selected, lift, draw_lift(cohort, person, box_mass_kg, lift, seed), truth)
