"""What the verbs return has in common: how it is saved, and what a notebook shows of it."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any


class Result:
    """What a verb found: printed it says so in sentences, a notebook shows its table, `save` writes its files."""

    data: str
    """Words for the source of the data."""

    def files(self) -> Iterable[tuple[str, Any]]:
        """Name and content of every file: frames (``.csv``), plain data (``.json``), published tables and figures (no ending)."""
        raise NotImplementedError

    def save(self, folder: str | os.PathLike) -> None:
        """Write all `files` into a folder; tables and figures in each of their formats."""
        for name, content in self.files():
            _write(Path(folder) / name, content, self.data)

    @property
    def shown(self) -> Any:
        """What a notebook shows: a published table, a frame or rows."""
        return self.table  # type: ignore[attr-defined]  # of a subclass that has one

    def _repr_html_(self) -> str:
        import pandas as pd

        return pd.DataFrame(getattr(self.shown, "frame", self.shown)).to_html(index=False)


def _write(path: Path, content: Any, data: str) -> None:
    from lumbar.base.files import write_csv, write_json

    if path.suffix == ".csv":
        write_csv(path, content)
    elif path.suffix == ".json":
        write_json(path, content)
    elif hasattr(content, "write"):
        content.write(path)
    else:
        from lumbar.publishing.figures.style import save

        save(content, path, data)
