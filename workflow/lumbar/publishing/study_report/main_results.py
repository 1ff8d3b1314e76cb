"""Main results at the head of a study's report, computed from its results."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from lumbar.base.files import read_json
from lumbar.publishing.reproduction.claim import (
    BUILT_IN,
    BY_DEFINITION,
    CANNOT_BE_TESTED,
    DOES_NOT_HOLD,
    HOLDS,
)
from lumbar.tables.table_layout import unit_in_print, value_in_words

MAX_RESULTS = 3


@dataclass(frozen=True)
class MainResult:
    """One main result of a study."""

    key: str
    """Anchor of the artefact with the details, as in ``#key``."""
    figures: str
    """Numbers of the result with their unit."""
    sentence: str


def find_clearest_diagnosis(results: Path) -> tuple[str, dict] | None:
    """Return record set and ``diagnosis.json`` with the largest share of the base model's error removed; None without any."""
    diagnoses = [
        (_share_removed(diagnosis), name, diagnosis) for name, diagnosis in read_diagnoses(results).items()
    ]
    clearest = max(diagnoses, key=lambda item: item[0], default=(0.0,))
    return clearest[1:] if clearest[0] > 0 else None


def read_diagnoses(results: Path) -> dict[str, dict]:
    """Return the content of ``diagnosis.json`` by record set."""
    return {
        path.parent.name: read_json(path) for path in sorted(results.glob("improvement/*/diagnosis.json"))
    }


def _share_removed(diagnosis: dict) -> float:
    """Return the share of the base model's error on unseen data that the selected effects remove; 0 if it is not known."""
    first, last = (diagnosis["ladder"][step].get("test_rms") for step in (0, -1))
    return 1 - last / first if diagnosis["selected"] and first and last is not None else 0.0


def format_fall(diagnosis: dict, between: str = " → ") -> str:
    """Return the errors of the base and of the selected model on unseen data; `diagnosis` is from ``diagnosis.json``."""
    steps = diagnosis["ladder"][:: max(1, len(diagnosis["ladder"]) - 1)]
    errors = [f"{step['test_rms']:.3g}" for step in steps if step.get("test_rms") is not None]
    return (
        f"{between.join(errors)} {unit_in_print(diagnosis['unit'])}" if errors else "not known on unseen data"
    )


def _diagnosis_result(results: Path) -> Iterator[MainResult]:
    clearest = find_clearest_diagnosis(results)
    if clearest is not None:
        name, diagnosis = clearest
        effects = " and ".join(value_in_words(effect) for effect in diagnosis["selected"])
        yield MainResult(
            f"diagnoses-{name}",
            format_fall(diagnosis),
            f"error of the {diagnosis['base']} model on data of “{value_in_words(name)}” to which it was not fitted, without and "
            f"with {effects}",
        )


def _claims_result(claims: pd.DataFrame) -> Iterator[MainResult]:
    sentences = claims[~claims["claim"].str.startswith("table_")]["verdict"].value_counts()
    holds, differs, *others = (
        int(sentences.get(verdict, 0))
        for verdict in (HOLDS, DOES_NOT_HOLD, BUILT_IN, BY_DEFINITION, CANNOT_BE_TESTED)
    )
    if holds + differs:
        endings = "built into the data", "true by definition", "impossible to test on it"
        rest = ", ".join(f"{count} {ending}" for count, ending in zip(others, endings, strict=True) if count)
        sentence = f"sentences of the thesis that this data can test are reproduced{rest and '; of the others: '}{rest}"
        yield MainResult("state-claims", f"{holds} of {holds + differs}", sentence)


def _basins_result(results: Path) -> Iterator[MainResult]:
    path = results / "stability" / "boa.csv"
    if not path.is_file():
        return
    counts = pd.read_csv(path).groupby("method")[["exits", "simulated_starts"]].sum().astype(int)
    exits, starts = counts.loc["exact"] if "exact" in counts.index else (0, 0)
    if not starts:
        return
    sentence = "simulated starts leave their basin with the exact ρ(t)"
    if "thesis" in counts.index and (others := counts.loc["thesis"])["simulated_starts"]:
        sentence += f"; {others['exits']} of {others['simulated_starts']} leave it by the thesis's method"
    yield MainResult("basin_comparison", f"{exits} of {starts}", sentence)


def main_results(results: Path, keys: Iterable[str], claims: pd.DataFrame | None) -> Sequence[MainResult]:
    """Return up to `MAX_RESULTS` main results of a study with details under one of the anchors `keys`."""
    every = [
        *_diagnosis_result(results),
        *(() if claims is None else _claims_result(claims)),
        *_basins_result(results),
    ]
    known = {*keys, "state-claims"}
    return [item for item in every if item.key in known][:MAX_RESULTS]
