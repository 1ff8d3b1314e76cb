"""The files that make the project: what an archive of a run holds as its code."""

from functools import cache
from pathlib import Path

_FOLDERS = ("config", "envs", "profiles", "resources", "workflow")
_FILES = ("Snakefile", "pyproject.toml", "Makefile", "README.md", "LICENSE", "CITATION.cff")


@cache
def project_files(root: Path) -> list[str]:
    """Return the names of the files below the project's folder, sorted; those of `_FILES` that are there."""
    inside = (path for folder in _FOLDERS for path in (root / folder).rglob("*"))
    found = [path for path in (*inside, *(root / name for name in _FILES)) if path.is_file()]
    return sorted(path.relative_to(root).as_posix() for path in found if "__pycache__" not in path.parts)
