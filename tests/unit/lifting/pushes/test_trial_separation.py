"""Repeated trials: measures of a made body by hand, exact p."""

import numpy as np
import pytest
from lifting_cases import perturbation_settings
from scipy.stats import mannwhitneyu

from lumbar.lifting.pushes.trial_separation import (
    BodyTrial,
    measures_of_trial,
    separation_frame,
    separation_table,
)

SETTINGS = perturbation_settings()


def test_a_body_that_drifts_forward_has_the_margins_of_the_formula():
    time = np.arange(101) / 100
    centre = np.stack([0.02 + 0.05 * time, np.full(101, 0.93)], axis=1)
    trunk = np.broadcast_to([0.1, 0.3], (101, 2))
    found = measures_of_trial(
        BodyTrial("t", "perturbed", 100.0, centre, trunk, -0.07, 0.18, 0.07, 1.0), SETTINGS
    )
    # Pendulum of the ankles' height and the centre's above them; functional base: 60 % of the way from its middle.
    at_end = 0.07 + 0.05 * np.sqrt(np.hypot(0.07, 1.0) / 9.81)
    assert found["margin_forward"] == pytest.approx(0.055 + 0.6 * 0.125 - at_end, abs=1e-9)
    assert found["margin_backward"] == pytest.approx(
        0.02 + 0.05 * np.sqrt(np.hypot(0.02, 1.0) / 9.81) - (0.055 - 0.6 * 0.125), abs=1e-9
    )
    assert found["trunk_inclination"] == pytest.approx(np.degrees(np.arctan2(0.1, 0.3)))
    assert found["hip_moment"] == pytest.approx(0.678 * 70 * 9.81 * 0.1, rel=1e-9)


def test_groups_are_compared_exactly_and_corrected():
    rng = np.random.default_rng(2)
    groups = ["unperturbed"] * 5 + ["perturbed"] * 5
    found = [
        {"basin": float(rng.random() + 3 * (group == "perturbed")), "duration": float(rng.random())}
        for group in groups
    ]
    frame = separation_frame(found, groups).set_index("measure")
    assert frame.loc["basin", "auc"] == 1.0
    assert frame.loc["basin", "p_exact"] == pytest.approx(2 / 252)
    assert frame.loc["basin", "p_holm"] == pytest.approx(4 / 252)
    first, second = (
        [item["duration"] for item, group in zip(found, groups, strict=True) if group == name]
        for name in ("perturbed", "unperturbed")
    )
    test = mannwhitneyu(first, second, method="exact")
    assert frame.loc["duration", ["auc", "p_exact", "p_holm"]].tolist() == pytest.approx(
        [test.statistic / 25, test.pvalue, test.pvalue]
    )
    notes = separation_table(frame.reset_index(), groups, "test").notes
    assert notes[0] == "basin separates all trials (5 unperturbed, 5 perturbed, one person)"
