"""Landmarks of the body by the labels of common marker sets (marker_sets.yaml)."""

import re
import unicodedata
from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from lumbar.base.yaml_file import shipped_yaml

_DATA = shipped_yaml(Path(__file__).with_name("marker_sets.yaml"))
_SIDES = {"L": ["L"], "R": ["R"]}


@dataclass(frozen=True)
class LabelSet:
    """Labels of a marker set, without case and punctuation."""

    title: str
    choices: dict[str, list[tuple[str, ...]]]
    """Labels by landmark, the best choice first; of several labels the mean is the landmark."""
    others: frozenset[str]
    """Labels of points that are not landmarks."""
    joints: bool
    """True if the points are joint centres instead of markers on the skin."""
    source: str
    """Document with the labels; empty for the words."""

    def find(self, present: Collection[str]) -> dict[str, tuple[str, ...]]:
        """Return by landmark the best choice with all its labels among `present`."""
        complete = {
            landmark: [labels for labels in choices if all(label in present for label in labels)]
            for landmark, choices in self.choices.items()
        }
        return {landmark: choices[0] for landmark, choices in complete.items() if choices}

    @cached_property
    def labels(self) -> frozenset[str]:
        """Return all labels of the set."""
        return self.others.union(*(labels for choices in self.choices.values() for labels in choices))


def _read_set(title: str, content: dict) -> LabelSet:
    """Return a set of marker_sets.yaml, with its sides written out."""
    sides, choices = content.get("sides", _SIDES), {}
    for landmark, terms in content["landmarks"].items():
        for term in terms if isinstance(terms, list) else [terms]:
            labels = term["mean"] if isinstance(term, dict) else [term]
            forms = [labels, [f"{label[1:]}?" for label in labels]] if content.get("behind") else [labels]
            spellings = {f"{side}_{landmark}": words for side, words in sides.items()}
            for name, words in spellings.items() if "?" in labels[0] else [(landmark, [""])]:
                chosen = [[label.replace("?", word) for label in form] for form in forms for word in words]
                choices.setdefault(name, []).extend(tuple(map(_simplify, form)) for form in chosen)
    words = [word for side in sides.values() for word in side]
    others = {_simplify(label.replace("?", word)) for label in content.get("others", ()) for word in words}
    return LabelSet(
        title, choices, frozenset(others), content.get("joints", False), content.get("source", "")
    )


def _simplify(label: str) -> str:
    """Return a label without case, accents and punctuation."""
    return re.sub(r"[^A-Z0-9]", "", unicodedata.normalize("NFKD", label.upper()))


SETS = tuple(_read_set(title, content) for title, content in _DATA.items() if title != "thigh")
"""Known marker sets; the last is the vocabulary of laboratories' own labels."""


def recognise(labels: Iterable[str]) -> tuple[LabelSet, dict[str, tuple[str, ...]]]:
    """Return the set with most of the labels, and the labels of each landmark; of several labels the mean is meant.

    Prefixes of subjects and numbers (``4 - L_Wrist``, ``Anna:LASI``) do not count.

    Parameters
    ----------
    labels : iterable of str
        Labels of the file.
    """
    names = {label: re.sub(r"^\d+\s*[-_.]\s*", "", label.rpartition(":")[2]) for label in labels}
    # A word in front of most labels, as in Anna_LASI, is a prefix too, unless it is a side.
    for prefix, count in Counter(name.partition("_")[0] for name in names.values()).most_common(1):
        if 2 * count > len(names) and prefix.upper() not in ("L", "R", "LEFT", "RIGHT"):
            names = {label: name.removeprefix(f"{prefix}_") for label, name in names.items()}
    bare = {_simplify(name): label for label, name in names.items() if name not in _DATA["thigh"]}
    # L1 next to R1 is a side and a number, not a vertebra.
    numbered = {f"L{name[1:]}" for name in bare if re.fullmatch(r"R\d+", name)}
    bare = {name: label for name, label in bare.items() if name not in numbered}
    best = max(SETS, key=lambda one: len(one.labels & bare.keys()))
    found = SETS[-1].find(bare.keys() - best.labels) | best.find(bare)
    return best, {landmark: tuple(bare[name] for name in found[landmark]) for landmark in found}


def landmarks(labels: Iterable[str], meant: dict[str, str] | None = None) -> dict[str, str]:
    """Return label by landmark, for the labels with a known meaning; of a mean the first label.

    Parameters
    ----------
    labels : iterable of str
        Labels of the file.
    meant : dict of str to str, optional
        Label by landmark from a laboratory's aliases, which precede the usual meaning.

    Examples
    --------
    >>> landmarks(["CV7", "TV8", "L_IAS", "PSISr", "whatever"])
    {'C7': 'CV7', 'T8': 'TV8', 'L_ASIS': 'L_IAS', 'R_PSIS': 'PSISr'}
    >>> landmarks(["Hüfte_li", "Knie re", "C7"])
    {'C7': 'C7', 'L_HIP': 'Hüfte_li', 'R_KNEE': 'Knie re'}
    >>> landmarks(["3 - L_Wrist", "4 - R.Knee.Lat", "5 - LeftAnkle"])
    {'L_WRIST': '3 - L_Wrist', 'R_KNEE': '4 - R.Knee.Lat', 'L_ANKLE': '5 - LeftAnkle'}
    """
    meant = meant or {}
    named = {name: found[0] for name, found in recognise(labels)[1].items() if name != "HEAD_CENTRE"}
    return {name: label for name, label in named.items() if label not in meant.values()} | meant
