"""Scores of the diagnosis on experiments whose hidden effect is known: accuracy, false alarms, confusion."""

from __future__ import annotations

from typing import TYPE_CHECKING

from scipy.stats import binomtest

from lumbar.base.errors import Problems
from lumbar.tables.table import SYNTHETIC_TWIN, Table

if TYPE_CHECKING:
    import pandas as pd

    from hidden_effects.settings import HiddenEffectsSettings

NAMED, TIED, EXTRA, PARTLY = "named", "tied", "extra", "partly"
WRONG, UNEXPLAINED, MISSED = "wrong", "unexplained", "missed"
INCOMPLETE = "incomplete"
QUIET, ACCUSED, FAILED = "adequate", "accused", "failed"
VERDICTS = ("adequate", "named", "tied", "unexplained")
RIGHT = {"single": {NAMED}, "pair": {NAMED}, "outside": {UNEXPLAINED}, "null": {QUIET}}
"""Outcomes that count as right for each kind of experiment."""
OUTCOMES = {
    NAMED: "named exactly the hidden effects",
    TIED: "the hidden effects are among those that cannot be distinguished",
    EXTRA: "named the hidden effects and others",
    PARTLY: "named some of the hidden effects and not all",
    WRONG: "named none of the hidden effects",
    INCOMPLETE: "named what resembles the hidden effect, and said that something is left that the catalogue does not "
    "explain",
    UNEXPLAINED: "said that something is missing that the catalogue does not explain",
    MISSED: "called the base model adequate although an effect is hidden",
    QUIET: "correctly called the base model adequate",
    ACCUSED: "claimed that something is missing although nothing is hidden",
    FAILED: "reported that it reached no result",
}


def outcome(kind: str, hidden: list[str], diagnosis: dict) -> str:
    """Compare one diagnosis with the truth.

    Parameters
    ----------
    kind : str
        ``"single"``, ``"pair"``, ``"outside"`` or ``"null"``.
    hidden : list of str
        Mechanisms that are hidden.
    diagnosis : dict
        With ``verdict``, ``verdict_after``, ``selected`` and ``tied_with``, or with ``error`` where none was reached.

    Returns
    -------
    str
        A key of `OUTCOMES`.
    """
    if "error" in diagnosis:
        return FAILED
    verdict, selected = diagnosis["verdict"], set(diagnosis["selected"])
    if kind == "null":
        return QUIET if verdict == "adequate" else ACCUSED
    if verdict == "adequate":
        return MISSED
    if verdict == "unexplained":
        return UNEXPLAINED
    if kind == "outside" and diagnosis["verdict_after"] == "unexplained":
        return INCOMPLETE
    truth = set(hidden)
    if selected == truth and verdict == "named":
        return NAMED
    # An entry with "+" is a set of several effects.
    alternatives = {name for entry in diagnosis["tied_with"] for name in entry.split("+")}
    if verdict == "tied" and truth <= selected | alternatives:
        return TIED
    if truth < selected:
        return EXTRA
    return PARTLY if truth & selected else WRONG


def scores(labels: dict[str, dict], diagnoses: dict[str, dict]) -> pd.DataFrame:
    """Put truth and diagnosis of every experiment into one row.

    Parameters
    ----------
    labels : dict
        Truth by experiment, as in ``labels.json``.
    diagnoses : dict
        Diagnosis by experiment, in the form ``lumbar.diagnosis/1``; ``{"error": message}``
        where the diagnosis reached no result.

    Returns
    -------
    pandas.DataFrame
        Sorted by experiment.

    Raises
    ------
    InputError
        If the experiments differ, or a diagnosis has an unknown verdict.
    """
    import pandas as pd

    _check_same(labels, diagnoses)
    rows = []
    for name in sorted(labels):
        label, diagnosis = labels[name], diagnoses[name]
        kind = label["kind"]
        result = outcome(kind, label["effects"], diagnosis)
        if result == FAILED:
            diagnosis = {"verdict": FAILED, "selected": [], "tied_with": [], "complete": None, "ladder": []}
        test_rms = diagnosis["ladder"][-1]["test_rms"] if diagnosis["ladder"] else None
        rows.append(
            {
                "experiment": name,
                "kind": kind,
                "effects": "+".join(label["effects"]),
                "forms": "+".join(label["form"]),
                "noise_colour": label["noise_colour"],
                # The weaker of two effects decides whether both can be found.
                "residual_over_noise": min(label["residual_over_noise"], default=None),
                "verdict": diagnosis["verdict"],
                "selected": "+".join(diagnosis["selected"]),
                "tied_with": ", ".join(diagnosis["tied_with"]),
                "outcome": result,
                "right": result in RIGHT[kind],
                "complete": diagnosis["complete"],
                "test_over_noise": None if test_rms is None else test_rms / label["noise_rms_N"],
            }
        )
    return pd.DataFrame(rows)


def _check_same(labels: dict[str, dict], diagnoses: dict[str, dict]) -> None:
    problems = Problems("benchmark of the diagnosis")
    for name in sorted(labels.keys() ^ diagnoses.keys()):
        missing = "diagnosis" if name in labels else "label"
        problems.add(name, f"no {missing}", "every experiment needs both")
    for name in sorted(labels.keys() & diagnoses.keys()):
        verdict = diagnoses[name].get("verdict")
        if "error" not in diagnoses[name] and verdict not in VERDICTS:
            problems.add(name, f"verdict {verdict!r}", f"allowed: {', '.join(VERDICTS)}")
    problems.raise_if_any()


def share_with_interval(successes: int, trials: int, confidence: float) -> dict[str, float]:
    """Share in percent with Wilson's interval (J. Am. Stat. Assoc. 22, 1927)."""
    interval = binomtest(successes, trials).proportion_ci(confidence, method="wilson")
    return {
        "share_percent": 100 * successes / trials,
        "low_percent": 100 * interval.low,
        "high_percent": 100 * interval.high,
    }


_MISTAKES = (TIED, EXTRA, PARTLY, WRONG, INCOMPLETE, UNEXPLAINED, MISSED, ACCUSED, FAILED)


def _groups(frame: pd.DataFrame, strong: float):
    """Yield the groups of the accuracy table: name and rows."""
    for kind, words in (("single", "one effect"), ("pair", "two effects")):
        members = frame[frame["kind"] == kind]
        yield f"{words}, ≥ {strong:g} × noise", members[members["residual_over_noise"] >= strong]
        yield f"{words}, < {strong:g} × noise", members[members["residual_over_noise"] < strong]
    single = frame[(frame["kind"] == "single") & (frame["residual_over_noise"] >= strong)]
    for colour in sorted(frame["noise_colour"].unique()):
        yield f"one effect, ≥ {strong:g} × noise, {colour}", single[single["noise_colour"] == colour]
    yield "outside the catalogue", frame[frame["kind"] == "outside"]
    null = frame[frame["kind"] == "null"]
    yield "nothing hidden", null
    for colour in sorted(frame["noise_colour"].unique()):
        yield f"nothing hidden, {colour}", null[null["noise_colour"] == colour]


def accuracy_table(frame: pd.DataFrame, settings: HiddenEffectsSettings) -> Table:
    """Return the share of right diagnoses by kind, strength and colour of the noise.

    Parameters
    ----------
    frame : pandas.DataFrame
        Of `scores`.
    """
    import pandas as pd

    confidence, rows = settings.confidence, []
    for name, group in _groups(frame, settings.strong_residual_over_noise):
        if group.empty:
            continue
        counts = group["outcome"].value_counts()
        rows.append(
            {
                "experiments": name,
                "count": len(group),
                "right": int(group["right"].sum()),
                **share_with_interval(int(group["right"].sum()), len(group), confidence),
                **{key: int(counts.get(key, 0)) for key in _MISTAKES},
                "test_over_noise": _median(group["test_over_noise"]),
            }
        )
    return Table(
        title="Accuracy of the diagnosis on hidden effects.",
        frame=pd.DataFrame(rows),
        definitions={
            "experiments": "what is hidden; × noise: RMS that the best Kelvin–Boltzmann model leaves of the "
            "noise-free multisine, over the RMS of the noise; of two effects the weaker",
            "count": "number of experiments",
            "right": "one or two effects: named exactly these; outside the catalogue: verdict unexplained; "
            "nothing hidden: verdict adequate",
            "share_percent": "right / count",
            "low_percent": f"lower end of Wilson's {100 * confidence:g} % interval of the share",
            "high_percent": "upper end of it",
            **{key: OUTCOMES[key] for key in _MISTAKES},
            "test_over_noise": "median of the free-run error on unseen excitation, with the selected effects "
            "added, over the true RMS of the noise",
        },
        source_label=SYNTHETIC_TWIN,
        notes=(
            "Of what is hidden outside the catalogue, a spring-pot and a power-law branch resemble entries of it.",
        ),
        decimals={"share_percent": 1, "low_percent": 1, "high_percent": 1, "test_over_noise": 3},
        may_be_empty=frozenset({"test_over_noise"}),
    )


def _median(values: pd.Series) -> float | None:
    known = values.dropna()
    return float(known.median()) if len(known) else None


def forms_table(frame: pd.DataFrame, settings: HiddenEffectsSettings) -> Table:
    """Return the share of right names by mathematical form, and the strength from which each mechanism is named."""
    import pandas as pd

    strong, confidence, rows = settings.strong_residual_over_noise, settings.confidence, []
    hidden = frame[frame["kind"].isin(["single", "outside"]) & (frame["residual_over_noise"] >= strong)]
    # Experiments are in the catalogue's order; those outside it come last.
    for form, group in hidden.sort_values("kind", ascending=False, kind="stable").groupby(
        "forms", sort=False
    ):
        mistakes = group.loc[~group["right"], ["verdict", "selected"]]
        named = [
            row.selected if row.verdict in ("named", "tied") else row.verdict for row in mistakes.itertuples()
        ]
        rows.append(
            {
                "mechanism": form.split(":")[0],
                "form": form.split(":")[1],
                "count": len(group),
                "right": int(group["right"].sum()),
                **share_with_interval(int(group["right"].sum()), len(group), confidence),
                "instead": ", ".join(sorted(set(named))) or "–",
            }
        )
    return Table(
        title=f"Accuracy of the diagnosis by mathematical form, effects of at least {strong:g} × noise.",
        frame=pd.DataFrame(
            rows,
            columns=[
                "mechanism",
                "form",
                "count",
                "right",
                "share_percent",
                "low_percent",
                "high_percent",
                "instead",
            ],
        ),
        definitions={
            "mechanism": "entry of the catalogue that is hidden; outside: none of them",
            "form": "mathematical form in which it is hidden",
            "count": "number of experiments",
            "right": "named exactly the mechanism; outside: verdict unexplained",
            "share_percent": "right / count",
            "low_percent": f"lower end of Wilson's {100 * confidence:g} % interval of the share",
            "high_percent": "upper end of it",
            "instead": "what was named where it was not right",
        },
        source_label=SYNTHETIC_TWIN,
        decimals={"share_percent": 1, "low_percent": 1, "high_percent": 1},
    )


_UNNAMED = ("unexplained", "adequate", FAILED)


def confusion(frame: pd.DataFrame, mechanisms: list[str]) -> pd.DataFrame:
    """Count answers (columns) by hidden effect (rows); experiments with two effects are left out.

    Columns hold the first effect selected; if the hidden effect was one of several that cannot be distinguished,
    ``tied``. An effect named in a verdict ``unexplained`` counts as unexplained.
    """
    import pandas as pd

    members = frame[frame["kind"] != "pair"]
    answers = members["selected"].str.split("+").str[0]
    answers = answers.mask(members["outcome"] == TIED, "tied")
    answers = answers.mask(members["verdict"].isin(_UNNAMED), members["verdict"])
    hidden = members["effects"].replace("", "nothing")
    rows = [*mechanisms, "outside", "nothing"]
    others = sorted(set(answers) - {*mechanisms, "tied", *_UNNAMED})
    failed = [FAILED] if (answers == FAILED).any() else []
    columns = [*mechanisms, *others, "tied", "unexplained", "adequate", *failed]
    counted = pd.crosstab(hidden, answers)
    counted = counted.reindex(index=rows, columns=columns, fill_value=0)
    return counted.rename_axis(index="hidden", columns=None).reset_index()
