"""Recordings for examples: tissue tests with dry friction, an effect that base models lack, and a lift."""

import os
from pathlib import Path

import numpy as np

from lumbar.base.yaml_file import shipped_yaml
from lumbar.records.record import Channel, Record, RecordSet
from lumbar.settings.lifting import SubjectSettings, TrialSettings
from lumbar.settings.twin import SyntheticLiftingSettings
from lumbar.twin.lifting_recordings import write_lift
from lumbar.twin.tissue_recordings import tissue_force

_STEP_S, _PERIOD_S = 0.02, 4.0


def example_records() -> RecordSet:
    """Return two records in mm and N at 50 Hz: ``multisine``, six periods of 4 s, and ``other``, 16 s without a period.

    The tissue is a Kelvin–Boltzmann model (k1 1.8 N/mm, k2 0.9 N/mm, 0.15 s) with dry friction of 0.4 N and noise of 0.01 N.

    Examples
    --------
    >>> example_records()
    2 records
      multisine: 1200 samples at 50 Hz, 24 s; position (mm), force (N)
      other: 800 samples at 50 Hz, 16 s; position (mm), force (N)
    """
    generator = np.random.default_rng(3)
    lines = np.arange(1, 11) / _PERIOD_S
    multisine = _test("multisine", lines, 6 * _PERIOD_S, generator)
    return RecordSet([multisine, _test("other", lines * np.sqrt(1.1), 16.0, generator)])


def _test(name: str, frequencies: np.ndarray, duration: float, generator: np.random.Generator) -> Record:
    time = np.arange(0, duration, _STEP_S)
    turns = 2 * np.pi * np.outer(time, frequencies) + generator.uniform(0, 2 * np.pi, len(frequencies))
    position = 0.5 * np.sin(turns).sum(axis=1)
    speed = 0.5 * np.cos(turns) @ (2 * np.pi * frequencies)
    force = tissue_force(time, position, 1.8, 0.9, 0.15, 0.0) + 0.4 * np.tanh(speed / 0.5)
    force += 0.01 * generator.standard_normal(len(force))
    channels = {"input": Channel(position, "position", "mm"), "output": Channel(force, "force", "N")}
    return Record(name, time, channels, source="examples")


def example_lift(path: str | os.PathLike) -> SubjectSettings:
    """Write a lift of a box of 15 kg as a C3D file, and return the subject."""
    settings = SyntheticLiftingSettings(**shipped_yaml(Path(__file__).with_suffix(".yaml")))
    write_lift(settings, "lift", [1], path, None)
    person, trial = settings.people["lifter"], TrialSettings(box_mass_kg=15, markers=Path(path).name)
    return SubjectSettings(
        name="lifter",
        sex="unknown",
        mass_kg=person.mass_kg,
        height_m=person.height_m,
        experience="expert",
        trials=(trial,),
    )
