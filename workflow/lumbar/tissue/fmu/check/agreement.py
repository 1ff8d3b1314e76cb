"""All that an FMU says, held together: what it says is written anew from its record and compared, file by file."""

import json
import math
import re
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from difflib import SequenceMatcher
from html import unescape
from itertools import zip_longest
from json import JSONDecodeError
from pathlib import PurePosixPath

from lumbar import __version__
from lumbar.base.errors import InputError, user_message
from lumbar.base.files import parsed_json
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.build.package import checksum, written_files
from lumbar.tissue.fmu.build.record import read_record, record_text
from lumbar.tissue.fmu.build.sources import NUMBERS, content_token
from lumbar.tissue.fmu.check.lint import BROKEN_XML, told
from lumbar.tissue.fmu.conventions import RECORD
from lumbar.tissue.models.model_entry import Catalogues

Difference = tuple[str, str | None, str | None]
"""Place in the file, what stands there, what should; None is nothing."""
ROUNDING = 1e-9
"""Of computed numbers, relative to the largest beside them: another machine rounds the last digits otherwise."""


def differences(name: str, found: bytes, expected: bytes) -> Iterator[Difference]:
    """Yield all places in which a file differs from the expected one.

    Raises
    ------
    ValueError, LookupError, xml.etree.ElementTree.ParseError, RecursionError
        The file cannot be read.
    """
    kind = PurePosixPath(name).suffix
    if found == expected:
        return
    if kind in _KEYED:
        yield from _of_keys(_KEYED[kind](found), _KEYED[kind](expected))
    elif kind == ".csv":
        yield from _of_signals(found, expected)
    elif kind == ".png":
        yield "", f"another picture ({len(found)} bytes)", f"one of {len(expected)} bytes"
    else:
        yield from _of_lines(found.decode(), expected.decode())


Elements = dict[tuple[str, ...], dict[str, str]]
"""What stands in each place of a document, by the labels from its root on."""
_LABELS = ("name", "variableName", "valueReference", "index", "source", "type")
"""Attributes that tell an element from those beside it."""
_NAMESPACE = re.compile(r"\{.*\}")


def _elements(content: bytes) -> Elements:
    """Attributes and text of every element of an XML document."""
    found: Elements = {}
    seen: Counter = Counter()

    def visit(element: ElementTree.Element, place: tuple[str, ...]) -> None:
        text = filter(None, map(str.strip, [element.text or "", *(child.tail or "" for child in element)]))
        found[place] = {_NAMESPACE.sub("", key): value for key, value in element.attrib.items()}
        found[place].update({"text": words} if (words := " ".join(text)) else {})
        for child in element:
            name = next(filter(None, map(child.get, _LABELS)), "")
            inner = (*place, f"{child.tag} {name}".strip())
            seen[inner] += 1
            visit(child, inner if seen[inner] == 1 else (*place, f"{inner[-1]} ({seen[inner]})"))

    root = ElementTree.fromstring(content)
    visit(root, ())
    return {**found, (): {"root": root.tag, **found[()]}}


def _keys(content: bytes) -> Elements:
    """Values of a JSON document."""

    def unique(pairs: list[tuple[str, object]]) -> dict:
        if len(dict(pairs)) < len(pairs):
            raise ValueError(f"a key stands twice among {', '.join(key for key, _ in pairs)}")
        return dict(pairs)

    found: Elements = {}

    def visit(value, place: tuple[str, ...]) -> None:
        inner = (
            value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        )
        number = isinstance(value, int | float) and not isinstance(value, bool)
        found[place] = {} if inner else {"value": repr(float(value) if number else value)}
        for key, item in inner:
            visit(item, (*place, str(key)))

    visit(json.loads(content, object_pairs_hook=unique), ())
    return found


_KEYED: dict[str, Callable[[bytes], Elements]] = {".xml": _elements, ".exp": _elements, ".json": _keys}


def _of_keys(found: Elements, expected: Elements) -> Iterator[Difference]:
    for place in dict.fromkeys([*found, *expected]):
        words = ", ".join(place)
        if place not in found or place not in expected:
            if place[:-1] in found and place[:-1] in expected:  # else the element above is told
                yield words, *("there" if place in document else None for document in (found, expected))
            continue
        ours, theirs = found[place], expected[place]
        for key in dict.fromkeys([*ours, *theirs]):
            if not _alike(ours.get(key), theirs.get(key)):
                at = f"{words}: {key}" if words and key != "value" else words or key
                yield at, *_excerpts(ours.get(key), theirs.get(key))
    if found.keys() == expected.keys() and [*found] != [*expected]:
        late = next(place for place, other in zip(found, expected, strict=True) if place != other)
        yield ", ".join(late), "out of its order", "in the order of the variables"


def _alike(found: str | None, expected: str | None) -> bool:
    """Whether two values are the same, numbers as numbers."""
    if found is None or expected is None or found == expected:
        return found == expected
    try:
        return float(found) == float(expected)
    except ValueError:
        return False


def _of_signals(found: bytes, expected: bytes) -> Iterator[Difference]:
    (head, *rows), (head_needed, *needed) = (
        content.decode().splitlines() or [""] for content in (found, expected)
    )
    if head != head_needed:
        yield "line 1", *_excerpts(head, head_needed)
    if len(rows) != len(needed):
        yield "its length", f"{len(rows)} rows", f"{len(needed)}"
        return
    cells, expected_cells = (
        [[float(cell) for cell in row.replace(" ", ",").split(",")] for row in part]
        for part in (rows, needed)
    )
    width = len(expected_cells[0])
    if {len(row) for row in cells} != {width}:
        raise ValueError(f"not all rows are {'two' if width == 2 else width} numbers")
    names = head_needed.split(",")
    for column, name in enumerate([*names, *names[-1:] * (width - len(names))]):
        ours, theirs = ([row[column] for row in part] for part in (cells, expected_cells))
        largest = max(map(abs, theirs)) or 1.0
        worst = max(
            range(len(theirs)), key=lambda k: abs(ours[k] - theirs[k]) if math.isfinite(ours[k]) else math.inf
        )
        if not abs(ours[worst] - theirs[worst]) <= ROUNDING * largest:
            yield f"line {worst + 2}: {name}", repr(ours[worst]), repr(theirs[worst])


_MARKUP = re.compile(r"<[^>]*>")
_HEXADECIMAL = re.compile(r"-?0x[0-9a-f.]+p[+-]?\d+")


def _of_lines(found: str, expected: str) -> Iterator[Difference]:
    lines, needed = found.splitlines(), expected.splitlines()
    for tag, first, last, begin, end in SequenceMatcher(None, lines, needed, autojunk=False).get_opcodes():
        changed = zip_longest(lines[first:last], needed[begin:end]) if tag != "equal" else ()
        for number, (ours, theirs) in enumerate(changed, start=first + 1):
            if ours is None or theirs is None or not _close(ours, theirs):
                yield f"line {number}", *_excerpts(ours, theirs)


def _close(found: str, expected: str) -> bool:
    """Whether lines differ in nothing but the last digits of exact numbers."""
    if _HEXADECIMAL.sub("#", found) != _HEXADECIMAL.sub("#", expected):
        return False
    ours, theirs = (list(map(float.fromhex, _HEXADECIMAL.findall(line))) for line in (found, expected))
    allowed = ROUNDING * max(map(abs, theirs), default=0.0)
    return all(abs(given - needed) <= allowed for given, needed in zip(ours, theirs, strict=True))


_LONGEST = 70
_BESIDE = 20
"""Letters of an excerpt, and of what is shown on both sides of what differs."""


def _excerpts(found: str | None, expected: str | None) -> tuple[str | None, str | None]:
    """Both in quotation marks as they are read, of long ones what differs with some words around it."""
    ours, theirs = (None if text is None else _plain(text) for text in (found, expected))
    if ours is None or theirs is None:
        ours, theirs = (None if text is None else repr(_cut(text, 0, 0)) for text in (ours, theirs))
        return ours, theirs
    if ours == theirs:  # the markup differs
        ours, theirs = str(found), str(expected)
    shorter = min(len(ours), len(theirs))
    same = next((k for k, (a, b) in enumerate(zip(ours, theirs, strict=False)) if a != b), shorter)
    room = shorter - same
    behind = next((k for k in range(room) if ours[-1 - k] != theirs[-1 - k]), room)
    return repr(_cut(ours, same, behind)), repr(_cut(theirs, same, behind))


def _plain(text: str) -> str:
    """A line without its markup, with decimal numbers."""
    words = unescape(_MARKUP.sub(" ", text)).strip() or text
    return _HEXADECIMAL.sub(lambda number: repr(float.fromhex(number[0])), words)


def _cut(text: str, same: int, behind: int) -> str:
    """A text without all that is far from what differs: that begins behind `same` letters and ends before `behind`."""
    if len(text) <= _LONGEST:
        return text
    start, end = max(0, same - _BESIDE), max(same, len(text) - behind)
    end = min(end + _BESIDE, start + 2 * _LONGEST, len(text)) if behind or same else _LONGEST
    while 0 < start < same and not text[start - 1].isspace():
        start += 1
    return f"{'…' * (start > 0)}{text[start:end]}{'…' * (end < len(text))}"


PAGE = "documentation/index.html"
_PICTURE = re.compile(r"<svg\b.*?</svg>", re.DOTALL)


@dataclass(frozen=True)
class Agreement:
    """What comes of holding an FMU together."""

    problems: tuple[str, ...] = ()
    left_out: str = ""
    """What could not be compared, and why; empty where all was."""


def hold_together(files: Mapping[str, bytes], catalogues: Catalogues) -> Agreement:
    """Write an FMU anew from its record and compare every file but the libraries.

    Parameters
    ----------
    files : mapping of str to bytes
        Of the FMU, by path; with a model description that is sound in itself.
    catalogues : mapping
        Effects of every system that models may have.
    """
    root = ElementTree.fromstring(files["modelDescription.xml"])
    try:
        record = parsed_json(files[RECORD], RECORD) if RECORD in files else {}
    except InputError as error:
        return Agreement((str(error),))
    try:
        said = _writer(root, record)
        if said.problems or said.left_out:
            return said
        problems = list(_problems(files, root, *read_record(record, catalogues)))
    except (
        AttributeError,
        KeyError,
        TypeError,
        RecursionError,
        UnicodeDecodeError,
        JSONDecodeError,
    ) as error:
        return Agreement((f"{RECORD} is no record of an FMU: {error!r}",))
    except Exception as error:
        words = user_message(error)
        if words is None:
            raise
        return Agreement((f"{RECORD}: {words}",))
    return Agreement(told(problems, f"differences from {RECORD}"))


def _writer(root: ElementTree.Element, record: dict) -> Agreement:
    """Whether the FMU says in one way what wrote it, and whether this version can write it anew."""
    tool, ours = root.get("generationTool", ""), f"lumbar {__version__}"
    named = {"version": f"lumbar {root.get('version', '').partition('+')[0]}"}
    named |= {RECORD: record["written_by"]} if record else {}
    for place, said in named.items():
        if said != tool:
            return Agreement(
                (f"modelDescription.xml, generationTool is {tool!r}; by {place} it is {said!r}",)
            )
    if tool != ours:
        return Agreement(left_out=f"what it says was not compared: {tool} wrote it, this is {ours}")
    if not record:
        return Agreement(
            (f"there is no {RECORD}, from which all else in the file follows; export the model again",)
        )
    return Agreement()


def _problems(
    files: Mapping[str, bytes], root: ElementTree.Element, model: ExportModel, data: str, pictures: list[str]
) -> Iterator[str]:
    version, token = root.get("fmiVersion", ""), root.get("guid") or root.get("instantiationToken") or ""
    found = {name: content for name, content in files.items() if not name.startswith("binaries/")}
    drawn = tuple(_PICTURE.findall(found.get(PAGE, b"").decode("utf-8", errors="replace")))
    needed = written_files(model, version, data, drawn)
    signals = {
        name: found[name].decode()
        for name in needed
        if name.endswith(".csv") and _rounded(found, needed, name)
    }
    if signals:  # the manifest holds the checksums of what that machine wrote
        needed = written_files(model, version, data, drawn, signals)
    needed = {**needed, RECORD: record_text(model, data, pictures).encode("utf-8")}
    needed = _under(token, content_token(model), needed)
    problems = [
        *(
            sentence
            for name in dict.fromkeys([*needed, *found])
            for sentence in _sentences(name, found.get(name), needed.get(name))
        ),
        *_altered_pictures(drawn, pictures),
    ]
    yield from problems
    sources = {
        name.removeprefix("sources/"): found[name].decode() for name in found if name.endswith((".c", ".h"))
    }
    if not problems:
        own = content_token(model, {**sources, NUMBERS: sources[NUMBERS].replace(token, "")})
        if own != token:
            yield f"modelDescription.xml: the token is {token}; that of the model and these sources is {own}"


def _rounded(found: Mapping[str, bytes], needed: Mapping[str, bytes], name: str) -> bool:
    """Whether another machine has rounded the last digits of a file otherwise."""
    return found.get(name, needed[name]) != needed[name] and not _sentences(name, found[name], needed[name])


def _under(token: str, own: str, files: dict[str, bytes]) -> dict[str, bytes]:
    """Files with the token of the FMU in place of their own, which stands for the last digits of all numbers."""
    for before, after in ((own, token), (f"+{own[:8]}", f"+{token[:8]}")) if own != token else ():
        files = {name: content.replace(before.encode(), after.encode()) for name, content in files.items()}
    return files


def _altered_pictures(drawn: tuple[str, ...], told: list[str]) -> Iterator[str]:
    """Pictures are not drawn anew, which takes longer than all else here: the record has their checksums."""
    for number, (picture, known) in enumerate(zip(drawn, told, strict=False), start=1):
        if checksum(picture) != known:
            yield f"{PAGE}: picture {number} is not the one that was drawn; {RECORD} has its checksum"
    if len(drawn) != len(told):
        yield f"{PAGE} has {len(drawn)} pictures; by {RECORD} it has {len(told)}"


def _sentences(name: str, found: bytes | None, expected: bytes | None) -> list[str]:
    """What is wrong with one file."""
    if found is None:
        return [f"there is no {name}"]
    if expected is None:
        return [] if name.endswith("/") else [f"{name} is no part of this FMU"]
    try:
        return [_sentence(name, item) for item in differences(name, found, expected)]
    except (*BROKEN_XML, RecursionError) as error:
        return [f"{name} cannot be read: {error}"]


def _sentence(name: str, difference: Difference) -> str:
    place, found, expected = difference
    at = f"{name}, {place}" if place else name
    return f"{at} is {found or 'missing'}; by {RECORD} it is {expected or 'not there'}"
