"""Tables of cases in a YAML file with the name of a test module."""

from pathlib import Path
from typing import Any

import yaml


def cases(test: str, name: str) -> Any:
    """Return a table of the YAML file of a test module with this ``__file__``."""
    return yaml.safe_load(Path(test).with_suffix(".yaml").read_text(encoding="utf-8"))[name]
