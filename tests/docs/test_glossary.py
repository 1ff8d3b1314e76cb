"""Abbreviations of the field that pages, captions and the notes of tables use stand in the glossary."""

import re

import pytest

from generate.thesis_items import DOCS
from lumbar.settings.lifting import ALIASES

PROJECT = DOCS.parent
ELSEWHERE = {
    "words of computing": "CPU CSV DOI GB HTML JSON MB PDF RFC SHA SVG TXT UTF YAML XML",
    "names": "ARM BY CC DEC IFAC MATLAB MICCAI MIPS MIT MOSEK NATICK NET PLUS QTM README RO SA SCS SGI TR",
    "placeholders and words written large": "BASE DEGREE DIR FILE FOLDER II NAME STUDY WRONG",
    "stiffness times period": "KT",
}
TEXTS = {
    path.relative_to(PROJECT).as_posix(): path
    for pattern in (
        "README.md",
        "docs/**/*.md",
        "config/artefacts.tsv",
        "workflow/report/*.rst",
        "workflow/lumbar/**/tables.yaml",
    )
    for path in sorted(PROJECT.glob(pattern))
}


def abbreviations(text: str) -> set[str]:
    """Words in capitals, but for those in code, in addresses and in comments."""
    prose = re.sub(r"```.*?```|`[^`]*`|\]\([^)]*\)|!\[|<!--.*?-->|^:::[^\n]*", " ", text, flags=re.S | re.M)
    return set(re.findall(r"(?<![\w-])([A-Z]{2,6}\d?)s?(?![\w])", prose))


@pytest.mark.parametrize("name", TEXTS)
def test_abbreviations_stand_in_the_glossary(name):
    glossary = set(re.findall(r"\b[A-Z][A-Z\d]+\b", (DOCS / "glossary.md").read_text(encoding="utf-8")))
    parts_of_markers = {part for marker in ALIASES for part in marker.split("_")}
    known = {*" ".join(ELSEWHERE.values()).split(), *parts_of_markers}
    assert abbreviations(TEXTS[name].read_text(encoding="utf-8")) - glossary - known == set()
