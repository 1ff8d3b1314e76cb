"""Tables of cases that stand in a YAML file beside their tests: what is given, and the words that are said of it."""

from pathlib import Path
from typing import Any

import yaml


def cases(test: str, name: str) -> Any:
    """Return a table of the file beside a test module, whose ``__file__`` is given."""
    return yaml.safe_load(Path(test).with_suffix(".yaml").read_text(encoding="utf-8"))[name]
