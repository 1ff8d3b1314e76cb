"""The page of known marker sets, with the share of recognised labels of each set; ``make docs`` writes it."""

from __future__ import annotations

from pathlib import Path

from lumbar.base.files import write_text
from lumbar.lifting.quality.marker_sets import SETS, LabelSet, recognise

PAGE = "lifting/marker_sets.md"
_HEAD = """\
# Known marker sets

<!-- Made by "make docs" from workflow/lumbar/lifting/quality/marker_sets.yaml; change that. -->

`lumbar inspect`, `lumbar new-study`, and `lumbar lift` without a study recognise the labels of these sets. Case, accents,
punctuation, a subject's prefix (`Anna:LASI`, `Anna_LASI`) and numbers (`4 - L_Wrist`) do not count. *Labels*: labels of the
source that name landmarks; *recognised*: the share that leads to the source's landmark when a file has all labels of the set;
*other points*: labels that lead to none.
Other labels are matched with a list of common words (`L.Knee.Lat`, `wrist_radius`, `PSISr`).

| set | labels | recognised | other points | source |
|---|---|---|---|---|
"""


def count_recognised(kind: LabelSet) -> tuple[int, int]:
    """Return the number of a set's labels that name landmarks, and of those with a recognised landmark."""
    named = {(label, name) for name, choices in kind.choices.items() for one in choices for label in one}
    _, found = recognise(label.lower() for label in sorted(kind.labels))
    return len(named), sum(name in found for _, name in named)


def page() -> str:
    """Return the text of the page."""
    rows = []
    for kind in SETS[:-1]:
        labels, recognised = count_recognised(kind)
        rows.append(
            f"| {kind.title} | {labels} | {recognised / labels:.0%} | {len(kind.others)} | {kind.source} |\n"
        )
    return _HEAD + "".join(rows)


if __name__ == "__main__":
    write_text(Path(__file__).resolve().parents[1] / PAGE, page())
