"""The page and the figures of the measures hold what the long table and the courses say."""

import numpy as np
import pandas as pd
import pytest
from lifting_cases import lift_of, true_recording, without

from lumbar.interface.movement import measure_movement
from lumbar.lifting.measures.lift_values import SENSITIVITY, long_table, measures_page, write_measures
from lumbar.publishing.figures.movement_figures import SHOWN, course_figure, support_figure
from lumbar.tables.table import SYNTHETIC_TWIN
from study_settings import subject_settings


@pytest.fixture(scope="module")
def lifts():
    """Two measured lifts, the second without feet."""
    made = []
    for name, hidden in (("expert_23kg", ()), ("novice_23kg", ("TOE", "HEEL"))):
        recording = without(true_recording(name), *hidden)
        lift = lift_of(recording, subject_settings(name.split("_")[0]), 23.0, name=name)
        found = measure_movement(lift)
        events = {key: event.as_dict() for key, event in lift.analysed.events.items()}
        made.append({"course": found.instants, "facts": lift.facts, "events": events, "values": found.values})
    return made


@pytest.fixture(scope="module")
def table(lifts):
    groups = {"expert": "expert", "novice": "novice"}
    return long_table(((lift["values"], lift["facts"]) for lift in lifts), groups)


def test_the_page_has_the_mean_of_a_group_and_says_what_is_absent(table):
    page = measures_page(table, SYNTHETIC_TWIN)
    rows = page.frame.set_index(["measure", "plane"])
    again = table[(table["measure"] == "l5s1_moment_peak") & (table["plane"] == "all")].set_index("group")[
        "value"
    ]
    assert rows.loc[("l5s1_moment_peak", "all"), "expert 23 kg"] == again["expert"]
    assert np.isnan(rows.loc[("margin_of_stability", "all"), "novice 23 kg"])
    assert any("novice_23kg, margin_of_stability: no marker L_HEEL" in note for note in page.notes)
    assert SENSITIVITY in page.notes
    assert SENSITIVITY not in measures_page(table, "some laboratory").notes
    doubled = measures_page(pd.concat([table, table.assign(lift="again", value=table["value"] + 2)]), "x")
    mean = doubled.frame.set_index(["measure", "plane"]).loc[("l5s1_moment_peak", "all"), "expert 23 kg"]
    assert mean == pytest.approx(again["expert"] + 1)


def test_the_long_table_is_the_csv_and_the_page_the_rest(table, tmp_path):
    write_measures(tmp_path / "movement_measures", table, SYNTHETIC_TWIN)
    read = pd.read_csv(tmp_path / "movement_measures.csv", keep_default_na=False, na_values=[""])
    assert len(read) == len(table)
    assert set(read["data"]) == {SYNTHETIC_TWIN}
    assert "Hof, Gazendam" in (tmp_path / "movement_measures.html").read_text(encoding="utf-8")
    assert r"\begin{tabular}" in (tmp_path / "movement_measures.tex").read_text(encoding="utf-8")


def texts(figure):
    return " ".join(text.get_text() for axis in figure.axes for text in axis.texts)


def test_the_course_is_drawn_with_its_events_and_what_lacks_markers_is_said(lifts):
    figure = course_figure(lifts, 0.6)
    margin = figure.axes[0].lines[0].get_ydata()
    assert margin == pytest.approx(1e3 * lifts[0]["course"]["margin_of_stability_m"], nan_ok=True)
    times = [event["time_s"] for event in lifts[0]["events"].values()]
    drawn = [line.get_xdata()[0] for line in figure.axes[0].lines if len(set(line.get_xdata())) == 1]
    assert sorted(drawn) == pytest.approx(sorted(times))
    assert "no markers for it" in texts(figure)
    assert f"the first {SHOWN} of 6 lifts" in course_figure(3 * lifts, 0.6).get_suptitle()


def test_the_base_is_drawn_with_the_smallest_margin(lifts):
    figure = support_figure(lifts, 0.6)
    deposit = lifts[0]["course"].query("phase == 'deposit'")
    assert f"{1e3 * deposit['margin_of_stability_m'].min():+.0f} mm".replace("-", "−") in texts(figure)
    assert "no base of support during a deposit" in texts(figure)
