"""The pages that people write: how long they and their sentences are, that links lead somewhere, abbreviations are explained."""

import re

import pytest
import yaml

import lumbar
from generate.thesis_items import DOCS, anchor

PROJECT = DOCS.parent
GENERATED = {"gallery.md", "thesis.md", "tissue/effects.md", "tissue/pendulum_effects.md"}
"""Made by ``make docs``, as all of ``config/``."""
MADE = (
    'rooms: by "make docs"',
    "real records",
    "hard effects",
    "calibration",
    "marker faults",
)
MADE_PARTS = re.compile(f"(?s)<!-- (?:{'|'.join(map(re.escape, MADE))}) -->.*?<!-- end.*?-->")
FENCE = re.compile(r"^[ >]*```.*?^[ >]*```", re.M | re.S)


def written() -> dict[str, str]:
    """Text of each page that people write, without the parts that a program does, by its path below ``docs``."""
    paths = {path.relative_to(DOCS).as_posix(): path for path in DOCS.rglob("*.md")}
    return {
        name: MADE_PARTS.sub("", path.read_text(encoding="utf-8"))
        for name, path in sorted(paths.items())
        if name not in GENERATED and not name.startswith("config/")
    }


WRITTEN = written()
READ_FIRST = {**WRITTEN, "../README.md": (PROJECT / "README.md").read_text(encoding="utf-8")}


def test_people_write_at_most_25_000_words_in_30_pages():
    counts = {name: len(text.split()) for name, text in READ_FIRST.items()}
    assert len(counts) <= 30
    assert sum(counts.values()) <= 25_000, sorted(counts.items(), key=lambda item: -item[1])


def test_the_readme_has_at_most_700_words():
    assert len(READ_FIRST["../README.md"].split()) <= 700


@pytest.mark.parametrize("name", READ_FIRST)
def test_links_have_words_and_lead_somewhere(name):
    page = FENCE.sub("", READ_FIRST[name])
    for words, target in re.findall(r"(?<!!)\[([^\]]+)\]\(([^)\s]+)\)", page):
        assert name.startswith("..") or not words.endswith(".md"), f"[{words}] is a file's name"
        if re.match(r"https?:", target):
            continue
        place, _, part = target.partition("#")
        path = (DOCS / name).parent / place if place else DOCS / name
        assert path.is_file(), target
        if part:
            headings = re.findall(r"^#+ (.*)", path.read_text(encoding="utf-8"), flags=re.M)
            assert part in map(anchor, headings), target


def listed(entry) -> list[str]:
    """Pages below an entry of the site's contents."""
    if isinstance(entry, str):
        return [entry]
    return [page for part in (entry.values() if isinstance(entry, dict) else entry) for page in listed(part)]


def test_every_page_stands_once_in_the_contents_of_the_site():
    text = (PROJECT / "mkdocs.yml").read_text(encoding="utf-8")
    pages = listed(yaml.safe_load(text[text.index("\nnav:") :])["nav"])
    assert sorted(pages) == sorted(path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md"))


ELSEWHERE = {
    "words of computing": "CPU CSV DOI GB HTML JSON MB PDF SHA SVG TXT UTF YAML XML",
    "names": "ARM BY CC DEC IFAC MATLAB MICCAI MIPS MIT MOSEK NATICK NET README SA SCS SGI TR",
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
    markers = lumbar.StudySettings().lifting.markers.aliases
    parts_of_markers = {part for marker in markers for part in marker.split("_")}
    known = {*" ".join(ELSEWHERE.values()).split(), *parts_of_markers}
    assert abbreviations(TEXTS[name].read_text(encoding="utf-8")) - glossary - known == set()
