"""From synthetic lifts to the contest of measures: levels, scores by Mann and Whitney, the ROC by independent formulas."""

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest
from lifting_cases import deposit, lift_of, true_recording
from scipy.stats import mannwhitneyu, norm, sem, t

from lumbar.base.errors import InputError
from lumbar.interface.movement import measure_movement
from lumbar.interface.pushing import pooled_prediction, push_outcomes, push_prediction, push_states
from lumbar.lifting.measures.course import Lifter
from lumbar.lifting.population.contrast import jackknife_interval
from lumbar.lifting.pushes import prediction, roc
from lumbar.lifting.pushes.body import centre_of_mass
from lumbar.lifting.pushes.contest import Contest
from lumbar.lifting.pushes.levels import BASELINES, DIRECTIONS, KNOTS, PREDICTORS, from_states
from lumbar.lifting.pushes.motion import bodies_of, deposit_motion
from lumbar.lifting.pushes.prediction import verdict_json
from lumbar.lifting.pushes.roc import (
    area_interval,
    areas,
    best_threshold,
    cross_validated_rates,
    curve,
    sensitivity_at,
    sort_scores,
)
from lumbar.lifting.stability.basins import close_loops
from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels
from lumbar.lifting.stability.model.trajectories import trajectories_of_lift
from lumbar.settings.pushes import PushesSettings, PushSettings
from lumbar.settings.stability import StabilitySettings
from study_settings import subject_settings

STABILITY = StabilitySettings()
SETTINGS = replace(PushesSettings(), push=PushSettings(per_lift=16))


@pytest.fixture(scope="module")
def lifts():
    found = []
    for name in ("expert_23kg", "expert_15kg", "novice_15kg"):
        person, mass = name.split("_")
        box = float(mass.removesuffix("kg"))
        found.append(lift_of(true_recording(name), subject_settings(person), box, name=name))
    return found


@pytest.fixture(scope="module")
def states(lifts):
    return push_states(lifts, STABILITY, SETTINGS.push.height_share)


@pytest.fixture(scope="module")
def found(states):
    return push_prediction(states, settings=SETTINGS, stability=STABILITY, seed=1, data="synthetic")


def test_links_go_through_the_joints_and_carry_the_measured_centre_of_mass(lifts):
    lift = lifts[0]
    lifter = Lifter(lift.body, lift.facts, STABILITY.measures, 9.81)
    motion, points = deposit_motion(lifter), lifter.points
    here = np.isin(lifter.time, motion.time)
    trunk = (points["L_SHOULDER"] + points["R_SHOULDER"]) / 2 - points["MID_HIP"]
    lean = np.arctan2(trunk[here, 1], trunk[here, 2])
    assert motion.angle[1] == pytest.approx(lean, abs=0.01)
    assert motion.rate[1] == pytest.approx(np.gradient(lean, motion.time), abs=0.15)
    ankles = (points["L_ANKLE"] + points["R_ANKLE"])[here] / 2
    centre = (78 * points["WHOLE_BODY"] + 23 * points["LOAD"])[here] / 101 - ankles
    bodies = bodies_of([motion]).take(np.zeros(here.sum(), dtype=int))
    ahead = centre_of_mass(bodies, motion.angle, motion.rate)[0]
    assert ahead.mean() == pytest.approx(centre[:, 1].mean(), abs=1e-9)
    assert ahead == pytest.approx(centre[:, 1], abs=0.01)
    # Marker of the toe: 0.72 of a foot of 0.152 of the stature ahead of the ankle (lumbar.twin.lifter).
    assert motion.toe_m == pytest.approx(0.72 * 0.152 * 1.75, abs=1e-3)


def test_levels_are_those_of_the_measures_tables(lifts, states):
    for name, part in states.groupby("lift"):
        lift = next(item for item in lifts if item.name == name)
        rows = measure_movement(lift).values.set_index(["measure", "plane"])["value"]
        for measure in ("margin_of_stability", "smallest_impulse", "capture_margin", "viability_margin"):
            lowest = part[[f"{measure}_{direction}" for direction in DIRECTIONS]].min().min()
            assert lowest == pytest.approx(rows[measure, "flexion_extension"], abs=1e-6)
        assert -part["l5s1_moment_forward"].min() == pytest.approx(rows["l5s1_moment_peak", "all"])
        assert -part["trunk_inclination_forward"].min() == pytest.approx(
            rows["trunk_inclination_peak", "flexion_extension"]
        )


def test_a_push_of_the_level_takes_the_pendulum_to_the_edge_of_its_basin(lifts, states):
    lift = lifts[0]
    sound, _ = trajectories_of_lift(lift.states, lift.facts, "with_box")
    item = next(one for one in sound if (one.com, one.plane) == ("abdomen", "flexion_extension"))
    loops = close_loops([item], "inverted", replace(STABILITY, knots=KNOTS))
    funnels = exact_funnels(loops, STABILITY.goal_level)
    motions, levels = from_states(states)
    last, motion = levels[0].values["basin_abdomen_inverted", "forward"][-1], motions[0]
    height = np.cos(motion.angle[:2, -1]) @ (motion.lengths[:2] * [1, SETTINGS.push.height_share])
    # At the end V is that of the goal set: Qf22·ω² = ρ(T), with ω the push's moment over the pendulum's inertia.
    turn = last * height / (item.mass_kg * item.length_m**2)
    assert 10.0 * turn**2 == pytest.approx(STABILITY.goal_level, rel=1e-2)
    assert levels[0].values["basin_area_abdomen_inverted", "forward"][0] == pytest.approx(
        funnels.mean_area[0], rel=1e-9
    )


def test_areas_of_the_table_are_those_of_the_pushes(found):
    pushes = found.pushes
    rows = found.frame[(found.frame["contest"] == "all sizes") & (found.frame["direction"] == "both")]
    rows, steps = rows.set_index("measure"), pushes["steps"].to_numpy(bool)
    for (name, kind), odds in found.chances.items():
        pairs = mannwhitneyu(odds[steps], odds[~steps]).statistic / (steps.sum() * (~steps).sum())
        added = kind == "added"
        expected = (
            rows.loc["push_and_mass", "auc"] + rows.loc[name, "increment"] if added else rows.loc[name, "auc"]
        )
        if not np.isnan(expected):
            assert pairs == pytest.approx(expected, rel=1e-12)
    backward = pushes[pushes["direction"] == "backward"]
    equal = found.frame[(found.frame["contest"] == "equal pushes") & (found.frame["direction"] == "backward")]
    if len(equal):
        told = backward["equal_steps"].to_numpy(bool)
        level = backward["level_viability_margin"]
        pairs = mannwhitneyu(-level[told], -level[~told]).statistic / (told.sum() * (~told).sum())
        assert equal.set_index("measure").loc["viability_margin", "auc"] == pytest.approx(pairs, rel=1e-12)


def invented(persons: int, tells: float, seed: int = 0) -> Contest:
    """A contest whose steps go by push over mass, for each direction otherwise, and by the static margin as far as it `tells`."""
    rng = np.random.default_rng(seed)
    person = np.repeat(np.arange(persons), 60)
    forward = np.arange(len(person)) % 2 == 0
    mass = rng.uniform(60, 110, persons)[person]
    size = np.where(forward, rng.uniform(0.5, 20, person.size), rng.uniform(10, 60, person.size))
    names = {f"level_{name}": rng.normal(size=person.size) for name in PREDICTORS if name != "push_over_mass"}
    names |= {name: np.exp(level) for name, level in names.items() if "basin" in name}
    centre = np.where(forward, 0.12, 0.42)
    odds = 30 * (size / mass - centre) - tells * names["level_static_margin"]
    steps = rng.random(person.size) < 1 / (1 + np.exp(-odds))
    frame = pd.DataFrame(
        {
            "subject": [f"person {number:02}" for number in person],
            "direction": np.where(forward, "forward", "backward"),
            "impulse_N_s": size,
            "shift_m_per_N_s": 1 / (3 * mass),
            "steps": steps,
            "equal_steps": steps,
            "level_push_over_mass": mass,
            **names,
        }
    )
    return Contest(frame, len(frame), 0)


@cache
def judged(tells: float):
    """Verdict and table of a contest of 16 people."""
    contest, scoring = invented(16, tells), SETTINGS.scoring
    told = prediction.chances(contest, scoring, 1)
    table = prediction.prediction_frame(contest, told, scoring, 1)
    return prediction.verdict_of(contest, table, told, scoring), table


def test_a_measure_that_tells_something_is_named_and_one_that_tells_nothing_is_not():
    verdict, table = judged(2.0)
    assert verdict.measure == "static_margin" and verdict.low > 0.01 and not verdict.tied
    assert verdict_json(verdict, "synthetic")["adds"]
    rows = table[(table["contest"] == "all sizes") & (table["direction"] == "both")].set_index("measure")
    assert (rows["increment_low"].drop("static_margin").dropna() < 0.002).all()
    nothing, _ = judged(0.0)
    assert "no measure is shown to add to that" in nothing.sentence
    assert not verdict_json(nothing, "synthetic")["adds"]


def test_baselines_lose_nothing_by_the_direction_and_can_be_best():
    verdict, table = judged(0.0)
    rows = table[table["contest"] == "all sizes"].set_index(["direction", "measure"])["auc"]
    assert verdict.best_alone in ("push_over_mass", "push_and_mass")
    within = [rows[direction, "push_over_mass"] for direction in DIRECTIONS]
    assert rows["both", "push_over_mass"] > min(within) - 0.01
    pooled = invented(16, 0.0).frame
    one = prediction.area(
        (pooled["impulse_N_s"] / pooled["level_push_over_mass"]).to_numpy(), pooled["steps"].to_numpy(bool)
    )
    assert one < rows["both", "push_over_mass"] - 0.1


def test_the_winner_says_what_it_rests_on_and_has_no_interval_of_two_persons(found):
    winner = found.winner
    main = found.frame[(found.frame["contest"] == "all sizes") & (found.frame["direction"] == "both")]
    assert winner.measure not in BASELINES and winner.increment == main["increment"].max()
    assert winner.low is None and "no interval: 2 persons, at least 8 are needed" in winner.sentence
    assert "simulated bodies under an assumed controller, not people" in winner.sentence
    assert "people best" not in winner.sentence  # which of two persons steps first is chance
    assert verdict_json(winner, "synthetic")["measure"] == winner.measure
    assert found.contest.drawn == 48
    assert len(found.pushes) == 48 - found.contest.unsteady
    assert "left out" in found.table.to_html()


def test_one_person_alone_is_no_contest(states):
    alone = states[states["subject"] == states["subject"].iloc[0]]
    with pytest.raises(InputError, match="two persons at least"):
        push_prediction(alone)


def test_a_person_is_pushed_alike_whoever_else_is_and_files_of_persons_give_the_same(states, found, tmp_path):
    paths = {"outcomes": [], "states": []}
    for person, part in states.groupby("subject", sort=False):
        outcomes = push_outcomes(part, SETTINGS, 1)
        steady = outcomes[outcomes["outcome"] != "unsteady"].reset_index(drop=True)
        among_others = found.pushes[found.pushes["subject"] == person].reset_index(drop=True)
        pd.testing.assert_frame_equal(steady, among_others, check_exact=True)
        for kind, frame in (("outcomes", outcomes), ("states", part)):
            paths[kind].append(tmp_path / f"{kind}_{person}.csv")
            frame.to_csv(paths[kind][-1], index=False)
    pooled = pooled_prediction(*paths.values(), SETTINGS, 1, "synthetic")
    pd.testing.assert_frame_equal(pooled.pushes, found.pushes, rtol=1e-12)
    assert pooled.winner.sentence == found.winner.sentence
    assert [item.lift for item in pooled.followed.motions] == [item.lift for item in found.followed.motions]


def test_some_pushes_of_both_directions_are_followed_of_people_evenly_taken(monkeypatch):
    monkeypatch.setattr(prediction, "FOLLOWED", 12)
    motions = {item.lift: item for item in map(deposit, "abcdefghij")}
    found = prediction.follow(list(motions), 24, lambda names: ([motions[name] for name in names], []))
    # Every 21st of 240, counted lift after lift.
    assert [motion.subject for motion in found.motions] == list("abcdefghij")
    pushes = [24 * "abcdefghij".index(found.motions[one // 24].subject) + one % 24 for one in found.chosen]
    assert pushes == list(range(0, 240, 21))
    assert 0 < (found.chosen % 2).mean() < 1


def test_longer_feet_let_fewer_step_and_the_measures_are_not_told(states, found, monkeypatch):
    monkeypatch.setattr(prediction, "VARIED", {"foot length": ("foot", (1.1,))})
    rows = found.sensitivity.frame
    assert rows["changed"].tolist() == ["nothing", "foot length"]
    assert rows["steps"].tolist() == sorted(rows["steps"], reverse=True)
    assert rows["known_auc"].between(0.5, 1.0).all()
    assert rows.loc[0, "steps"] == pytest.approx(found.pushes["steps"].mean())


@pytest.fixture(scope="module")
def sample():
    """Scores with ties of 12 persons."""
    rng = np.random.default_rng(4)
    person = np.repeat(np.arange(12), 20)
    event = rng.random(240) < 0.4
    return np.round(rng.normal(size=240) + event, 1), event, person


def test_area_is_mann_whitneys_share_of_pairs(sample):
    score, event, _ = sample
    (found,) = areas(sort_scores(*sample), np.ones((1, 12), dtype=int))
    expected = mannwhitneyu(score[event], score[~event]).statistic / (event.sum() * (~event).sum())
    assert found == pytest.approx(expected, rel=1e-12)
    assert np.trapezoid(*curve(score, event)[::-1]) == pytest.approx(expected, rel=1e-12)


def test_a_person_drawn_twice_counts_as_two(sample, monkeypatch):
    monkeypatch.setattr(roc, "AT_ONCE", 500)  # two samples at a time
    score, event, person = sample
    weights = np.random.default_rng(3).multinomial(12, np.full(12, 1 / 12), 5)
    for row, found in zip(weights, areas(sort_scores(*sample), weights), strict=True):
        drawn = np.repeat(np.arange(len(score)), row[person])
        high, low = score[drawn][event[drawn]], score[drawn][~event[drawn]]
        pairs = (high[:, None] > low).mean() + 0.5 * (high[:, None] == low).mean()
        assert found == pytest.approx(pairs, rel=1e-12)


def test_threshold_and_sensitivity_by_hand():
    score = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0])
    event = np.array([0, 0, 0, 1, 0, 1, 1, 1], dtype=bool)
    assert best_threshold(score, event) in (3.5, 5.5)
    assert sensitivity_at(score, event) == 0.75
    assert sensitivity_at(-score, event) == 0.0
    # Constant scores tell nobody; what no threshold improves is told of nobody.
    assert sensitivity_at(0 * score, event) == 0.0
    assert best_threshold(0 * score, event) == np.inf


def test_thresholds_of_other_persons_tell_what_normal_scores_allow():
    rng = np.random.default_rng(1)
    event = np.tile([True, False], 4000)
    score, person = rng.normal(size=8000) + 2 * event, np.repeat(np.arange(40), 200)
    assert cross_validated_rates(score, event, person, 5, [1]) == pytest.approx(
        (norm.cdf(1), norm.cdf(1)), abs=0.02
    )
    # A score that is nothing but the person's own cannot be learnt from others.
    assert cross_validated_rates(rng.normal(size=8000), event, person, 5, [1]) != pytest.approx(
        (1.0, 1.0), abs=0.4
    )


def test_the_interval_is_students_for_a_mean_and_within_0_and_1_for_a_share():
    values = np.random.default_rng(2).normal(size=9)
    parts = (values.sum() - values) / 8
    low, high = jackknife_interval(values.mean(), parts)
    assert (low, high) == pytest.approx(t.interval(0.95, 8, values.mean(), sem(values)))
    low, high = area_interval(0.95, np.linspace(0.9, 0.99, 9))
    assert 0 < low < 0.95 < high < 1
    assert area_interval(1.0, np.ones(9)) is None  # all pairs ordered rightly: how surely is not known
