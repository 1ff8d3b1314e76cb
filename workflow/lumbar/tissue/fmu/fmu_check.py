"""Checks of the exported FMUs: fmpy's validation, simulation against the identified model, and a push; the table of it."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import fmpy
import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.tables.table import Table, table_from_schema
from lumbar.tissue.fmu.build.description import FMI_VERSIONS
from lumbar.tissue.fmu.build.export_model import ExportModel
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

TOLERANCE = 1e-12
"""Largest error of a sound FMU, relative to the largest output."""
_SHARE_OF_LIMIT = 0.8
"""The test input is scaled so that the output stays within this share of its limit."""


def validated(path: Path) -> list[str]:
    """Return the problems that fmpy finds by the standard's schema; a file that it cannot read is one."""
    from fmpy.validation import validate_fmu

    try:
        return list(validate_fmu(str(path)))
    except Exception as error:  # fmpy raises plain ones with the schema's words
        return [str(error)]


def validate_new_files(paths: Sequence[Path]) -> None:
    """Validate files that were just written, and remove them all if one has a problem.

    Raises
    ------
    InputError
        With every problem of every file.
    """
    problems = Problems("FMUs that must not be used")
    for path in paths:
        for text in validated(path):
            problems.add(path.name, text)
    try:
        problems.raise_if_any()
    except InputError:
        for path in paths:
            path.unlink()
        raise


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
    schema: list[str]
    """Problems that fmpy's validation found."""


def simulate_fmu(path: Path, inputs: np.ndarray) -> np.ndarray:
    """Play an FMU through fmpy and return its output at every sample instant, with event mode where there is one.

    The inputs are set at these instants; both have shape (samples,).
    """
    with tempfile.TemporaryDirectory(prefix="lumbar-play-") as folder:
        fmpy.extract(str(path), folder)
        fmu = UnzippedFmu(Path(folder))
        instance = Instance(fmu, event_mode=fmu.version == 3)
        outputs = np.array(instance.play(inputs.tolist()))
        instance.free()
        fmu.slave.freeLibrary()
    return outputs


def check_fmu(path: Path, model: ExportModel, version: str, samples: int, seed: int) -> Check:
    """Validate one FMU and simulate it with a random walk that drives the output to a set share of its limit."""
    samples = samples_within_range(model, samples)
    shape = (samples, len(model.axes)) if model.axes else samples
    walk = np.cumsum(np.random.default_rng([seed, samples]).standard_normal(shape), axis=0)
    largest = _SHARE_OF_LIMIT * model.output_limit - abs(model.output.offset)
    inputs = model.rest + scale_to(model, moving_average(walk, model.moving_average), largest) * walk
    reference = reference_output(model, inputs, version)
    simulated = simulate_fmu(path, inputs)
    largest = float(np.abs(reference).max())
    return Check(
        file=path.name,
        model=model,
        version=version,
        samples=samples,
        largest_output=largest,
        largest_error=float(np.abs(simulated - reference).max() / (largest or 1.0)),
        tolerance=max(TOLERANCE, model.dynamics.rounding_bound(inputs, reference)),
        schema=validated(path),
    )


def check_fmus(models: list[ExportModel], folder: Path, samples: int, seed: int) -> list[Check]:
    """Check both FMUs of every model in a folder by a simulation of this number of samples with an input of this seed.

    Raises
    ------
    InputError
        If any FMU has a problem, with all of them.
    """
    checks = [
        check_fmu(folder / fmu_name(model.name, version), model, version, samples, seed)
        for model in models
        for version in FMI_VERSIONS
    ]
    problems = Problems("FMUs that must not be used")
    for check in checks:
        for text in check.schema:
            problems.add(check.file, f"schema: {text}")
        if not check.largest_error <= check.tolerance:
            error, allowed = f"{check.largest_error:.3g}", f"{check.tolerance:.3g}"
            problems.add(
                check.file, f"simulated output is off by {error} of its largest; allowed is {allowed}"
            )
    problems.raise_if_any()
    return checks


def check_table(checks: list[Check], source_label: str, seed: int) -> Table:
    """Return the table of checked FMUs; `source_label` is the source of the models' data, `seed` that of the test input."""
    rows = [
        {
            "file": check.file,
            "model": check.model.name,
            "fmi_version": check.version,
            "rate_Hz": 1 / check.model.sampling_time,
            "averaged": check.model.moving_average,
            "states": check.model.dynamics.kept,
            "largest_pole": check.model.dynamics.largest_pole,
            "stable": "yes" if check.model.stable else "NO",
            "feedthrough": {"2.0": "one sample late", "3.0": "at once"}[check.version]
            if check.model.feedthrough
            else "none",
            "schema_problems": len(check.schema),
            "largest_output": check.largest_output,
            "relative_error": check.largest_error,
            "tolerance": check.tolerance,
        }
        for check in checks
    ]
    first = checks[0].model
    words = {
        "seed": seed,
        "samples": checks[0].samples,
        "unit": first.output.unit,
        "limit": first.output_limit,
    }
    return table_from_schema("tissue/fmu", "fmu_checks", rows, source_label, words)


@dataclass(frozen=True)
class Push:
    """Outputs of all FMUs to the same movement."""

    time: np.ndarray
    """Shape (samples,): seconds."""
    inputs: np.ndarray
    """Shape (samples,)."""
    outputs: dict[tuple[str, str], np.ndarray]
    """Dict of tuple (str, str) to numpy.ndarray, each of shape (samples,): by model and FMI version."""

    def most_delayed(self) -> str:
        """Model whose FMI 2.0 output differs most from that of FMI 3.0."""
        names = dict.fromkeys(name for name, _ in self.outputs)
        return max(
            names, key=lambda name: np.abs(self.outputs[name, "2.0"] - self.outputs[name, "3.0"]).max()
        )


def push(models: list[ExportModel], folder: Path) -> Push:
    """Play one push through the FMUs in a folder, of all models that sample at the first one's rate.

    The depth is chosen such that the stiffest model reaches half of its output limit. All have the same input.
    """
    models = [model for model in models if model.sampling_time == models[0].sampling_time]
    time, profile = push_profile(models[0].sampling_time)
    depth = min(push_depth(model, profile) for model in models)
    outputs = {
        (model.name, version): simulate_fmu(
            folder / fmu_name(model.name, version),
            model.rest + depth * along_axes(profile, len(model.axes)),
        )
        for model in models
        for version in FMI_VERSIONS
    }
    return Push(time, depth * profile, outputs)
