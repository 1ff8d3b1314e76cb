"""Models and settings for the tests of the FMU export."""

from __future__ import annotations

from lumbar.settings.runtime import RuntimeSettings

TARGET = ["x86_64-linux"]
POSITION, FORCE, GAIN, FORCE_OFFSET, FORCE_LIMIT, POSITION_OFFSET = 1, 2, 3, 4, 5, 6
"""Value references."""
SETTINGS = RuntimeSettings(models=("IL", "MW", "KB", "HO"))


def entry(name: str, numerator, denominator, **more) -> dict:
    """One entry of tissue/models.json."""
    values = {
        "name": name,
        "trained_on": "multisine",
        "estimator": "arx",
        "numerator": numerator,
        "denominator": denominator,
        "alpha": 0.27,
        "input_offset": 0.0,
        "output_offset": 0.0,
        "stable": True,
        "physical": {},
        "vaf_percent": 81.2,
    }
    return {**values, **more}


def models_json(*entries: dict) -> dict:
    """Contents of tissue/models.json; without entries those that the tests share."""
    return {
        "schema": "lumbar.models/1",
        "sampling_time_s": 0.01,
        "input": {"quantity": "position", "unit": "mm"},
        "output": {"quantity": "force", "unit": "N"},
        "models": list(entries)
        or [
            entry("IL", [-0.125], [1.0], trained_on=None, estimator=None, alpha=None, vaf_percent=None),
            entry("MW", [0.0, 0.3], [1.0, -0.35], input_offset=0.1, output_offset=0.02),
            entry("KB", [1.9, -1.2], [1.0, -0.45]),
            entry("HO", [1.9, -2.9, 1.1], [1.0, -1.5, 0.57], input_offset=-0.4, output_offset=-0.3),
        ],
    }


def put(slave, reference: int, value: float) -> None:
    """Set a variable of an FMI 2.0 or 3.0 instance."""
    setter = slave.setReal if hasattr(slave, "setReal") else slave.setFloat64
    setter([reference], [value])


def get(slave, reference: int = FORCE) -> float:
    """Get a variable of an FMI 2.0 or 3.0 instance."""
    getter = slave.getReal if hasattr(slave, "getReal") else slave.getFloat64
    return getter([reference])[0]
