"""Checks of exported FMUs: validation by fmpy, simulation against the identified model, a push, and the table of results."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import fmpy
import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.tables.table import Table, table_from_schema
from lumbar.tissue.fmu.build.description import FMI_VERSIONS
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.build.linear_model import LinearModel
from lumbar.tissue.fmu.build.package import fmu_name
from lumbar.tissue.fmu.build.reference_response import (
    moving_average,
    push_depth,
    push_profile,
    reference_output,
    samples_within_range,
    scale_to,
)
from lumbar.tissue.fmu.conventions import along_axes
from lumbar.tissue.fmu.instance import Instance, UnzippedFmu
from lumbar.tissue.models.transfer_function import filtered

TOLERANCE = 1e-12
"""Largest error of a valid FMU, relative to the largest output."""
_TEST_OUTPUT_SHARE = 0.8
"""Largest output for the test input as a share of the output's limit."""


def schema_problems(path: Path) -> list[str]:
    """Return the problems that fmpy finds by the standard's schema; an unreadable file is a problem."""
    from fmpy.validation import validate_fmu

    try:
        return list(validate_fmu(str(path)))
    except Exception as error:  # fmpy raises plain ones with the schema's text
        return [str(error)]


def validate_new_files(paths: Sequence[Path]) -> None:
    """Validate files that were just written; remove all of them if any file has a problem.

    Raises
    ------
    InputError
        If any file has a problem. The message lists every problem of every file.
    """
    problems = Problems("FMUs that must not be used")
    for path in paths:
        for text in schema_problems(path):
            problems.add(path.name, text)
    try:
        problems.raise_if_any()
    except InputError:
        for path in paths:
            path.unlink()
        raise


def simulate_fmu(path: Path, inputs: np.ndarray) -> np.ndarray:
    """Run an FMU through fmpy, in FMI 3.0 with event mode, and return its output at every sample instant.

    Inputs at these instants and outputs have shape (samples,), in space (samples, axes).
    """
    with tempfile.TemporaryDirectory(prefix="lumbar-play-") as folder:
        fmpy.extract(str(path), folder)
        fmu = UnzippedFmu(Path(folder))
        instance = Instance(fmu, event_mode=fmu.version == 3)
        outputs = np.array(instance.play(inputs.tolist()))
        instance.free()
        fmu.slave.freeLibrary()
    return outputs


@dataclass(frozen=True)
class Check:
    """The check of one FMU."""

    file: str
    model: ExportModel
    version: str
    samples: int
    largest_output: float
    """Largest output in its unit."""
    largest_error: float
    """Largest error relative to `largest_output`."""
    tolerance: float
    """Upper limit of `largest_error`."""


def check_fmus(models: list[ExportModel], folder: Path, samples: int, seed: int) -> list[Check]:
    """Validate both FMUs of every model and simulate them with a random walk of this number of samples and seed.

    Raises
    ------
    InputError
        If any FMU has a problem. The message lists all problems.
    """
    problems, checks = Problems("FMUs that must not be used"), []
    for model, version in product(models, FMI_VERSIONS):
        path = folder / fmu_name(model.name, version)
        length = samples_within_range(model, samples)
        shape = (length, len(model.axes)) if model.axes else length
        walk = np.cumsum(np.random.default_rng([seed, length]).standard_normal(shape), axis=0)
        largest = _TEST_OUTPUT_SHARE * model.output_limit - abs(model.output.offset)
        inputs = model.rest + scale_to(model, moving_average(walk, model.moving_average), largest) * walk
        reference = reference_output(model, inputs, version)
        simulated = simulate_fmu(path, inputs)
        largest = float(np.abs(reference).max())
        check = Check(
            file=path.name,
            model=model,
            version=version,
            samples=length,
            largest_output=largest,
            largest_error=float(np.abs(simulated - reference).max() / (largest or 1.0)),
            tolerance=max(TOLERANCE, _rounding_bound(model, inputs, largest)),
        )
        for text in schema_problems(path):
            problems.add(path.name, f"schema: {text}")
        if not check.largest_error <= check.tolerance:
            problems.add(
                path.name,
                f"simulated output is off by {check.largest_error:.3g} of its largest; allowed is {check.tolerance:.3g}",
            )
        checks.append(check)
    problems.raise_if_any()
    return checks


def _rounding_bound(model: ExportModel, inputs: np.ndarray, largest: float) -> float:
    """Return the largest error that rounding can cause, relative to the largest output."""
    if not largest:
        return 0.0
    dynamics = model.dynamics
    if isinstance(dynamics, LinearModel):
        # Every step rounds each of its terms by up to machine epsilon, and the poles carry each rounding on: their effect is
        # at most the 1-norm of the impulse response of 1/denominator times that of one step.
        impulse = np.eye(1, len(inputs))[0]
        amplification = np.abs(filtered([1.0], dynamics.denominator, impulse)).sum()
        numerator, denominator = np.abs(dynamics.numerator).sum(), np.abs(dynamics.denominator).sum()
        terms = numerator * np.abs(inputs).max() + denominator * largest
        return float(np.finfo(float).eps * amplification * terms / largest)
    # Elementary functions differ by a few units in the last place and forces may cancel: each may be off by 8 units of the
    # largest force that a form contributes, and memories carry errors on without amplifying them.
    linear, nonlinear = dynamics.parameters
    contributed = np.abs(dynamics.structure.design(dynamics.motion(inputs), nonlinear) * linear).max()
    return float(8 * len(dynamics.terms) * np.finfo(float).eps * contributed / largest)


def check_table(checks: list[Check], source_label: str, seed: int) -> Table:
    """Return the table of checked FMUs; `source_label` names the models' data, `seed` is the seed of the test input."""
    rows = [
        {
            "file": check.file,
            "model": check.model.name,
            "fmi_version": check.version,
            "rate_Hz": 1 / check.model.sampling_time,
            "averaged": check.model.moving_average,
            "states": check.model.memory,
            "largest_pole": check.model.dynamics.largest_pole,
            "stable": "yes" if check.model.stable else "NO",
            "feedthrough": {"2.0": "one sample late", "3.0": "at once"}[check.version]
            if check.model.feedthrough
            else "none",
            "schema_problems": 0,  # others are not checked further
            "largest_output": check.largest_output,
            "relative_error": check.largest_error,
            "tolerance": check.tolerance,
        }
        for check in checks
    ]
    first = checks[0].model
    facts = {
        "seed": seed,
        "samples": checks[0].samples,
        "unit": first.output.unit,
        "limit": first.output_limit,
    }
    return table_from_schema("tissue/fmu", "fmu_checks", rows, source_label, facts)


@dataclass(frozen=True)
class Push:
    """Outputs of all FMUs to the same movement."""

    time: np.ndarray
    """Time in seconds, shape (samples,)."""
    inputs: np.ndarray
    """Positions, shape (samples,)."""
    outputs: dict[tuple[str, str], np.ndarray]
    """Outputs by model and FMI version, each of shape (samples,)."""
    most_delayed: str
    """Model with the largest difference between the outputs of both versions."""


def push(models: list[ExportModel], folder: Path) -> Push:
    """Simulate one push with the FMUs of all models with the sampling time of the first model.

    The push is so deep that the stiffest model reaches half of its output limit.
    """
    models = [model for model in models if model.sampling_time == models[0].sampling_time]
    time, profile = push_profile(models[0].sampling_time)
    depth = min(push_depth(model, profile) for model in models)
    outputs, delays = {}, {}
    for model in models:
        inputs = model.rest + depth * along_axes(profile, len(model.axes))
        for version in FMI_VERSIONS:
            path = folder / fmu_name(model.name, version)
            outputs[model.name, version] = simulate_fmu(path, inputs)
        both = (outputs[model.name, version] for version in FMI_VERSIONS)
        delays[model.name] = float(np.abs(np.subtract(*both)).max())
    return Push(time, depth * profile, outputs, max(delays, key=delays.__getitem__))
