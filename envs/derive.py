"""Tidy lock.txt; derive from it the locks of the runtime, of build tools and of the cluster, and lumbar.yaml (conda).

The lock is the one place where versions are decided; ``make lock`` renews it and calls this script.
"""

from __future__ import annotations

import re
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
BUILD = ("pip", "setuptools")
CONDA_PYTHON = "3.12"

CONDA_HEADER = """\
# Derived from runtime-lock.txt by derive.py: the same versions for "snakemake --sdm conda".
channels:
  - conda-forge
  - nodefaults
dependencies:
  - python={python}
  - pip={pip}
  - pip:
"""


def entries(lock: str) -> dict[str, str]:
    """Split a lock into its requirements: ``name==version`` to the text with its hashes."""
    blocks = re.split(r"\n(?=[A-Za-z0-9])", lock.strip())
    return {re.match(r"[^ ]+", block).group(): block for block in blocks}


def supported(lock: str) -> str:
    """Drop what only Python 3.14 and later would install, which the project does not support yet."""
    kept = [block for block in entries(lock).values() if "python_full_version >= '3.14'" not in block]
    return "\n".join(block.replace(" ; python_full_version < '3.14'", "") for block in kept) + "\n"


def pins(lock: str) -> list[str]:
    """Return each requirement without hashes, e.g. ``numpy==2.4.6``, markers included."""
    return [block.split(" \\\n")[0].strip() for block in entries(lock).values()]


def runtime_lock(compiled: str, lock: str) -> str:
    """Text of the lock of the packages that jobs need: the lock's entries of those in a compiled list."""
    names = {pin.split("==")[0] for pin in entries(compiled)}
    return "\n".join(block for pin, block in entries(lock).items() if pin.split("==")[0] in names) + "\n"


def conda_environment(runtime: str, lock: str) -> str:
    """Text of the conda environment with the versions of the runtime's lock, and the lock's pip."""
    pip = next(pin.split("==")[1] for pin in pins(lock) if pin.startswith("pip=="))
    lines = [f"      - {pin}" for pin in pins(runtime)]
    return CONDA_HEADER.format(python=CONDA_PYTHON, pip=pip) + "\n".join(lines) + "\n"


def build_lock(lock: str) -> str:
    """Text of the lock of the build tools."""
    return "\n".join(block for pin, block in entries(lock).items() if pin.split("==")[0] in BUILD) + "\n"


def additions(cluster_lock: str, lock: str) -> str:
    """Text of the cluster's lock: what it adds to the lock, or needs in another version."""
    present = entries(lock)
    return (
        "\n".join(block for pin, block in entries(supported(cluster_lock)).items() if pin not in present)
        + "\n"
    )


if __name__ == "__main__":
    text = supported((FOLDER / "lock.txt").read_text(encoding="utf-8"))
    (FOLDER / "lock.txt").write_text(text, encoding="utf-8")
    cluster = FOLDER / "cluster-lock.txt"
    cluster.write_text(additions(cluster.read_text(encoding="utf-8"), text), encoding="utf-8")
    (FOLDER / "build-lock.txt").write_text(build_lock(text), encoding="utf-8")
    runtime = runtime_lock((FOLDER / "runtime-lock.txt").read_text(encoding="utf-8"), text)
    (FOLDER / "runtime-lock.txt").write_text(runtime, encoding="utf-8")
    (FOLDER / "lumbar.yaml").write_text(conda_environment(runtime, text), encoding="utf-8")
