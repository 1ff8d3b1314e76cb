"""What the report of a study holds: its artefacts in the thesis's order, with words, files, and the thesis's values."""

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import unescape
from pathlib import Path

import pandas as pd

from lumbar.base.files import read_json
from lumbar.base.yaml_file import shipped_yaml
from lumbar.publishing.figures.style import SHOWS
from lumbar.study.artefacts import Artefact
from lumbar.tables.layout import column_in_words, scientific, split_number, unit_in_print
from lumbar.tables.table import svg_address

_NUMBER = re.compile(r"-?\d+\.\d{3,}")
_DRAWN = re.compile(r'(?<=\s)(?:d|points|x|y|cx|cy)="[^"]*"')
_DESCRIPTION = re.compile(r"<dc:description>(.*?)</dc:description>", flags=re.S)
_SIZE = re.compile(r'<svg\b[^>]*?\bviewBox="[\d.+-]+ [\d.+-]+ ([\d.]+) ([\d.]+)"', flags=re.S)


@dataclass(frozen=True)
class Picture:
    """A picture inside the page."""

    address: str
    """``data:`` address of the SVG file."""
    width: int
    height: int
    """`width`, `height`: in points."""
    source_label: str
    """Where the data come from; "Drawing without data" where there are none."""
    shows: str = ""
    """Person and box, where it shows one."""


def read_picture(path: Path) -> Picture:
    """Read an SVG file of `lumbar.publishing.figures.style.save`.

    Lengths are rounded to hundredths of a point, and the text's indentation is left out: a third less to send.
    """
    text = path.read_text(encoding="utf-8")
    described = _DESCRIPTION.search(text)
    words = unescape(described[1]) if described else ""
    shows, _, data = words.rpartition("Data: ")
    size = _SIZE.search(text)
    width, height = (round(float(size[number])) for number in (1, 2)) if size else (520, 300)
    who = shows.removeprefix(SHOWS).rstrip(". ")
    return Picture(svg_address(smaller(text)), width, height, data, who)


def smaller(svg: str) -> str:
    """Return an SVG text with lengths rounded and without indentation."""
    rounded = _DRAWN.sub(lambda found: _NUMBER.sub(lambda number: _rounded(number[0]), found[0]), svg)
    return re.sub(r"\s*\n\s*", "\n", rounded)


def _rounded(number: str) -> str:
    return f"{float(number):.2f}".rstrip("0").rstrip(".")


_CHAPTERS = shipped_yaml(Path(__file__).with_name("chapters.yaml"))
CHAPTERS: dict[str, str] = {name: said["title"] for name, said in _CHAPTERS.items()}
PLACES: dict[str, str] = {name: said["place"] for name, said in _CHAPTERS.items()}
"""Where in the thesis each chapter of the study stands."""
_MAIN = re.compile(r"<main>(.*)</main>", flags=re.S)
_DATA = re.compile(r'<p class="data">Data: (.*?)</p>')
MANY = 24
"""Lifts, or record sets, that are shown one by one: of more, the files of the others are linked alone."""


@dataclass(frozen=True)
class Entry:
    """One table, picture or page of the report."""

    key: str
    """Its place in the page, as in ``#key``."""
    artefact: Artefact
    title: str
    caption: str
    """What it shows."""
    source_label: str = ""
    """Where the data come from."""
    shows: str = ""
    """Person and box, where it shows one."""
    picture: Picture | None = None
    table: str = ""
    """HTML of a published table; empty for others."""
    page: str = ""
    """File of an interactive page, below the study's results; empty where there is none."""
    sentence: str = ""
    """What was found, where one sentence tells it."""
    files: tuple[str, ...] = ()
    """Below the study's results."""
    said: "tuple[Said, ...]" = ()
    """The thesis's claims about it."""
    beside: "Beside | None" = None
    """The thesis's table beside this run's."""
    missing: bool = False
    """Whether it was not made."""


@dataclass(frozen=True)
class Chapter:
    """A chapter of the report."""

    name: str
    title: str
    place: str
    entries: tuple[Entry, ...]
    files: tuple[tuple[Artefact, tuple[str, ...]], ...] = field(default_factory=tuple)
    """What is not shown: artefacts that are files alone, and those beyond `MANY`."""


def chapters(
    results: Path,
    captions: Path,
    sheet: Sequence[Artefact],
    choices: dict[str, dict[str, str]],
    claims: pd.DataFrame | None,
) -> list[Chapter]:
    """Return the chapters of a study's report.

    Parameters
    ----------
    results : pathlib.Path
        ``results/<study>``.
    captions : pathlib.Path
        Folder with a caption ``<id>.rst`` for every artefact that has a label.
    sheet : sequence of Artefact
        Of the study's chapters, in order.
    choices : dict of str to dict of str to str
        What ``{lift}``, ``{record_set}`` and ``{model}`` stand for, each with its words.
    claims : pandas.DataFrame or None
        ``claims.csv``.
    """
    made = []
    for name, rows in itertools.groupby(sheet, key=lambda row: row.chapter):
        entries, files = [], []
        for artefact in rows:
            every = _choices(artefact, choices) if artefact.label else []
            caption = _caption(captions, artefact) if every else ""
            entries += [
                _entry(results, artefact, choice, caption, choices, claims) for choice in every[:MANY]
            ]
            paths = _paths(artefact, choices)
            told = {path for entry in entries for path in entry.files}
            if not told.issuperset(paths):
                files.append((artefact, tuple(path for path in paths if path not in told)))
        # All of one record set stands together.
        sets = list(choices.get("record_set", ()))
        entries.sort(key=lambda entry: _set_of(entry, sets))
        made.append(Chapter(name, CHAPTERS[name], PLACES[name], tuple(entries), tuple(files)))
    return made


def _caption(captions: Path, artefact: Artefact) -> str:
    """Caption of an artefact without the marks of reStructuredText."""
    text = " ".join((captions / f"{artefact.id}.rst").read_text(encoding="utf-8").split())
    return text.replace("``", "").replace("*", "")


def _set_of(entry: Entry, sets: list[str]) -> int:
    found = [number for number, name in enumerate(sets) if entry.key.endswith(f"-{name}")]
    return found[0] if "{record_set}" in entry.artefact.path and found else 0


def _choices(artefact: Artefact, choices: dict[str, dict[str, str]]) -> list[dict[str, str]]:
    """Return what the names in braces of an artefact's label stand for, one after the other."""
    names = [name for name in choices if f"{{{name}}}" in artefact.label]
    return [
        dict(zip(names, values, strict=True))
        for values in itertools.product(*(choices[name] for name in names))
    ]


def _paths(artefact: Artefact, choices: dict[str, dict[str, str]]) -> list[str]:
    whole = artefact.expanded(**{name: values for name, values in choices.items() if name != "lift"})
    return whole.paths(choices.get("lift", ()))


def _entry(
    results: Path,
    artefact: Artefact,
    choice: dict[str, str],
    caption: str,
    choices: dict[str, dict[str, str]],
    claims: pd.DataFrame | None,
) -> Entry:
    single = artefact.expanded(**{name: [value] for name, value in choice.items()})
    files = tuple(_paths(single, choices))
    title = artefact.label
    for name, value in choice.items():
        title = title.replace(f"{{{name}}}", choices[name][value])
    key = "-".join([artefact.id, *choice.values()])
    if not all((results / path).is_file() for path in files):
        return Entry(key, artefact, title, caption, files=files, missing=True)
    pictures = [path for path in files if path.endswith(".svg")]
    pages = [path for path in files if path.endswith(".html")]
    verdicts = [path for path in files if path.endswith("diagnosis.json")]
    picture = read_picture(results / pictures[0]) if pictures else None
    is_table = bool(pages) and any(path.endswith(".tex") for path in files)
    text = (results / pages[0]).read_text(encoding="utf-8") if is_table else ""
    inner, told = _MAIN.search(text), _DATA.search(text)
    return Entry(
        key=key,
        artefact=artefact,
        title=title,
        caption=caption,
        source_label=picture.source_label if picture else unescape(told[1]) if told else "",
        shows=picture.shows if picture else "",
        picture=picture,
        table=inner[1] if inner else "",
        page="" if is_table or not pages else pages[0],
        sentence=diagnosis_sentence(read_json(results / verdicts[0])) if verdicts else "",
        files=files,
        said=() if claims is None else tuple(claims_shown_with(claims, artefact.id)),
        beside=None if claims is None else beside(claims, artefact.id),
    )


_SAID: dict[str, dict[str, str]] = shipped_yaml(Path(__file__).with_suffix(".yaml"))


def diagnosis_sentence(diagnosis: dict) -> str:
    """Say what a diagnosis found, from the content of its ``diagnosis.json``; one of several axes says it itself."""
    if "headline" in diagnosis:
        return diagnosis["headline"]
    base, effects = diagnosis["base"], " and ".join(name.replace("_", " ") for name in diagnosis["selected"])
    found = _SAID["verdicts"][diagnosis["verdict"]].format(base=base, effects=effects or "no effect")
    first, last = (diagnosis["ladder"][place].get("test_rms") for place in (0, -1))
    if first is None or last is None:
        return found
    unit, floor = unit_in_print(diagnosis["unit"]), diagnosis["noise_floor_rms"]
    with_them = f" {unit} without and {last:.3g} {unit} with the effects" if effects else f" {unit}"
    noise = "" if floor is None else f"; noise floor {floor:.3g} {unit}"
    return f"{found} Error on unseen records (RMS): {first:.3g}{with_them}{noise}."


SHOWN_WITH = _SAID["shown_with"]
"""Artefact with which a claim is shown, by the evidence that it is judged on; others stand with the table of that name."""
CELLS = {"table_3_1": 2, "table_3_2": 1}
"""How many parts of a claim's name tell the row, by table: ``table_3_1.<record>.<model>.<column>``. Table 4.1 has the
published values among its own columns."""


@dataclass(frozen=True)
class Said:
    """One claim of the thesis."""

    statement: str
    thesis: str
    run: str
    verdict: str
    criterion: str
    """`statement`, `thesis`, `run`, `verdict`, `criterion`: as in ``claims.csv``, values with four digits."""
    location: str
    """Section or table of the thesis."""


@dataclass(frozen=True)
class Beside:
    """Cells of a published table."""

    head: tuple[str, ...]
    rows: tuple[tuple, ...]
    """Names of the row, then per column ``(this run, thesis, verdict)``."""
    names: int
    """How many names a row has."""

    @property
    def fractions(self) -> list[int]:
        """Characters from the decimal sign on, by column of values."""
        columns = zip(*(row[self.names :] for row in self.rows), strict=True)
        return [max(len(split_number(text)[1]) for cell in cells for text in cell[:2]) for cells in columns]


def claims_shown_with(claims: pd.DataFrame, artefact: str) -> list[Said]:
    """Return the claims that are shown with an artefact."""
    sentences = [(row, row.evidence.split()[0]) for row in claims.itertuples() if not _is_cell(row.claim)]
    return [
        claim_sentence(row) for row, evidence in sentences if SHOWN_WITH.get(evidence, evidence) == artefact
    ]


def claim_sentence(row) -> Said:
    """Return a row of ``claims.csv`` in words."""
    values = in_digits(row.thesis_value), in_digits(row.this_run)
    return Said(row.statement, *values, row.verdict, row.criterion, row.location)


def not_holding(claims: pd.DataFrame, verdict: str) -> tuple[list[Said], list[Said]]:
    """Return the claims with a verdict: sentences, and cells of published tables."""
    rows = list(claims[claims["verdict"] == verdict].itertuples())
    return (
        [claim_sentence(row) for row in rows if not _is_cell(row.claim)],
        [claim_sentence(row) for row in rows if _is_cell(row.claim)],
    )


def beside(claims: pd.DataFrame, table: str) -> Beside | None:
    """Return the published cells of a table beside this run's; None for tables without."""
    rows = [row for row in claims.itertuples() if row.claim.startswith(f"{table}.")]
    if table not in CELLS or not rows:
        return None
    names = CELLS[table]
    cells: dict[tuple[str, ...], dict[str, tuple[str, str, str]]] = {}
    for row in rows:
        *key, column = row.claim.removeprefix(f"{table}.").split(".")
        values = in_digits(row.this_run), in_digits(row.thesis_value)
        cells.setdefault(tuple(key), {})[column] = (*values, row.verdict)
    columns = list(dict.fromkeys(column for found in cells.values() for column in found))
    empty = ("–", "–", "")
    return Beside(
        head=(*("Trained on", "Model")[-names:], *map(column_in_words, columns)),
        rows=tuple((*key, *(found.get(column, empty) for column in columns)) for key, found in cells.items()),
        names=names,
    )


def in_digits(value) -> str:
    """Return a value of ``claims.csv``: numbers with four digits, words as they are, nothing as a dash."""
    if value is None or value != value:
        return "–"
    try:
        return scientific(f"{float(value):.4g}")
    except ValueError:
        return str(value)


def _is_cell(claim: str) -> bool:
    return claim.startswith("table_")
