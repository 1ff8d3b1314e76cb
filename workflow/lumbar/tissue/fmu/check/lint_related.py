"""Checks of an FMU's manifest after FMI-LS-REF: what it says of stimulus, results and experiment, and that they are unchanged."""

from __future__ import annotations

import hashlib
import posixpath
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from urllib.parse import unquote, urlsplit
from xml.etree.ElementTree import Element

from lumbar.tissue.fmu.conventions import (
    EXPERIMENTS,
    LAYERED_STANDARD,
    MANIFEST,
    REFERENCE,
    ROLES,
    WITHOUT_EVENT_MODE,
)

_NAMESPACE = "{http://fmi-standard.org/fmi-ls-manifest}"
_ROLE = re.compile(
    "document|requirement|specification|model|parameter|system|testcase|experiment(/(smoke-test|validation|uncertainty-analysis))?"
    "|result|method|rationale|report|request|delivery|configuration|signature|serialized-state(/.*)?|meta-data|other"
)
_DIGESTS = {
    f"{family}-{size}": f"{prefix}{size}"
    for family, prefix in (("SHA3", "sha3_"), ("SHA", "sha"))
    for size in (224, 256, 384, 512)
}
"""Names of digests in the standard and in Python."""


def lint_related(files: Mapping[str, bytes], step: float | None) -> list[str]:
    """Return problems of the manifest and the experiments that it names; an FMU without a manifest has none.

    Parameters
    ----------
    step : float, optional
        Of the description, in seconds.
    """
    if MANIFEST not in files:
        return []
    problems: list[str] = []
    root = _root(files, MANIFEST, "fmiReferences", problems)
    if root is None:
        return problems
    for key, needed in (
        ("name", re.escape(LAYERED_STANDARD)),
        ("version", r"1\.0\.0(-.+)?"),
        ("description", ".+"),
    ):
        found = root.get(f"{_NAMESPACE}fmi-ls-{key}", "")
        if not re.fullmatch(needed, found):
            problems.append(f"{MANIFEST}: fmi-ls-{key} is {found!r}, which is not that of FMI-LS-REF 1.0.0")
    told: dict[str, Element] = {}
    for item in root.iterfind("Related"):
        path = _path(item, MANIFEST)
        if path is not None:
            problems += [f"{MANIFEST}: {text}" for text in _lint_file(files, path, item)]
            problems += [f"{MANIFEST}: {path} stands twice"] if path in told else []
            told[path] = item
    for path, (label, role, _) in ROLES.items():
        if path in files and path not in told:
            problems.append(f"{MANIFEST} does not name {path}, the {label}")
        elif path in told and (found := told[path].get("role")) != role:
            problems.append(f"{MANIFEST}: {path} has the role {found!r}; as the {label} it has {role!r}")
        elif path in told and label not in [item.get("name") for item in told[path].iterfind("Label")]:
            problems.append(f"{MANIFEST}: {path} is not labelled {label!r}")
    return problems + (_lint_experiments(files, step) if EXPERIMENTS in files else [])


def _root(files: Mapping[str, bytes], path: str, tag: str, problems: list[str]) -> Element | None:
    try:
        root = ElementTree.fromstring(files[path])
    except ElementTree.ParseError as error:
        problems.append(f"{path} is no XML: {error}")
        return None
    if root.tag != tag:
        problems.append(f"{path}: its root is {root.tag}; {tag} is needed")
        return None
    return root


def _path(item: Element, document: str) -> str | None:
    """Path in the archive of what an element of a document names; None of an address outside."""
    address = urlsplit(item.get("source", ""))
    if address.scheme or address.netloc:
        return None
    return posixpath.normpath(posixpath.join(posixpath.dirname(document), unquote(address.path)))


def _lint_file(files: Mapping[str, bytes], path: str, item: Element) -> Iterator[str]:
    """Problems of one file that the manifest names."""
    role, kind = item.get("role", ""), item.get("checksumType", "SHA3-256")
    if not _ROLE.fullmatch(role):
        yield f"{path} has the role {role!r}, which FMI-LS-REF does not know"
    if path not in files:
        yield f"{path} is named and is not there"
    elif kind not in _DIGESTS:
        yield f"{path} has a checksum of type {kind!r}; allowed are {', '.join(_DIGESTS)}"
    elif "checksum" in item.attrib:
        found = hashlib.new(_DIGESTS[kind], files[path]).hexdigest()
        if item.get("checksum", "").lower() != found:
            yield f"{path} was changed: its {kind} is {found}, the manifest has {item.get('checksum')}"


def _lint_experiments(files: Mapping[str, bytes], step: float | None) -> list[str]:
    """Problems of the experiments: files that are not the reference's, times that are not theirs."""
    problems: list[str] = []
    root = _root(files, EXPERIMENTS, "Experiments", problems)
    if root is None:
        return problems
    times = [row.split(b",")[0] for row in files.get(REFERENCE[0], b"").splitlines()[1:]]
    expected = {"startTime": times[0], "stopTime": times[-1], "stepSize": step} if times else {}
    results = []
    for experiment in root.iterfind("Experiment"):
        place = f"{EXPERIMENTS}, {experiment.get('name')!r}"
        run = experiment.find("TransientSimulation")
        given = run.attrib if run is not None else {}
        for key, value in expected.items():
            if value is not None and not _same(given.get(key), value):
                problems.append(
                    f"{place}: {key} is {given.get(key)}; that of the reference is {float(value):g}"
                )
        for tag, allowed in (("Stimuli", REFERENCE[:1]), ("References", (REFERENCE[1], WITHOUT_EVENT_MODE))):
            element = experiment.find(tag)
            path = None if element is None else _path(element, EXPERIMENTS)
            if path not in allowed:
                problems.append(f"{place}: {tag} are {path}; {' or '.join(allowed)} is needed")
            results += [path] if tag == "References" else []
    missing = [path for path in (REFERENCE[1], WITHOUT_EVENT_MODE) if path in files and path not in results]
    return problems + [f"{EXPERIMENTS} has no experiment with {path}" for path in missing]


def _same(text: str | None, value: bytes | float) -> bool:
    try:
        return text is not None and float(text) == float(value)
    except ValueError:
        return False
