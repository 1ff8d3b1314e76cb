"""A basin that cannot be computed drops its own row, is named, and stops nothing else."""

from dataclasses import replace
from itertools import chain

import numpy as np
import pandas as pd
import pytest
from stability_cases import SETTINGS, lift
from test_stability_table import lift_states, study_of

from lumbar.base.errors import InputError, NumericalError
from lumbar.lifting.stability import changed_pendulums
from lumbar.lifting.stability.basins import basins_of_lift
from lumbar.lifting.stability.changed_pendulums import decomposition_table
from lumbar.lifting.stability.model.pendulum_trajectories import (
    COMS,
    PLANES,
    compute_together,
    pendulum_label,
)
from lumbar.lifting.stability.table_4_1 import tables_4_1
from lumbar.publishing.figures.stability_figures import figure_4_3, figure_4_4, method_comparison_figure
from refusing import has_tokens
from study_settings import changed

FAST = changed(
    SETTINGS,
    knots=101,
    checks=["simulation"],
    attack={"starts": 50, "control_overstated": 0.3},
)


@pytest.fixture(scope="module")
def published(project):
    return pd.read_csv(project / "resources" / "thesis" / "table_4_1.csv")


@pytest.mark.parametrize("named", [True, False])
def test_failing_trajectories_are_computed_separately(named):
    """A named one drops out and the others stay together; without a name each is computed separately."""
    calls = []

    def compute(items):
        """Coms computed together or one by one, and what failed."""

        def coms(some):
            calls.append(len(some))
            if hard := [item for item in some if item.com == "pelvis"]:
                raise NumericalError("too hard", pendulum_label(hard[0], "hanging") if named else "")
            return [item.com for item in some]

        failures = []
        actual = compute_together(coms, items, "exact, hanging", failures)
        return [result for _, result in actual], failures

    results, failures = compute(lift())
    others = ["thorax", "thorax", "abdomen", "abdomen"]
    assert results == ([others] if named else [[com] for com in others])
    assert [(item.com, item.basin) for item in failures] == [("pelvis", "exact, hanging")] * 2
    assert all("too hard" in item.reason for item in failures)
    assert calls == ([6, 1, 5, 1, 4] if named else [6, 1, 1, 1, 1, 1, 1])
    assert compute(lift()[4:])[0] == []
    assert compute([]) == ([], [])
    assert compute(lift()[:2])[0] == [["thorax", "thorax"]]


def test_other_errors_stop_the_computation():
    def compute(items):
        raise InputError("weights")

    with pytest.raises(InputError, match="weights"):
        compute_together(compute, lift(), "x", [])


def test_table_4_1_names_the_missing_basin_in_place_of_its_number(published, monkeypatch):
    """The novice's thorax has no basin in the headline and under no change of weights."""

    def areas(cases, settings):
        for item in chain.from_iterable(cases.values()):
            if (item.subject, item.com) == ("novice", "thorax"):
                raise NumericalError(f"{item.label}: out of reach", pendulum_label(item, "hanging"))
        return {name: np.ones(len(items)) for name, items in cases.items()}

    study = study_of(
        [lift_states(), lift_states("novice")], FAST.model_copy(update={"checks": ()}), published
    )
    gone = (study.boa["subject"] == "novice") & (study.boa["com"] == "thorax") & (study.boa["time"] == "real")
    parts = decomposition_table(study)[0].frame
    monkeypatch.setattr(changed_pendulums, "varied_areas", areas)
    tables = tables_4_1(replace(study, boa=study.boa[~gone]), parts)
    table, controls, missing = tables.table, tables.controls, tables.missing
    rows = table.frame.set_index(["comparison", "com"])
    row = rows.loc["expert_vs_novice", "thorax"]
    assert has_tokens(row["status"], "novice 23 kg thorax lateral_bending")
    assert np.isnan(row["lateral_bending_headline_percent"]) and np.isfinite(row["lateral_bending_percent"])
    assert controls.frame["verdict"].str.contains("novice 23 kg").any()
    assert rows.loc["expert_vs_novice", "pelvis"]["status"] == "computed"
    assert has_tokens(table.to_html(), "novice 23 kg, thorax, lateral_bending: Table 4.1…Q")
    assert "nan" not in table.to_latex() and "nan" not in controls.to_html()
    assert missing["basin"].str.contains(r"\bQ\b").any()


def test_a_lift_without_any_basin_is_still_compared_by_name(published):
    lost = lift_states(thesis=False)
    lost.facts["length_m"] = {com: dict.fromkeys(PLANES, 0.02) for com in COMS}
    study = study_of(
        [lost, lift_states(box=15.0, thesis=False)], FAST.model_copy(update={"checks": ()}), published
    )
    table = tables_4_1(study, decomposition_table(study)[0].frame).table
    status = table.frame.set_index(["comparison", "com"])["status"]
    assert has_tokens(status["decrease_in_mass_expert", "pelvis"], "expert 23 kg pelvis lateral_bending")
    assert table.frame["lateral_bending_headline_percent"].isna().all()
    funnels = basins_of_lift([], FAST, seed=1).funnels
    assert funnels.empty
    for figure in (
        figure_4_3(funnels, FAST),
        figure_4_4(funnels, FAST),
        method_comparison_figure([], funnels, FAST),
    ):
        assert "missing_basins" in str([text.get_text() for axis in figure.axes for text in axis.texts])
