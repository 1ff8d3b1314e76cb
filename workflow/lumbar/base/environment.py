"""Environment of a computation: one thread, and the versions of Python and of packages."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version

PACKAGES = (
    *("snakemake", "numpy", "scipy", "pandas", "statsmodels", "control"),
    *("cvxpy", "clarabel", "matplotlib", "fmpy", "ziglang"),
)

THREAD_COUNT_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")


def use_one_thread() -> None:
    """Limit linear algebra to one thread, in this process (before numpy is imported) and in its children.

    Otherwise the order of summation, and with it the last bits, depends on the number of cores. With matrices of a few
    columns, threads that wait for each other double the time.
    """
    for variable in THREAD_COUNT_VARIABLES:
        os.environ[variable] = "1"


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
