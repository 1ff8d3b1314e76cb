"""Models and settings for the tests of the FMU export."""

import zipfile
from collections.abc import Mapping
from pathlib import Path

import fmpy
import numpy as np
from c_programs import CModel
from effect_entries import COMBINATIONS, effect_entry

from lumbar.settings.runtime import RuntimeSettings
from lumbar.tissue.effects.catalogue import CATALOGUES, read_model_bases
from lumbar.tissue.fmu.build.export_model import ExportModel, export_models, find_models
from lumbar.tissue.fmu.build.package import export_fmus
from lumbar.tissue.fmu.fmu_check import check_fmus, simulate_fmu
from lumbar.tissue.models.fitted_model import read_models
from lumbar.tissue.models.form import Effect
from lumbar.tissue.models.model_entry import OWN_BASES
from running import ZIG_CACHE
from study_settings import changed

TARGET = ["x86_64-linux"]
POSITION, FORCE, GAIN, FORCE_OFFSET, FORCE_LIMIT, POSITION_OFFSET = 1, 2, 3, 4, 5, 6
FORCE_RATE_LIMIT, ENERGY = 7, 10
"""Value references."""
RANGE = {"lowest": -2.4, "highest": 2.5, "speed": 41.0, "lowest_Hz": 0.1, "highest_Hz": 5.0}
"""Motion that a model was fitted to."""
SETTINGS = RuntimeSettings(
    models=("IL", "MW", "KB", "HO"), rate_Hz=None, moving_average_ms=30.0, start="offset"
)
"""As in the thesis: 100 Hz, three samples, from rest at the offset."""


def entry(name: str, numerator, denominator, **more) -> dict:
    """One entry of tissue/models.json."""
    values = {
        "name": name,
        "structure": {"numerator": numerator, "denominator": denominator},
        "sampling_time": 0.01,
        "input": {"quantity": "position", "unit": "mm", "offset": 0.0},
        "output": {"quantity": "force", "unit": "N", "offset": 0.0},
        "trained_on": "multisine",
        "estimator": "arx",
        "alpha": 0.27,
        "scores": {"vaf_percent": 81.2},
    }
    return {**values, **more}


def about(position: float, force: float) -> dict:
    """Signals of an entry whose rest is at this position in mm and force in N."""
    return {
        "input": {"quantity": "position", "unit": "mm", "offset": position},
        "output": {"quantity": "force", "unit": "N", "offset": force},
    }


def models_json(*entries: dict) -> dict:
    """Contents of tissue/models.json; without entries those that the tests share."""
    return {
        "schema": "lumbar.models/2",
        "models": list(entries)
        or [
            entry("IL", [-0.125], [1.0], trained_on=None, estimator="given", alpha=None, scores={}),
            entry("MW", [0.0, 0.3], [1.0, -0.35], **about(0.1, 0.02)),
            entry("KB", [1.9, -1.2], [1.0, -0.45], valid_for=RANGE),
            entry("HO", [1.9, -2.9, 1.1], [1.0, -1.5, 0.57], **about(-0.4, -0.3)),
        ],
    }


def selected(
    content: dict, settings: dict, catalogue: Mapping[str, Effect] | None = None
) -> list[ExportModel]:
    """Models of this content that these settings export; its effects are the tissue's unless a catalogue is given."""
    catalogues = CATALOGUES if catalogue is None else {"tissue": catalogue}
    models = read_models(content, {**catalogues, OWN_BASES: read_model_bases(content)})
    return export_models(find_models(models, settings), settings)


HIGH_ORDER = entry("HO", [0.0, 5.0, -8.0, 3.5], [1.0, 0.1, -0.2, 0.05])
"""As in the default study: a sample late, and with poles that no continuous model has."""
DEVICE = changed(SETTINGS, rate_Hz=1000.0, moving_average_ms=3.0, start="first_position")
"""The defaults of the export."""


def device_models(*names: str, **settings) -> list[ExportModel]:
    """Return some of the shared models, of one of high order, and of one with effects, at 1 kHz."""
    entries = [item for item in models_json()["models"] if item["name"] != "HO"]
    content = models_json(*entries, HIGH_ORDER, effect_entry(*COMBINATIONS[0]))
    return selected(content, changed(DEVICE, models=list(names), **settings))


def export(
    models: list[ExportModel], folder: Path, label: str = "synthetic twin", targets=TARGET, **options
) -> list[Path]:
    """Write the FMUs of models, by default for x86-64 Linux."""
    return export_fmus(models, folder, label, targets, ZIG_CACHE, **options)


def contents(path: Path) -> dict[str, bytes]:
    """Return the files of an FMU by their paths."""
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def unzipped(path: Path, folder: Path) -> Path:
    """Unzip an FMU into a folder, and return this."""
    if not folder.exists():
        fmpy.extract(str(path), str(folder))
    return folder


def forces_of(path: Path, positions: np.ndarray) -> np.ndarray:
    """Return the forces of an FMU at these positions, with event mode in FMI 3.0."""
    return simulate_fmu(path, positions)


def set_variable(slave, reference: int, value: float) -> None:
    """Set a variable of an FMI 2.0 or 3.0 instance."""
    setter = slave.setReal if hasattr(slave, "setReal") else slave.setFloat64
    setter([reference], [value])


def get(slave, reference: int = FORCE) -> float:
    """Get a variable of an FMI 2.0 or 3.0 instance."""
    getter = slave.getReal if hasattr(slave, "getReal") else slave.getFloat64
    return getter([reference])[0]


def exported(entry: dict, **settings):
    """Return the model of an entry as it is exported."""
    chosen = changed(SETTINGS, models=[entry["name"]], **settings)
    return selected(models_json(entry), chosen)[0]


def random_motion(samples: int, seed: int) -> np.ndarray:
    """Movement with slow and fast parts, rests and steps about a mean of 0.5 mm."""
    generator = np.random.default_rng(seed)
    walk = np.cumsum(generator.standard_normal(samples)) * 0.1
    walk -= np.linspace(0.0, walk[-1], samples)
    rest = np.repeat(generator.random(samples // 50 + 1) < 0.2, 50)[:samples]
    held = np.maximum.accumulate(np.where(rest, 0, np.arange(samples)))
    return 0.5 + walk[held]


def check_simulation(model: ExportModel, folder, cache) -> None:
    """Compare C code sample by sample with the effects' own simulation; then check both FMUs through fmpy."""
    walk = np.cumsum(np.random.default_rng(3).standard_normal(800)) * 0.1
    expected = model.dynamics.response(walk)
    compiled = CModel(model, folder / "c", cache).response(walk)
    np.testing.assert_allclose(compiled, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    export([model], folder)
    for check in check_fmus([model], folder, 200, seed=5):
        assert check.largest_output > 0.1
