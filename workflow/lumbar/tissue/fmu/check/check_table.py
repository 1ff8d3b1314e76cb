"""The table that says which FMUs were made and how they were checked."""

from __future__ import annotations

from lumbar.tables.table import Table
from lumbar.tissue.fmu.check.fmu_check import Check


def check_table(checks: list[Check], data: str, seed: int) -> Table:
    """Return the table of checked FMUs.

    Parameters
    ----------
    checks : list of Check
        Passed checks, as `lumbar.tissue.fmu.check.fmu_check.check_fmus` returns them.
    data : str
        Where the models' data come from.
    seed : int
        Seed of the test input.
    """
    import pandas as pd

    rows = [
        {
            "file": check.file,
            "model": check.model.name,
            "fmi_version": check.version,
            "states": check.model.dynamics.kept,
            "largest_pole": check.model.dynamics.largest_pole,
            "stable": "yes" if check.model.stable else "NO",
            "feedthrough": "none" if not check.model.feedthrough else _feedthrough(check.version),
            "schema_problems": len(check.schema),
            "lint_problems": len(check.lint),
            "largest_output": check.largest_output,
            "relative_error": check.largest_error,
            "tolerance": check.tolerance,
        }
        for check in checks
    ]
    first = checks[0]
    unit = first.model.output.unit
    return Table(
        title="FMUs of the identified models and their checks.",
        frame=pd.DataFrame(rows),
        data=data,
        definitions={
            "file": "FMU, a co-simulation unit",
            "model": "Name of the model",
            "fmi_version": "Version of the FMI standard",
            "states": "Numbers kept from sample to sample; for linear models the states of Eq. 3.17",
            "largest_pole": "Largest magnitude of a pole of the discrete model",
            "stable": (
                "Whether all poles lie inside the unit circle; "
                "the output of an unstable model runs into its limit"
            ),
            "feedthrough": (
                "When the input of a sample acts in the output (D of Eq. 3.18): at once (FMI 3.0 event mode) "
                "or one sample late (FMI 2.0, where a client sets the input after it has read the output); "
                "none where D = 0"
            ),
            "schema_problems": "Problems found by fmpy's validation against the standard's schema",
            "lint_problems": "Problems found in files, names, token and bounds",
            "largest_output": f"Largest magnitude of the reference output in {unit}",
            "relative_error": (
                f"Largest difference over {first.samples} samples between the FMU, simulated by fmpy, and "
                "the model in Python (scipy's lfilter; with effects, sample by sample) with the same moving average; "
                "relative to largest_output"
            ),
            "tolerance": (
                "What relative_error may be at most: 1e-12, or the bound of rounding errors where larger"
            ),
        },
        notes=(
            f"Test input: a random walk (seed {seed}) that drives the output to 80 % of its limit of "
            f"{first.model.output_limit:g} {unit}. "
            f"Moving average of {first.model.moving_average} samples at {1 / first.model.sampling_time:g} Hz on the input.",
        ),
    )


def _feedthrough(version: str) -> str:
    return "one sample late" if version == "2.0" else "at once"
