"""Checking finished FMUs: schema, lint, and simulation against the identified transfer function."""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lumbar.errors import NumericalError, Problems
from lumbar.runtime.description import FMI_VERSIONS
from lumbar.runtime.export_model import ExportModel
from lumbar.runtime.lint import lint_fmu
from lumbar.runtime.package import fmu_name

TOLERANCE = 1e-12
"""Largest error of a sound FMU, relative to the largest output."""
_LARGEST_GROWTH = 1e6
"""An unstable model is simulated until it has grown by this."""
_SHARE_OF_LIMIT = 0.8
"""The test input is scaled so that the output stays within this share of its limit."""


@dataclass(frozen=True)
class Check:
    """What was found for one FMU.

    Attributes
    ----------
    file : str
    largest_output : float
        In the output's unit.
    largest_error : float
        Relative to `largest_output`.
    tolerance : float
        What `largest_error` may be at most.
    schema, lint : list of str
        Problems that fmpy's validation and `lint_fmu` found.
    """

    file: str
    model: ExportModel
    version: str
    samples: int
    largest_output: float
    largest_error: float
    tolerance: float
    schema: list[str]
    lint: list[str]

    def problems(self) -> list[str]:
        """Reasons why the FMU must not be used."""
        found = [f"schema: {text}" for text in self.schema] + [f"lint: {text}" for text in self.lint]
        if not self.largest_error <= self.tolerance:
            found.append(
                f"simulated output is off by {self.largest_error:.3g} of its largest; "
                f"allowed is {self.tolerance:.3g}"
            )
        return found


def simulate_fmu(path: Path, time: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Simulate an FMU through fmpy and return its output at every sample instant.

    FMI 3.0 FMUs are driven in event mode; of the values recorded at one instant the last, after the event,
    counts.

    Parameters
    ----------
    path : Path
    time : numpy.ndarray, shape (samples,)
        ``k`` times the sampling time.
    inputs : numpy.ndarray, shape (samples,)
        Set at these instants.

    Returns
    -------
    numpy.ndarray, shape (samples,)
    """
    import fmpy

    description = fmpy.read_model_description(str(path))
    names = {variable.causality: variable.name for variable in description.modelVariables}
    signal = np.zeros(len(time), dtype=[("time", float), (names["input"], float)])
    signal["time"], signal[names["input"]] = time, inputs
    step = float(time[1] - time[0])
    # Messages of the FMU go to fmpy's own logger, which prints. A logger passed to fmpy is no alternative: it
    # keeps one pointer to it for the whole process, and calls it after Python has freed it.
    with contextlib.redirect_stdout(io.StringIO()):
        result = fmpy.simulate_fmu(
            str(path),
            start_time=0.0,
            stop_time=float(time[-1]),
            output_interval=step,
            input=signal,
            output=[names["output"]],
            use_event_mode=description.fmiVersion.startswith("3"),
        )
    outputs = np.empty(len(time))
    # Assignment goes in order: a later row of the same instant replaces an earlier one.
    for instant, value in zip(
        np.rint(result["time"] / step).astype(int), result[names["output"]], strict=True
    ):
        outputs[instant] = value
    return outputs


def reference_output(model: ExportModel, inputs: np.ndarray, version: str) -> np.ndarray:
    """Return the output by the transfer function itself, as a client of this FMI version should read it.

    Parameters
    ----------
    model : ExportModel
    inputs : numpy.ndarray, shape (samples,)
    version : str
        In FMI 2.0 the feed-through is one sample late, except at the start.

    Returns
    -------
    numpy.ndarray, shape (samples,)

    Raises
    ------
    NumericalError
        If the output overflows.
    """
    from scipy.signal import lfilter

    averaged = _averaged(inputs - model.input.offset, model.moving_average)
    outputs = lfilter(model.numerator, model.denominator, averaged)
    if version == "2.0":
        through = model.numerator[0] / model.denominator[0] * averaged
        outputs = outputs - through + np.concatenate([through[:1], through[:-1]])
    outputs = outputs + model.output.offset
    if not np.isfinite(outputs).all():
        raise NumericalError(f"{model.name}: the output overflows within {len(inputs)} samples")
    return np.clip(outputs, -model.output_limit, model.output_limit)


def _averaged(deviations: np.ndarray, samples: int) -> np.ndarray:
    """Return the moving average over the newest samples, from rest."""
    from scipy.signal import lfilter

    return lfilter(np.full(samples, 1 / samples), [1.0], deviations)


def check_input(model: ExportModel, samples: int, seed: int) -> np.ndarray:
    """Return a random walk about the rest position that drives the output to a set share of its limit.

    Parameters
    ----------
    model : ExportModel
    samples : int
    seed : int

    Returns
    -------
    numpy.ndarray, shape (samples,)
        Input in its unit.
    """
    from scipy.signal import lfilter

    walk = np.cumsum(np.random.default_rng([seed, samples]).standard_normal(samples))
    with np.errstate(over="ignore", invalid="ignore"):
        outputs = lfilter(model.numerator, model.denominator, _averaged(walk, model.moving_average))
    largest = np.abs(outputs).max()
    room = _SHARE_OF_LIMIT * model.output_limit - abs(model.output.offset)
    scale = room / largest if np.isfinite(largest) and largest > 0 and room > 0 else 1.0
    return model.input.offset + scale * walk


def rounding_bound(model: ExportModel, inputs: np.ndarray, outputs: np.ndarray) -> float:
    """Error relative to the largest output that rounding alone may cause.

    Every step rounds each of its terms by up to machine epsilon, and the poles carry each rounding on: their
    effect is at most the 1-norm of the impulse response of 1/denominator times that of one step.
    """
    from scipy.signal import lfilter

    impulse = np.zeros(len(inputs))
    impulse[0] = 1.0
    amplification = np.abs(lfilter([1.0], model.denominator, impulse)).sum()
    largest = np.abs(outputs).max()
    terms = np.abs(model.numerator).sum() * np.abs(inputs).max() + np.abs(model.denominator).sum() * largest
    return float(np.finfo(float).eps * amplification * terms / largest) if largest else 0.0


def samples_within_range(model: ExportModel, samples: int) -> int:
    """Return `samples`, or fewer where an unstable model would outgrow double precision."""
    pole = model.state_space.largest_pole
    return samples if pole <= 1.0 else max(3, min(samples, int(np.log(_LARGEST_GROWTH) / np.log(pole))))


def check_fmu(path: Path, model: ExportModel, version: str, samples: int, seed: int) -> Check:
    """Validate, lint and simulate one FMU."""
    from fmpy.validation import validate_fmu

    samples = samples_within_range(model, samples)
    inputs = check_input(model, samples, seed)
    reference = reference_output(model, inputs, version)
    simulated = simulate_fmu(path, np.arange(samples) * model.sampling_time, inputs)
    largest = float(np.abs(reference).max())
    return Check(
        file=path.name,
        model=model,
        version=version,
        samples=samples,
        largest_output=largest,
        largest_error=float(np.abs(simulated - reference).max() / (largest or 1.0)),
        tolerance=max(TOLERANCE, rounding_bound(model, inputs, reference)),
        schema=list(validate_fmu(str(path))),
        lint=lint_fmu(path),
    )


def check_fmus(models: list[ExportModel], folder: Path, samples: int, seed: int) -> list[Check]:
    """Check both FMUs of every model.

    Parameters
    ----------
    models : list of ExportModel
    folder : Path
        Where the FMUs lie.
    samples : int
        Length of the simulation.
    seed : int
        Of the input.

    Returns
    -------
    list of Check

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
        for text in check.problems():
            problems.add(check.file, text)
    problems.raise_if_any()
    return checks
