"""Basins of a lift from its pendulum states: bad input, definitions, reproducibility, and missing basins."""

import re

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import simpson
from stability_cases import COMS, PLANES, SETTINGS, add_thesis, lift, states_and_facts, write_lift_states

import lumbar
from lumbar.lifting.stability.model.pendulum_trajectories import announcement
from refusing import has_tokens
from study_settings import changed

BARE = changed(SETTINGS, checks=[])


@pytest.fixture(scope="module")
def basins(tmp_path_factory):
    states, facts = states_and_facts(lift())
    return lumbar.basins(
        write_lift_states(tmp_path_factory.mktemp("lift"), states, add_thesis(facts)),
        settings=SETTINGS,
        seed=1,
    )


def basins_of(folder, change_states=None, settings=BARE, seed=1, **changes):
    """Basins by the study's choice only, with other facts."""
    states, facts = states_and_facts(lift())
    states = states if change_states is None else change_states(states)
    return lumbar.basins(write_lift_states(folder, states, facts | changes), settings=settings, seed=seed)


def test_mass_with_and_without_the_box(tmp_path):
    for mass, expected in (("with_box", 40.0), ("without_box", 17.0)):
        areas = basins_of(tmp_path, settings=changed(BARE, pendulum={"mass": mass})).areas
        assert (areas["mass_kg"] == expected).all()
        assert [*zip(areas["com"], areas["plane"], strict=True)] == [
            (com, plane) for com in COMS for plane in PLANES
        ]


def set_row(column, row, value):
    def change(states):
        rows = states.index[(states["com"] == "abdomen") & (states["plane"] == "flexion_extension")]
        states.loc[rows[row], column] = value(states.loc[rows[row], column]) if callable(value) else value
        return states

    return change


LENGTH = {com: dict.fromkeys(PLANES, 1.1) for com in COMS}
MASS = {com: {"with_box": 40.0, "without_box": 17.0} for com in COMS}
WHOLE = slice(None)


@pytest.mark.parametrize(
    ("change", "facts", "reason"),
    [
        (set_row("angle_rad", WHOLE, lambda angle: angle + 3.0), {}, "sample 1: angle…3.4 rad"),
        (set_row("time_s", 7, 0.0), {}, "sample 8: time…0 s"),
        (set_row("com", slice(5, None), "pelvis"), {}, "5…20"),
        (None, {"length_m": LENGTH | {"abdomen": dict.fromkeys(PLANES, 0.02)}}, "length_m: …0.02"),
        (None, {"mass_kg": MASS | {"abdomen": {"with_box": 0.0}}}, "mass_kg: …0"),
        (set_row("angle_rad", 3, np.nan), {}, "sample 4: angle…nan"),
        (
            set_row("angular_velocity_rad_s", WHOLE, lambda rate: 2 * rate),
            {},
            "angular_velocity: ",
        ),
    ],
)
def test_invalid_trajectories_are_named_and_drop_out(tmp_path, change, facts, reason):
    actual = basins_of(tmp_path, change, **facts)
    rows = actual.failures().set_index(["com", "plane"])
    row = rows.loc[("abdomen", "flexion_extension")]
    assert (row["subject"], row["basin"]) == ("expert", "trajectory")
    assert has_tokens(row["reason"], reason)
    kept = set(zip(actual.areas["com"], actual.areas["plane"], strict=True))
    assert kept == {(com, plane) for com in COMS for plane in PLANES} - set(rows.index)


def test_areas_have_every_method_and_convention(basins):
    summary = basins.areas
    counts = summary.groupby(["method", "time"]).size().to_dict()
    assert counts == {
        ("exact", "real"): 6,
        ("exact", "unit"): 6,
        ("thesis", "unit"): 6,
    }
    assert set(summary.loc[summary["time"] == "unit", "duration_s"]) == {1.0}
    areas = summary[["mean_area", "initial_area", "minimum_area", "final_area"]]
    assert np.isfinite(areas).all(axis=None) and (areas > 0).all(axis=None)
    exact = summary[summary["method"] == "exact"]
    assert (exact["exits"] == 0).all() and (exact["control_exits"] > 0).all()
    assert (exact["initial_area"] < exact["liouville_area"]).all()
    assert exact["final_area"].to_numpy() == pytest.approx(np.pi / np.sqrt(1000))


@pytest.mark.parametrize(
    ("wording", "method", "time", "digits"),
    [
        ("study", "exact", "real", 1e-4),
        ("thesis", "exact", "unit", 1e-4),
        ("thesis", "thesis", "unit", 1e-2),  # printed with the digits that it has
    ],
)
def test_funnel_file_gives_the_areas(basins, wording, method, time, digits):
    one = basins.funnels.query(
        "wording == @wording and method == @method and com == 'pelvis' and plane == 'lateral_bending'"
    )
    area = np.pi * one["rho"] / np.sqrt(one["s11"] * one["s22"] - one["s12"] ** 2)
    assert area.to_numpy() == pytest.approx(one["area_rad2_s"].to_numpy())
    row = basins.areas.query(
        "com == 'pelvis' and plane == 'lateral_bending' and method == @method and time == @time"
    ).iloc[0]
    mean = simpson(area, x=one["time_s"]) / one["time_s"].iloc[-1]
    assert mean == pytest.approx(row["mean_area"], rel=digits)


def test_seed_determines_the_rows_and_checks_may_be_omitted(basins, tmp_path):
    settings = changed(SETTINGS, checks=["simulation", "proof"])
    again = basins_of(tmp_path, settings=settings).areas
    exact = basins.areas.query("method == 'exact' and time == 'real'").reset_index(drop=True)
    pd.testing.assert_frame_equal(again, exact, check_dtype=False)
    other = basins_of(tmp_path, settings=settings, seed=2).areas
    assert (other["exits"] == 0).all()
    assert other["control_exits"].tolist() != again["control_exits"].tolist()
    bare = basins_of(tmp_path).areas
    assert bare["mean_area"].to_numpy() == pytest.approx(again["mean_area"].to_numpy(), rel=1e-12)
    checks = ["exits", "control_exits", "proved_share", "violation_share", "euler_error"]
    assert bare[checks].isna().all(axis=None)


@pytest.mark.parametrize(
    ("section", "name", "now", "masses", "settings"),
    [
        ("regulator", "control_weight", BARE.regulator.control_weight, {"thorax": {"with_box": 0.3}}, {}),
        (None, "goal_level", 2000, {}, {"goal_level": 2000}),
    ],
)
def test_advised_setting_gives_every_basin(tmp_path, section, name, now, masses, settings):
    light = LENGTH | {"thorax": {"lateral_bending": 1.1, "flexion_extension": 11.0}}
    facts = {"length_m": light, "mass_kg": MASS | masses}
    broken = basins_of(tmp_path, settings=changed(BARE, **settings), **facts)
    message = announcement(broken.failures(), len(broken.areas), "failures.csv")
    scope = ", all of the thorax" if masses else ""
    assert message.startswith(f"{len(broken.failures())} of 6 basins not computed{scope}: ")
    key = ".".join(filter(None, ["stability", section, name]))
    value = float(re.search(rf"{key} is now {now:g}: .* with ([\d.e-]+)", message)[1])
    change = {name: value} if section is None else {section: {name: value}}
    helped = basins_of(tmp_path, settings=changed(BARE, **settings | change), **facts)
    assert helped.failures().empty and helped.complete


def test_missing_extra_leaves_the_study_complete(tmp_path):
    """The pelvis has no pendulum at all, or none by the thesis's wording; the other pendulums have their basins."""
    states, facts = states_and_facts(lift())
    facts["missing"] = {"pelvis": "no marker L5"}
    path = write_lift_states(tmp_path, states[states["com"] != "pelvis"], facts)
    result = lumbar.basins(path, settings=BARE)
    assert len(result.failures()) == 2 and result.complete
    assert not lumbar.basins(path, settings=changed(BARE, goal_level=1e5)).complete


def test_one_missing_basin_drops_only_its_row(basins, tmp_path):
    """A pendulum so light that its regulator reaches further than any basin."""
    light = LENGTH | {"thorax": {"lateral_bending": 1.1, "flexion_extension": 11.0}}
    broken = basins_of(tmp_path, length_m=light, mass_kg=MASS | {"thorax": {"with_box": 0.3}})
    left = broken.areas.set_index(["com", "plane"])
    assert len(left) == 5 and ("thorax", "lateral_bending") not in left.index
    whole = basins.areas.query("method == 'exact' and time == 'real'").set_index(["com", "plane"])
    others = [index for index in left.index if index[0] != "thorax"]
    assert left.loc[others, "mean_area"].to_numpy() == pytest.approx(
        whole.loc[others, "mean_area"].to_numpy(), rel=1e-6
    )
    (failure,) = broken.failures().itertuples()
    assert (failure.com, failure.plane, failure.basin) == ("thorax", "lateral_bending", "exact, hanging")
    assert failure.reason.startswith("the basin")
    assert not broken.complete
    assert not broken.areas["mean_area"].isna().any()
