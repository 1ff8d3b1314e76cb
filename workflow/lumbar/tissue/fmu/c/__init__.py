"""The C sources that are the same in every FMU."""

from functools import cache
from pathlib import Path

FOLDER = Path(__file__).parent


@cache
def c_source(name: str) -> str:
    """Return the text of a file of this folder, with LF as line ends."""
    return (FOLDER / name).read_text(encoding="utf-8").replace("\r\n", "\n")
