"""Trials against the basin of a mean movement: made trials whose answer is known."""

from dataclasses import replace

import pytest
from lifting_cases import minimum_jerk, perturbation_settings

from lumbar.base.errors import InputError
from lumbar.lifting.stability.comparison.perturbed_trials import (
    PHASE_POINTS,
    Trial,
    compare_trials,
    funnels_of,
    inside_by_weight,
    mean_trajectory,
    relative_value,
    trials_table,
)
from lumbar.settings.stability import StabilitySettings
from study_settings import changed

SETTINGS = perturbation_settings(unperturbed=("u0", "u1", "u2", "u3"), perturbed=("far", "near"))
STABILITY = changed(StabilitySettings(), pendulum={"sign": "hanging"}, regulator={"control_weight": 0.03})


def trial(name, group, offset=0.0):
    item = minimum_jerk(samples=PHASE_POINTS)
    return Trial(name, group, item.duration, item.angle + offset, item.angular_velocity, 0.4)


@pytest.fixture(scope="module")
def trials():
    small = [trial(f"u{number}", "unperturbed", 0.01 * number) for number in range(4)]
    return [*small, trial("far", "perturbed", 0.6), trial("near", "perturbed", 0.02)]


def test_trials_near_the_mean_are_inside_and_far_ones_are_not(trials):
    rows = compare_trials(trials, SETTINGS, STABILITY).query("sign == 'hanging'").set_index("trial")
    assert (rows.loc[["u0", "u1", "u2", "u3", "near"], "whole_inside"] == "yes").all()
    assert rows.loc["far", "whole_inside"] == "no" and rows.loc["far", "share_inside"] < 0.5
    assert rows.loc["far", "largest_error_rad"] == pytest.approx(0.6 - 0.015, abs=1e-6)

    # 0, 0.01, 0.02 and 0.03 rad: the first is 0.02 from the mean of the other three.
    assert rows.loc["u0", "largest_error_rad"] == pytest.approx(0.02, abs=1e-6)


def test_value_is_the_quadratic_form(trials):
    mean = mean_trajectory(trials[:4], SETTINGS)
    funnel = funnels_of([mean], STABILITY.pendulum.sign, STABILITY)[0]
    edge = replace(trials[0], angle=mean.angle + 0.1, angular_velocity=mean.angular_velocity)
    value = relative_value(edge, mean, funnel)
    # At the end the ellipse is the goal set: ±0.1 rad.
    assert value[-1] == pytest.approx(1.0, abs=1e-9)
    assert value[0] == pytest.approx(0.01 * funnel.cost[0, 0, 0] / funnel.level[0, 0])
    assert mean.mass_kg == pytest.approx(47.46)


def test_table_says_what_is_seen_with_both_signs_and_other_weights(trials):
    frame, by_weight = (
        function(trials, SETTINGS, STABILITY) for function in (compare_trials, inside_by_weight)
    )
    counts = by_weight.set_index(["sign", "control_weight", "group"])["inside"]
    for sign in ("hanging", "inverted"):
        own = frame[(frame["sign"] == sign) & (frame["whole_inside"] == "yes")].groupby("group").size()
        for group in ("unperturbed", "perturbed"):
            assert counts[sign, 0.03, group] == own.get(group, 0)
    notes = trials_table(frame, by_weight, "no feedback", SETTINGS, STABILITY, "test").notes
    assert "Hanging, R = 0.03. Unperturbed: 4 of 4 trials lie inside" in notes[0]
    assert "Hanging, R = 0.03. Perturbed: 1 of 2 trials lie inside" in notes[1]
    assert notes[2].startswith("Inverted, R = 0.03. Unperturbed:")
    assert notes[6] == "no feedback" and notes[5].count("R = ") == 5


def test_too_few_unperturbed_trials_are_refused(trials):
    with pytest.raises(InputError, match="2 unperturbed trials; at least 3 are needed"):
        compare_trials(trials[2:], SETTINGS, STABILITY)
