"""Sentences of Chapter 3 on the survey.

The reconstructed survey was made from the published margins, so what follows from them is built in; what needs the
pairing of one participant's answers is not.
"""

from __future__ import annotations

from itertools import pairwise

from lumbar.publishing.reproduction.claim import Claim, Finding, Results


def _participants(results: Results) -> Finding:
    number = results["survey"]["participants"]["number"]
    return Finding(number, number == 45)


def _share(group: str, printed: float):
    def judge(results: Results) -> Finding:
        people = results["survey"]["participants"]
        found = people["groups"].get(group) or people["experience"].get(group)
        if found is None:
            return Finding(None, None, f"the sheet does not say {group}")
        return Finding(round(found["percent"], 1), abs(found["percent"] - printed) <= 0.051)

    return judge


def _kruskal(results: Results) -> Finding:
    test = results["survey"]["kruskal_wallis"]
    return Finding(f"H {test['statistic']:.2f}, p {test['p_value']:.1e}", test["p_value"] < 0.05)


def _all_but_kb_ho(key: str, test: str = "mann_whitney"):
    """Whether a test tells all pairs of models apart but KB and HO."""

    def judge(results: Results) -> Finding:
        p_values = {frozenset((row["first"], row["second"])): row[key] for row in results["survey"][test]}
        exempt = p_values.pop(frozenset(("KB", "HO")), None)
        if exempt is None or not p_values:
            return Finding(None, None, "KB and HO were not both rated")
        text = f"largest of the others {max(p_values.values()):.2g}; KB and HO {exempt:.2g}"
        return Finding(text, max(p_values.values()) < 0.05 <= exempt)

    return judge


def _paired_agrees(results: Results) -> Finding:
    found, dropped = (_all_but_kb_ho(key, "wilcoxon")(results) for key in ("p_holm", "p_holm_without_zeros"))
    if found.agrees is None:
        return found
    value = f"zero differences ranked: {found.value}; dropped: {dropped.value}"
    if any("reconstructed" in source for source in results["survey"]["participants"]["sources"]):
        return Finding(value, None, "the pairing of the reconstructed answers is not real")
    if found.agrees != dropped.agrees:
        return Finding(value, None, "it hangs on how zero differences are treated")
    return Finding(value, found.agrees)


def _best(which: str, model: str):
    def judge(results: Results) -> Finding:
        picks = {name: entry["percent"] for name, entry in results["survey"]["best_picks"].items()}
        chosen = max(picks, key=picks.get) if which == "highest" else min(picks, key=picks.get)
        return Finding(", ".join(f"{name} {value:.1f} %" for name, value in picks.items()), chosen == model)

    return judge


def _picks_separate(results: Results) -> Finding:
    test = results["survey"]["equal_shares"]["without_baseline"]
    if test is None:
        return Finding(None, None, "too few models were picked")
    return Finding(f"chi-square p {test['p_value']:.2f} among MW, KB, HO", test["p_value"] < 0.05)


def _highest_middle(results: Results) -> Finding:
    table = results["table_3_2"].set_index("model")
    top = {"KB", "HO"}
    agrees = all(
        set(table.index[table[column] == table[column].max()]) == top for column in ("median", "mode")
    )
    return Finding(
        ", ".join(f"{name} {row['median']:g}/{row['mode']:g}" for name, row in table.iterrows()), agrees
    )


def _mode_count(results: Results) -> Finding:
    counts = results["table_3_2"].set_index("model")["mode_count"]
    return Finding(f"HO {counts['HO']}, KB {counts['KB']}", bool(counts["HO"] > counts["KB"]))


def _closer_is_preferred(results: Results) -> Finding:
    table = results["table_3_1"]
    arx = table[(table.estimator == "arx") & (table.trained_on == "multisine")].set_index("model").vaf_percent
    ratings = results["table_3_2"].set_index("model")["median"]
    models = [model for model in ("MW", "KB", "HO") if model in arx.index and model in ratings.index]
    if len(models) < 3:
        return Finding(None, None, "needs MW, KB and HO trained on the multisine")
    by_accuracy = sorted(models, key=lambda model: arx[model])
    rising = all(ratings[low] <= ratings[high] for low, high in pairwise(by_accuracy))
    text = ", ".join(f"{model}: %VAF {arx[model]:.1f}, median {ratings[model]:g}" for model in by_accuracy)
    return Finding(text, rising, "three models: an order that chance gives in one case of six or more")


def sentences() -> list[Claim]:
    """Return the claims on the survey."""
    survey = ("survey",)
    printed = "to the printed digit"
    people = [
        ("clinician", "clinicians", 75.6),
        ("dry_needling", "had practised dry needling", 15.6),
        ("acupuncture", "had practised acupuncture", 13.3),
        ("palpation", "had practised palpation", 93.3),
        ("<5", "had less than 5 years of experience", 11.1),
        (">20", "had over 20 years of experience", 35.6),
    ]
    return [
        Claim("participants", "3.2.4.2", "45 people took part", 45, "equal", survey, _participants, True),
        *(
            Claim(f"participants.{group}", "3.2.4.2", f"{share} % of the participants: {words}", share, printed,
                  survey, _share(group, share), True)
            for group, words, share in people
        ),
        Claim("kruskal_wallis", "3.2.4.2", "The models are not all rated alike (Kruskal–Wallis)", "p < 0.05",
              "p < 0.05", survey, _kruskal, True),
        Claim("pairs_differ", "3.2.4.2", "All pairs of models differ except KB and HO (Mann–Whitney)", "p < 0.05",
              "p < 0.05 for all but KB and HO", survey, _all_but_kb_ho("p_value"), True),
        Claim("pairs_differ_holm", "3.2.4.2", "They still differ after Holm's correction", "p < 0.05",
              "adjusted p < 0.05 for all but KB and HO", survey, _all_but_kb_ho("p_holm"), True),
        Claim("pairs_differ_paired", "3.2.4.2", "The same pairs differ when each participant's own answers are compared",
              "not computed", "adjusted Wilcoxon p < 0.05 for all but KB and HO, zero ranks kept or not", survey, _paired_agrees),
        Claim("highest_median_mode", "3.2.4.2", "Median and mode are highest for the KB and HO models", "4 and 4",
              "KB and HO alone have the largest median and mode", ("table_3_2",), _highest_middle, True),
        Claim("mode_count", "3.2.4.2", "The mode count is higher for the HO than for the KB model", "16 and 14",
              "HO above KB", ("table_3_2",), _mode_count, True),
        Claim("best_ho", "3.2.4.2", "Most participants picked the HO model as the best", "37.8 %", "largest share",
              survey, _best("highest", "HO"), True),
        Claim("best_il", "3.2.5", "Fewest participants picked the IL model as the best", "4.4 %", "smallest share",
              survey, _best("lowest", "IL"), True),
        Claim("picks_separate", "3.2.5", "The picks show which of the dynamic models is preferred",
              "HO preferred over the others", "chi-square p < 0.05 among MW, KB and HO", survey, _picks_separate),
        Claim("closer_is_preferred", "3.2.5, 3.2.9",
              "The closer a model matches the signals, the better it is rated", "MW < KB ≤ HO",
              "median rating does not fall with %VAF on the multisine", ("table_3_1", "table_3_2"),
              _closer_is_preferred, True),
    ]  # fmt: skip
