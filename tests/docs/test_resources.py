"""Every file that comes with the project says where it is from, and the citation names what is reproduced."""

import re
from pathlib import Path

import yaml

PROJECT = Path(__file__).resolve().parents[2]
RESOURCES = PROJECT / "resources"


def test_every_resource_has_its_provenance_and_licence():
    text = (RESOURCES / "README.md").read_text(encoding="utf-8")
    rows = [line.strip("|").split("|") for line in text.splitlines() if line.startswith("| `")]
    named = [name for row in rows for name in re.findall(r"`(.+?)`", row[0])]
    files = {path.relative_to(RESOURCES).as_posix() for path in RESOURCES.rglob("*") if path.is_file()}
    assert sorted(named) == sorted(files - {"README.md"})
    assert all(len(row) == 4 and all(map(str.strip, row)) for row in rows)


def test_the_citation_names_thesis_and_article():
    citation = yaml.safe_load((PROJECT / "CITATION.cff").read_text(encoding="utf-8"))
    assert sorted(reference["type"] for reference in citation["references"]) == ["article", "thesis"]
