"""Abbreviations of the field that the pages use stand in the glossary."""

import re

import pytest

ELSEWHERE = set("BY CC CPU CSV FOLDER GB HTML JSON MATLAB MB MIT PDF README SA STUDY SVG YAML".split())  # noqa: SIM905
"""Words of computing, licences, and placeholders."""
PAGES = (
    "README.md",
    "docs/index.md",
    "docs/troubleshooting.md",
    "docs/tissue/tutorial.md",
    "docs/tissue/naming.md",
)


@pytest.mark.parametrize("page", PAGES)
def test_abbreviations_stand_in_the_glossary(project, page):
    text = (project / page).read_text(encoding="utf-8")
    prose = re.sub(r"```.*?```|`[^`]*`|\]\([^)]*\)|!\[", " ", text, flags=re.S)
    glossary = set(
        re.findall(r"\b[A-Z][A-Z\d]+\b", (project / "docs/glossary.md").read_text(encoding="utf-8"))
    )
    used = set(re.findall(r"\b([A-Z]{2,6})s?\b", prose))
    assert used - glossary - ELSEWHERE == set()
