"""Files of subjects."""

import os
from pathlib import Path

from lumbar.base.errors import Problems
from lumbar.base.yaml_file import YamlFile, read_yaml
from lumbar.settings.lifting import SubjectFile, SubjectSettings
from lumbar.settings.validation import Origins, validate


def read_subject(path: Path, name: str, problems: Problems) -> tuple[SubjectSettings | None, Origins]:
    """Read a subject file with the origins of its keys; None if it cannot be used, with the reasons in `problems`."""
    before = len(problems.entries)
    file: YamlFile = read_yaml(path, problems, name)
    origins = Origins(problems, [file])
    if len(problems.entries) > before:
        return None, origins
    checked = validate(file.content, SubjectFile, origins)
    return (checked.subject if checked else None), origins


def load_subject(path: str | os.PathLike) -> SubjectSettings:
    """Return the subject of a subject file.

    Examples
    --------
    >>> import lumbar
    >>> from pathlib import Path
    >>> person = "name: ann, sex: female, mass_kg: 61, height_m: 1.68, experience: novice"
    >>> trials = "trials: [{box_mass_kg: 15, markers: ann.c3d}]"
    >>> written = Path("ann.yaml").write_text(f"subject: {{{person}, {trials}}}")
    >>> lumbar.load_subject("ann.yaml").trials[0].markers
    'ann.c3d'
    """
    problems = Problems("subject")
    subject, _ = read_subject(Path(path), str(path), problems)
    problems.raise_if_any()
    return subject
