"""All that an FMU says, held together: what it says is written anew from its record and compared, file by file."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from json import JSONDecodeError

from lumbar import __version__
from lumbar.base.errors import InputError, user_message
from lumbar.base.files import parsed_json
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.build.package import checksum, written_files
from lumbar.tissue.fmu.build.record import read_record, record_text
from lumbar.tissue.fmu.build.sources import NUMBERS, content_token
from lumbar.tissue.fmu.check.differences import Difference, differences
from lumbar.tissue.fmu.conventions import RECORD
from lumbar.tissue.models.model_entry import Catalogues

PAGE = "documentation/index.html"
_PICTURE = re.compile(r"<svg\b.*?</svg>", re.DOTALL)
_MOST = 12
"""Differences that are told of an FMU: a record of another model alters everything."""


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
    more = len(problems) - _MOST
    return Agreement((*problems[:_MOST], *([f"{more} more differences from {RECORD}"] if more > 0 else [])))


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
    except (ValueError, ElementTree.ParseError, RecursionError) as error:
        return [f"{name} cannot be read: {error}"]


def _sentence(name: str, difference: Difference) -> str:
    place, found, expected = difference
    at = f"{name}, {place}" if place else name
    return f"{at} is {found or 'missing'}; by {RECORD} it is {expected or 'not there'}"
