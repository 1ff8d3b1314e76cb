"""Names, docstrings, messages, comments and pages are written in plain technical English."""

import ast
import re
import subprocess
from collections import defaultdict
from pathlib import Path

import pytest

NAME_STARTS = re.compile(
    r"(?:across|answered|as|asked|at|begun|beside|behind|beyond|by|carried|confined|described|"
    r"exactly|far|found|given|goes|handed|hangs|held|in|kept|left|lies|lost|made|moves|nobody|"
    r"of|on|once|only|own|played|put|rounded|said|seen|settled|shown|somebody|stands|taken|"
    r"tells|told|trained|turned|twice|until|unrounded|waiting|what|whatever|when|where|which|"
    r"whose|within|without)$"
)
"""Participles, prepositions and adverbs with which no name begins. Names may begin with from, with and to."""
WORDING = re.compile(
    r"\b(?:(?:is|are|be|was|were) told|told by|tells? (?:of|what|apart)|(?:is|are) said|says? so|says itself"
    r"|stands? (?:beside|below|above|in|for|once|twice|still|there|again|at)|beside|mend(?:s|ed|ing)?|anew|hangs? on"
    r"|pass(?:es)? for|as of|of one's own|let go|comes? of|whoever|whom|nobody|somebody|taken off|holds? the truth"
    r"|sought|goes with|surely|rightly|wrongly|the other way round|turned round|wholly|strangers?|parted by)\b",
    re.I,
)
"""Wording that readers of the project stumbled over; `docs/glossary.md` has the terms that replace it."""
FIELD_LIST = re.compile(r"\s*`\w+`(?:, `\w+`)+:")
PYTHON = ("workflow/*.py", "tests/*.py", "benchmarks/*.py", "docs/generate/*.py")
TEXTS = ("README.md", "docs", "workflow", "config", "resources/*.yaml", "Makefile", "Snakefile")
TEXT_ENDINGS = {".py", ".md", ".yaml", ".jinja", ".rst", ".tsv", ".smk", ""}


@pytest.fixture(scope="module")
def sources(project):
    """Return the syntax tree of each Python file by its path."""
    return {
        path: ast.parse((project / path).read_text(encoding="utf-8")) for path in tracked(project, *PYTHON)
    }


def tracked(project: Path, *patterns: str) -> list[str]:
    """Return the files that git tracks."""
    listed = subprocess.run(["git", "ls-files", *patterns], cwd=project, capture_output=True, text=True)
    return [path for path in listed.stdout.splitlines() if (project / path).is_file()]


def words_of(name: str) -> list[str]:
    """Return the words of a name in small letters.

    >>> words_of("_HeldSamples")
    ['held', 'samples']
    """
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower().strip("_").split("_")


def test_names_begin_with_verbs_or_nouns(sources):
    defined = (
        (path, node.lineno, node.name)
        for path, tree in sources.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
    )
    assert not [place for place in defined if NAME_STARTS.match(words_of(place[2])[0])]


def test_each_class_and_each_module_has_its_own_name(sources):
    places = defaultdict(list)
    for path, tree in sources.items():
        if not path.startswith("workflow/lumbar/"):
            continue
        if not Path(path).name.startswith("__"):
            places[Path(path).name].append(path)
        for node in tree.body:
            if isinstance(node, ast.ClassDef):
                places[node.name].append(path)
    # The modules of the command line have the names of its groups.
    repeated = {name: paths for name, paths in places.items() if len(paths) > 1}
    assert not {name: paths for name, paths in repeated.items() if not any("/cli/" in path for path in paths)}


def test_each_field_has_its_own_docstring(sources):
    classes = (
        (path, node)
        for path, tree in sources.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    )
    texts = (
        (path, item.lineno, item.value.value)
        for path, node in classes
        for item in node.body
        if isinstance(item, ast.Expr) and isinstance(item.value, ast.Constant)
    )
    assert not [(path, line) for path, line, text in texts if FIELD_LIST.match(str(text))]


def test_wording_is_that_of_the_glossary(project):
    hits = {
        (path, line.strip())
        for path in tracked(project, *TEXTS)
        if Path(path).suffix in TEXT_ENDINGS
        for line in (project / path).read_text(encoding="utf-8").splitlines()
        if WORDING.search(line)
    }
    assert not hits
