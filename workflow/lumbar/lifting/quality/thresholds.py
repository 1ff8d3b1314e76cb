"""What the checks of recordings compare with, from ``thresholds.yaml``."""

from pathlib import Path
from types import SimpleNamespace

from lumbar.base.yaml_file import shipped_yaml


def thresholds(module: str) -> SimpleNamespace:
    """Return those of a module."""
    return SimpleNamespace(**shipped_yaml(Path(__file__).with_suffix(".yaml"))[module])
