"""Time per step of exported FMUs in C and through fmpy, and energy that passive models give out.

    python benchmarks/runtime.py [--steps 1000000]

The limits are meant for an idle machine. A limit that was not kept is printed; it is not an error.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1] / "tests"
sys.path[:0] = [str(TESTS / "unit"), str(TESTS)]

from c_programs import loader_program  # noqa: E402
from effect_entries import COMBINATIONS, FIVE_EFFECTS, effect_entry  # noqa: E402
from runtime_models import SETTINGS, models_json, selected  # noqa: E402
from spatial_models import FIVE, spatial_export  # noqa: E402

from lumbar.tissue.fmu.build.compiler import TARGETS, cache_folder, host_target  # noqa: E402
from lumbar.tissue.fmu.build.package import export_fmus  # noqa: E402
from study_settings import changed  # noqa: E402

CACHE = cache_folder(None)
STEPS = 200_000

THROUGH_FMPY = """
import sys, time, statistics, fmpy
from fmpy.fmi2 import FMU2Slave
path, references = sys.argv[1], {}
description = fmpy.read_model_description(path)
for variable in description.modelVariables:
    references[variable.name] = variable.valueReference
slave = FMU2Slave(guid=description.guid, unzipDirectory=fmpy.extract(path),
                  modelIdentifier=description.coSimulation.modelIdentifier, instanceName="b")
slave.instantiate(); slave.setupExperiment(startTime=0.0)
slave.enterInitializationMode(); slave.exitInitializationMode()
taken = []
for k in range(20000):
    begin = time.perf_counter_ns()
    slave.setReal([references["position"]], [k % 100 * 0.01]); slave.doStep(k * 0.01, 0.01)
    slave.getReal([references["force"]])
    taken.append(time.perf_counter_ns() - begin)
print(statistics.median(taken))
"""


DEVICE = changed(SETTINGS, rate_Hz=1000.0, moving_average_ms=3.0, start="first_position")
"""Default models of an export."""
DAMPING = 2.75
"""Viscosity of the device of a passive model, N s/m."""
IN_SPACE = "orthotropic_KB"
LIMITS_NS = {"model_linear.c": 60, FIVE_EFFECTS["name"]: 150, IN_SPACE: 400}
"""Median of one set, step and get, by source or by name of the model."""


def models(settings):
    """Return linear models, five effects at once, along three axes too, and some combinations, at the rate of a haptic loop."""
    entries = [FIVE_EFFECTS, *(effect_entry(*structure) for structure in COMBINATIONS)]
    linear = selected(models_json(), changed(settings, models=["KB", "MW", "HO"]))
    nonlinear = selected(
        models_json(*entries), changed(settings, models=[entry["name"] for entry in entries])
    )
    in_space = spatial_export(FIVE, moving_average_ms=3.0, device_damping=settings.device_damping)
    return [*linear, *nonlinear, in_space]


def library(folder: Path, model) -> tuple[Path, str]:
    """Library of a model's unzipped FMI 2.0 file and its token."""
    unzipped = folder / model.identifier
    with zipfile.ZipFile(folder / f"{model.name}_fmi2.fmu") as archive:
        archive.extractall(unzipped)
        description = archive.read("modelDescription.xml").decode()
    platform = TARGETS[host_target()]
    path = unzipped / "binaries" / platform.fmi2 / f"{model.identifier}{platform.suffix}"
    return path, description.split('guid="')[1].split('"')[0]


def printed(program: Path, mode: str, folder: Path, model, *arguments) -> list[float]:
    """Numbers that the C client prints."""
    command = [program, mode, *library(folder, model), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return [float(word) for word in done.stdout.split()]


def c_client(program: Path, folder: Path, exported: list) -> list[tuple]:
    """Times of one set, step and get in ns, without that of reading the clock.

    The same steps are replayed: the fastest replay's median counts, the slowest's says how noisy the machine is. What
    interrupts a step does not do so in every replay: each step's least time is the FMU's own.
    """
    rows = []
    for model in exported:
        medians = {}
        for kind in ("live", "decayed"):
            median, high, slowest, least, least_high, clock = printed(
                program, "timing", folder, model, STEPS, kind, model.sampling_time
            )
            medians[kind], label = median, f"C client, {model.name}, {kind}"
            rows += [
                (
                    f"{label}, median",
                    median,
                    "ns",
                    LIMITS_NS.get(
                        IN_SPACE if model.axes else model.name, LIMITS_NS.get(model.dynamics.c_source)
                    ),
                ),
                (f"{label}, median of the slowest replay", slowest, "ns", None),
                (f"{label}, 99.9 % to median of each step's least time", least_high / least, "1", 3),
                (f"{label}, 99.9 % to median with interruptions", high / median, "1", None),
                (f"{label}, 99.9 % of the clock alone", clock, "ns", None),
            ]
        rows.append(
            (f"C client, {model.name}, decayed to live", medians["decayed"] / medians["live"], "1", 2)
        )
    return rows


def passivity(program: Path, folder: Path, steps: int) -> list[tuple]:
    """Most energy in J that a device and a passive model gave out beyond what they took in, in either version."""
    exported = models(changed(DEVICE, device_damping=DAMPING))
    export_fmus(exported, folder, "benchmark", ["host"], CACHE)
    rows = []
    for model in exported:
        unit = model.units.position * model.resistance
        for gain, label in ((0, ""), (model.settings.gain_limit, ", switched")):
            arguments = (steps, model.sampling_time, unit, DAMPING, gain)
            margins = printed(program, "passive", folder, model, *arguments)
            what = f"passive, {model.name}{label}, given out beyond taken in"
            rows.append((what, -min(margins[:3]), "J", 1e-12))
    return rows


def through_fmpy(path: Path) -> tuple:
    """Median of one set, step and get through fmpy in ns."""
    command = [sys.executable, "-c", THROUGH_FMPY, path]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return "through fmpy, KB, median", float(done.stdout.split()[-1]), "ns", None


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--steps", type=int, default=1_000_000, help="that count the energy of passive models"
    )
    options = parser.parse_args()
    exported = models(DEVICE)
    with tempfile.TemporaryDirectory(prefix="lumbar-benchmark-") as name:
        folder = Path(name)
        export_fmus(exported, folder, "benchmark", ["host"], CACHE)
        program = loader_program(TESTS / "unit" / "fmu_client.c", host_target(), folder, CACHE)
        rows = c_client(program, folder, exported)
        rows.append(through_fmpy(folder / "KB_fmi2.fmu"))
        rows += passivity(program, folder / "passive", options.steps)
    for what, value, unit, limit in rows:
        verdict = "" if limit is None else f"  (limit {limit}: {'kept' if value <= limit else 'NOT KEPT'})"
        print(f"{what:72} {value:10.4g} {unit}{verdict}")


if __name__ == "__main__":
    main()
