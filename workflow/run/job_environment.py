"""The environment every job inherits."""

from __future__ import annotations

import os
from pathlib import Path

from lumbar.base.environment import use_one_thread


def set_job_environment(workflow: Path) -> None:
    """Make the library importable without installation, and results the same bytes for any number of cores.

    Parameters
    ----------
    workflow : Path
        Folder that holds the library.
    """
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(workflow), os.environ.get("PYTHONPATH")]))
    os.environ["SOURCE_DATE_EPOCH"] = "0"
    use_one_thread()
