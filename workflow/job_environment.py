"""The environment every job inherits."""

from __future__ import annotations

import os
from pathlib import Path

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")


def set_job_environment(workflow: Path) -> None:
    """Make the library importable without installation, and results the same bytes for any number of cores.

    Parameters
    ----------
    workflow : Path
        Folder that holds the library.
    """
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(workflow), os.environ.get("PYTHONPATH")]))
    os.environ["SOURCE_DATE_EPOCH"] = "0"
    for variable in THREADS:
        os.environ[variable] = "1"
