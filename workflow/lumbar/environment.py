"""What a result was computed with: versions of Python and of the packages the numbers depend on."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

PACKAGES = (
    "snakemake",
    "numpy",
    "scipy",
    "pandas",
    "statsmodels",
    "control",
    "cvxpy",
    "clarabel",
    "matplotlib",
    "fmpy",
    "ezc3d",
    "c3d",
    "ziglang",
)


def describe_environment() -> dict:
    """Return the versions of Python, lumbar and of the packages named in `PACKAGES` that are installed."""
    from lumbar import __version__

    versions = {"python": platform.python_version(), "lumbar": __version__}
    for name in PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = None
    return {"versions": versions}
