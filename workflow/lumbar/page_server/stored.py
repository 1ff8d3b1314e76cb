"""Verdicts that a study's run left in its results, which are shown instead of being computed again."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from lumbar.base.errors import Problems
from lumbar.base.files import read_json
from lumbar.base.yaml_file import read_yaml


@dataclass(frozen=True)
class StoredVerdict:
    """The diagnosis of one record set in ``results/<study>/improvement``."""

    folder: Path
    settings: Mapping[str, Any] | None = None
    """The study's as they are now, as plain data; None takes the verdict as it stands."""
    sources: Sequence[Path] = ()
    """Recordings and files of settings."""

    @property
    def page(self) -> Path:
        """Its page as a file."""
        return self.folder / "diagnosis.html"

    @property
    def made(self) -> str:
        """When it was made."""
        return f"{datetime.fromtimestamp(self.page.stat().st_mtime):%Y-%m-%d %H:%M}"

    @property
    def holds(self) -> bool:
        """Whether it is there and of these settings and recordings: the run had the same settings, no file is newer."""
        if not self.page.is_file():
            return False
        if self.settings is None:
            return True
        made = self.page.stat().st_mtime
        if any(path.is_file() and path.stat().st_mtime > made for path in self.sources):
            return False
        run = self.folder.parents[1] / "run_config.yaml"
        return run.is_file() and read_yaml(run, Problems(str(run))).content == self.settings

    @property
    def sentence(self) -> str:
        """What it says."""
        # Here, not above: the server listens before Matplotlib is read.
        from lumbar.publishing.study_report.contents import diagnosis_sentence

        return diagnosis_sentence(read_json(self.folder / "diagnosis.json"))
