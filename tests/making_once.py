"""What several workers of a test session need is made by the first that asks; the others wait and take it over."""

import pickle
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from filelock import FileLock


@dataclass(frozen=True)
class MadeOnce:
    """Things made once below one folder that all workers of a session see."""

    root: Path

    def __call__(self, name: str, make: Callable[[Path], Any]) -> tuple[Path, Any]:
        """Return the folder ``root/name``, filled by `make`, and what `make` returned, which can be pickled.

        Where `make` failed in one worker, all fail: it is not tried again.
        """
        folder, outcome = self.root / name, self.root / f"{name}.outcome"
        with FileLock(self.root / f"{name}.lock"):
            if not outcome.exists():
                folder.mkdir()
                outcome.write_bytes(pickle.dumps(_attempt(make, folder)))
        error, made = pickle.loads(outcome.read_bytes())
        assert error is None, f"{name}: {error}"
        return folder, made


def _attempt(make: Callable[[Path], Any], folder: Path) -> tuple[str | None, Any]:
    try:
        return None, make(folder)
    except Exception as error:
        return f"{type(error).__name__}: {error}", None
