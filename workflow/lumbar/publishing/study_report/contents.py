"""Contents of a study's report: its artefacts in the thesis's order, with captions, files and the thesis's values."""

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from html import unescape
from pathlib import Path

import pandas as pd

from lumbar.base.files import read_json
from lumbar.publishing.figures.style import SUBJECT_PREFIX
from lumbar.publishing.pages.sketches import ladder_sketch, lift_sketch
from lumbar.publishing.study_report.main_results import find_clearest_diagnosis
from lumbar.study.study import Artefact
from lumbar.tables.table import svg_address
from lumbar.tables.table_layout import column_in_words, scientific, split_number

_NUMBER = re.compile(r"-?\d+\.\d{3,}")
_LENGTHS = re.compile(r'(?<=\s)(?:d|points|x|y|cx|cy)="[^"]*"')
_GLYPH = re.compile(r'<path id="([^"]+-[^"]+)"[^>]*/>')
_TEXT = re.compile(
    r'<!-- (?P<text>[^$]*?) -->\s*<g (?:style="(?P<style>[^"]*)" )?transform="(?P<place>[^"]*) '
    r'scale\((?P<scale>[\d.]+) -[\d.]+\)">(?P<outlines>.*?)</g>',
    flags=re.S,
)
_UNUSED = re.compile(
    r'<metadata>.*?</metadata>|<!--.*?-->|<defs>\s*</defs>|(?<=<g) id="[^"]*"| style=""', flags=re.S
)
_FONT = "<style>text{font-family:Arimo,Arial,Liberation Sans,Helvetica,sans-serif}</style>"
_DESCRIPTION = re.compile(r"<dc:description>(.*?)</dc:description>", flags=re.S)
_SIZE = re.compile(r'<svg\b[^>]*?\bviewBox="[\d.+-]+ [\d.+-]+ ([\d.]+) ([\d.]+)"', flags=re.S)


@dataclass(frozen=True)
class Picture:
    """A picture embedded in the page."""

    address: str
    """``data:`` address of the SVG file."""
    width: int
    """Width in points."""
    height: int
    """Height in points."""
    source_label: str
    """Origin of the data, or ``"Drawing without data"``."""
    shows: str = ""
    """Subject and box, if it shows one lift."""


def _read_picture(path: Path) -> Picture:
    """Read an SVG file by `lumbar.publishing.figures.style.save`, and shorten it by `shorten_svg`."""
    text = path.read_text(encoding="utf-8")
    described, size = _DESCRIPTION.search(text), _SIZE.search(text)
    shows, _, source_label = (unescape(described[1]) if described else "").rpartition("Data: ")
    width, height = (round(float(number)) for number in size.groups()) if size else (520, 300)
    who = shows.removeprefix(SUBJECT_PREFIX).rstrip(". ")
    return Picture(svg_address(shorten_svg(text)), width, height, source_label, who)


def shorten_svg(svg: str) -> str:
    """Shorten an SVG file by Matplotlib to a third: texts without formulas become texts again, lengths get a decimal.

    The texts need a font as wide as Arial, which most systems have. Metadata, comments, names of groups and indentation are
    removed, and glyphs that no text uses any more.
    """
    glyphs = {glyph[1]: glyph[0] for glyph in _GLYPH.finditer(svg)}

    def write_text(outlined: re.Match) -> str:
        bold = ' font-weight="bold"' if "-Bold-" in outlined["outlines"] else ""
        look = f'font-size="{100 * float(outlined["scale"]):g}"{bold} style="{outlined["style"] or ""}"'
        return f'<text transform="{outlined["place"]}" {look}>{outlined["text"]}</text>'

    def shorten(number: re.Match) -> str:
        return f"{float(number[0]):.1f}".rstrip("0").rstrip(".")

    drawn = _TEXT.sub(write_text, _GLYPH.sub("", svg[svg.index("<svg") :]))
    drawn = _UNUSED.sub("", drawn)
    used = "".join(glyph for name, glyph in glyphs.items() if f'"#{name}"' in drawn)
    head, end, rest = _LENGTHS.sub(lambda lengths: _NUMBER.sub(shorten, lengths[0]), drawn).partition(">")
    return re.sub(r"\s+", " ", f"{head}{end}{_FONT}<defs>{used}</defs>{rest}").replace("> <", "><")


_OUTLINE = ("figure_1_1", "figure_3_1")
"""Artefacts without data that show how the thesis is organised, under a heading of their own."""
CHAPTERS: dict[str, tuple[str, str]] = {
    "outline": ("Outline of the thesis", "Chapters 1 and 3"),
    "surgeon": ("Surgeon motion", "Chapter 3, Sections 3.2.3.1 and 3.2.4.1"),
    "signals": ("Signal design", "Chapter 3, Section 3.2.3.1"),
    "tissue": ("System identification", "Chapters 2 and 3, Sections 2.2.3 and 3.2.4.1"),
    "improvement": ("Improvement of the models", "Beyond the thesis"),
    "runtime": ("Haptic runtime", "Chapter 3, Section 3.2.3.2"),
    "survey": ("Survey", "Chapter 3, Section 3.2.4.2"),
    "lifting": ("Lifting", "Chapter 4, Section 4.2.3.1"),
    "stability": ("Basins of attraction", "Chapter 4, Sections 4.2.3 to 4.2.5"),
    "population": ("People compared", "Beyond the thesis"),
    "claims": ("Claims", "All chapters"),
}
"""Title of each chapter of a study and its sections in the thesis, in the report's order."""
_MAIN = re.compile(r"<main>(.*)</main>", flags=re.S)
_DATA = re.compile(r'<p class="data">Data: (.*?)</p>')
MAX_ENTRIES = 24
"""Largest number of lifts or record sets that are shown; for all others only the files are linked."""


@dataclass(frozen=True)
class Entry:
    """One table, picture or page of the report."""

    key: str
    """Anchor in the page, as in ``#key``."""
    artefact: Artefact
    title: str
    caption: str
    record_set: str = ""
    """Record set of the entry; may be empty."""
    source_label: str = ""
    """Origin of the data."""
    shows: str = ""
    """Subject and box, if it shows one lift."""
    picture: Picture | None = None
    table: str = ""
    """HTML of a published table; empty for other entries."""
    page: str = ""
    """Path of an interactive page below the study's results; may be empty."""
    sketch: str = ""
    """Small picture of an interactive page, as HTML."""
    repeated: bool = False
    """True for all entries of an artefact but the first."""
    sentence: str = ""
    """Result in one sentence; may be empty."""
    files: tuple[str, ...] = ()
    """Paths below the study's results."""
    claims: tuple = ()
    """Claims of the thesis about the entry, as rows of ``claims.csv``."""
    cells: "CellComparison | None" = None
    """Comparison of the thesis's table with this run's table."""
    missing: bool = False
    """True if the entry was not made."""


@dataclass(frozen=True)
class Chapter:
    """A chapter of the report."""

    name: str
    title: str
    place: str
    entries: tuple[Entry, ...]
    files: tuple[tuple[Artefact, tuple[str, ...]], ...] = ()
    """Artefacts that are only linked, with their files: files without a view, and entries beyond `MAX_ENTRIES`."""


def chapters(
    results: Path,
    captions: Path,
    sheet: Sequence[Artefact],
    choices: dict[str, dict[str, str]],
    claims: pd.DataFrame | None,
) -> list[Chapter]:
    """Return the chapters of a study's report.

    `results` is ``results/<study>``; `captions` a folder with a caption ``<id>.rst`` for every artefact that has a label;
    `sheet` has the artefacts of the study's chapters, in order; `choices` are the values of ``{lift}``, ``{record_set}``
    and ``{model}``, each with its title; `claims` is ``claims.csv``.
    """
    contents = []
    # The record set with the clearest diagnosis comes first.
    clearest, sets = find_clearest_diagnosis(results), choices.get("record_set", {})
    sets_in_order = sorted(sets, key=lambda name: clearest is None or name != clearest[0])
    choices = choices | {"record_set": {name: sets[name] for name in sets_in_order}}
    claim_rows = [] if claims is None else list(claims.itertuples())
    for name, rows in itertools.groupby(
        sheet, key=lambda row: "outline" if row.id in _OUTLINE else row.chapter
    ):
        entries, files = [], []
        for artefact in rows:
            paths = set(_paths(artefact, choices))
            if artefact.label:
                text = (captions / f"{artefact.id}.rst").read_text(encoding="utf-8")
                caption = " ".join(text.split()).replace("``", "").replace("*", "")
                names = [name for name in choices if f"{{{name}}}" in artefact.label]
                every = itertools.product(*(choices[name] for name in names))
                for number, values in enumerate(itertools.islice(every, MAX_ENTRIES)):
                    choice = dict(zip(names, values, strict=True))
                    entry = _entry(results, artefact, choice, caption, choices, claim_rows)
                    entries.append(replace(entry, repeated=number > 0))
                    paths -= set(entries[-1].files)
            if paths:
                files.append((artefact, tuple(path for path in _paths(artefact, choices) if path in paths)))
        # Entries of one record set follow one another.
        entries.sort(key=lambda entry: sets_in_order.index(entry.record_set) if entry.record_set else 0)
        contents.append(Chapter(name, *CHAPTERS[name], tuple(entries), tuple(files)))
    return contents


def _paths(artefact: Artefact, choices: dict[str, dict[str, str]]) -> list[str]:
    whole = artefact.expanded(**{name: values for name, values in choices.items() if name != "lift"})
    return whole.paths(choices.get("lift", ()))


def _entry(
    results: Path,
    artefact: Artefact,
    choice: dict[str, str],
    caption: str,
    choices: dict[str, dict[str, str]],
    claim_rows: list,
) -> Entry:
    single = artefact.expanded(**{name: [value] for name, value in choice.items()})
    files = tuple(_paths(single, choices))
    title = artefact.label
    for name, value in choice.items():
        title = title.replace(f"{{{name}}}", choices[name][value])
    key, record_set = "-".join([artefact.id, *choice.values()]), choice.get("record_set", "")
    if not all((results / path).is_file() for path in files):
        return Entry(key, artefact, title, caption, record_set, files=files, missing=True)
    # The first file of each kind.
    svg, html, verdict = (
        next((path for path in files if path.endswith(ending)), "")
        for ending in (".svg", ".html", "diagnosis.json")
    )
    picture, sketch = _read_picture(results / svg) if svg else None, ""
    if verdict:
        diagnosis = read_json(results / verdict)
        sketch = ladder_sketch(diagnosis)
    body = results / "lifting" / choice.get("lift", "") / "body.csv"
    if html and body.is_file():
        sketch = lift_sketch(pd.read_csv(body))
    is_table = bool(html) and any(path.endswith(".tex") for path in files)
    text = (results / html).read_text(encoding="utf-8") if is_table else ""
    inner, stated = _MAIN.search(text), _DATA.search(text)
    claims = []
    for row in claim_rows:
        # Sentences are shown with their evidence; cells of tables are compared in the table.
        evidence = row.evidence.split()[0]
        if not row.claim.startswith("table_") and CLAIM_ARTEFACTS.get(evidence, evidence) == artefact.id:
            claims.append(row)
    return Entry(
        key=key,
        artefact=artefact,
        title=title,
        caption=caption,
        record_set=record_set,
        source_label=picture.source_label if picture else unescape(stated[1]) if stated else "",
        shows=picture.shows if picture else "",
        picture=picture,
        table=inner[1] if inner else "",
        page="" if is_table else html,
        sketch=sketch,
        sentence=diagnosis["headline"] if verdict else "",
        files=files,
        claims=tuple(claims),
        cells=compare_cells(claim_rows, artefact.id),
    )


CLAIM_ARTEFACTS = {
    "bandwidth": "surgeon_psd",
    "multisine": "signal_properties",
    "models": "figure_3_5",
    "survey": "table_3_2",
    "boa": "basin_areas",
}
"""Artefact of a claim by the claim's evidence; for other evidence, the table with the name of the evidence."""
CELLS = {"table_3_1": 2, "table_3_2": 1}
"""Number of parts of a claim's name that select the row, by table, e.g. 2 in ``table_3_1.<record>.<model>.<column>``. Table 4.1
has columns for the published values."""


@dataclass(frozen=True)
class CellComparison:
    """Cells of a published table with this run's cells."""

    head: tuple[str, ...]
    rows: tuple[tuple, ...]
    """Rows: names of the row, then ``(this run, thesis, verdict)`` per column."""
    names: int
    """Number of names of a row."""

    @property
    def fractions(self) -> list[int]:
        """Largest number of characters from the decimal sign to the end, by column of values."""
        columns = zip(*(row[self.names :] for row in self.rows), strict=True)
        return [max(len(split_number(text)[1]) for cell in cells for text in cell[:2]) for cells in columns]


def compare_cells(claim_rows: list, table: str) -> CellComparison | None:
    """Return the published cells of a table with this run's cells; None for tables without such cells."""
    rows = [row for row in claim_rows if row.claim.startswith(f"{table}.")] if table in CELLS else []
    if not rows:
        return None
    names = CELLS[table]
    cells: dict[tuple[str, ...], dict[str, tuple[str, str, str]]] = {}
    for row in rows:
        *key, column = row.claim.removeprefix(f"{table}.").split(".")
        values = format_value(row.this_run), format_value(row.thesis_value)
        cells.setdefault(tuple(key), {})[column] = (*values, row.verdict)
    columns = list(dict.fromkeys(column for found in cells.values() for column in found))
    empty = ("–", "–", "")
    return CellComparison(
        head=(*("Trained on", "Model")[-names:], *map(column_in_words, columns)),
        rows=tuple((*key, *(found.get(column, empty) for column in columns)) for key, found in cells.items()),
        names=names,
    )


def format_value(value) -> str:
    """Return a value of ``claims.csv``: numbers with four digits, texts unchanged, missing values as a dash."""
    if value is None or value != value:
        return "–"
    try:
        return scientific(f"{float(value):.4g}")
    except ValueError:
        return str(value)
