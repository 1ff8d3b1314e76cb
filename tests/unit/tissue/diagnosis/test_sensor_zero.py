"""Force sensors whose zero is off: it is found, told, and never taken for physics."""

from __future__ import annotations

import numpy as np
import pytest
from fine_tissue import branch, experiment

from lumbar.tissue.diagnosis.fitting.uncertainty import zero_interval
from lumbar.tissue.diagnosis.selection.diagnose import diagnose
from lumbar.tissue.diagnosis.selection.refine import fitted_model


def relaxing(time, position, speed, step):
    return 1.2 * position + 0.8 * branch(position, 0.3, step)


def hardening(time, position, speed, step):
    return relaxing(time, position, speed, step) + 0.03 * position**3


def said(found) -> list:
    return [(item.record, item.value) for item in found.findings if item.kind == "force_offset"]


@pytest.mark.parametrize(
    ("tissue", "effects"),
    [(relaxing, ()), (hardening, ("hardening_stiffness",))],
    ids=["linear", "hardening"],
)
@pytest.mark.parametrize("zero", [0.5, 0.1])
def test_a_zero_hides_no_effect_and_is_none(tissue, effects, zero):
    found = diagnose(experiment(tissue, zeros=(zero, zero)))
    assert found.selected == effects
    assert found.verdict == ("named" if effects else "adequate")
    low, high = zero_interval(found.model.fit, found.experiment.training)
    assert low < zero < high
    assert high - low < 0.01
    model = fitted_model(found.model, found.experiment)
    assert model.output.offset == pytest.approx(zero, abs=0.005)
    told = [value for _, value in said(found)]
    assert told == ([pytest.approx(zero, abs=0.005)] if zero == 0.5 else [])


def test_records_may_have_zeros_of_their_own():
    found = diagnose(experiment(hardening, zeros=(0.3, -0.2)))
    assert (found.verdict, found.selected) == ("named", ("hardening_stiffness",))
    assert said(found) == [
        ("multisine", pytest.approx(0.3, abs=0.005)),
        ("other", pytest.approx(-0.2, abs=0.005)),
    ]
    assert "it moved between the records" in found.findings[1].sentence
    assert found.model.test_rms == pytest.approx(0.01, rel=0.1)


def test_a_position_zero_beside_friction_is_no_drift():
    """The position is read 3 mm aside: spring stiffness times that is a constant in the force."""

    def rubbing(time, position, speed, step):
        return relaxing(time, position, speed, step) + 0.45 * np.tanh(speed / 0.4) + 1.2 * 3.0

    found = diagnose(experiment(rubbing))
    assert (found.verdict, found.selected) == ("named", ("coulomb_friction",))
    assert found.model.fit.zero == pytest.approx(3.6, abs=0.01)
