"""A verdict does not depend on units: another clock, other units of motion and force, both inverted, records in another order.

By convention, a contact pushes and does not pull, growth with depth is growth with position, and a sensor of the absolute value
gives no negative one: these three cannot be inverted.
"""

from dataclasses import replace

import pytest
from diagnosing import diagnose
from effect_entries import FORM_NUMBERS, records_of_effect
from force_driven import FORCE_IN, forward_records

import lumbar
from other_units import FAST, SLOW, Units, check_alike
from pendulum_experiments import EFFECTS, make_pendulum_experiment, records_of

ONE_SIDED = ("contact_loss/sharp", "contact_loss/soft", "depth_dependent_damping/one_sided")
ONE_SIDED += ("depth_dependent_damping/hunt_crossley",)


UNITS = {"slow": SLOW, "fast": FAST}


def alternate(keys, step):
    """Return every key with both systems of units; by night every `step`-th key has one of them, in turn."""
    for number, key in enumerate(keys):
        for name, units in UNITS.items():
            is_tried = number % step == 0 and (number // step % 2 == 0) == (name == "slow")
            marks = pytest.mark.nightly if is_tried else pytest.mark.acceptance
            yield pytest.param(key, units, marks=marks, id=f"{key}-{name}")


def diagnose_tissue(records, train):
    return diagnose(records, train=train)


def diagnose_pendulum(records, train):
    return diagnose(records, "pendulum", train)


def diagnose_forward(records, train):
    return lumbar.diagnose(records, train=train, settings=FORCE_IN).result


def test_verdict_is_invariant_to_units():
    result = check_alike(diagnose_tissue, records_of_effect("coulomb_friction/coulomb"), SLOW)
    assert (result.status, result.selected) == ("named", ("coulomb_friction",))


@pytest.mark.parametrize(("key", "units"), alternate(FORM_NUMBERS, 7))
def test_every_form_is_invariant_to_units(key, units):
    check_alike(
        diagnose_tissue, records_of_effect(key), replace(units, turned=units.turned and key not in ONE_SIDED)
    )


@pytest.mark.parametrize(
    ("effect", "units"),
    alternate(["nothing", "coulomb_friction", "hardening_stiffness", "quadratic_damping"], 2),
)
def test_forward_diagnosis_is_invariant_to_units(effect, units):
    check_alike(diagnose_forward, forward_records(effect), units)


@pytest.mark.parametrize(
    ("effect", "columns"),
    [
        pytest.param(
            effect,
            columns,
            marks=pytest.mark.nightly
            if number % 3 == 0 and columns == bool(number % 2)
            else pytest.mark.acceptance,
        )
        for number, effect in enumerate(["", *EFFECTS])
        for columns in (True, False)
    ],
)
def test_pendulum_is_invariant_to_units_of_moment(effect, columns):
    """The angle has no unit, and g, which is known, holds the clock: only moments, signs and order can change.

    The parameters of passive stiffness have the names of their sides.
    """
    experiment = make_pendulum_experiment(effect, 0, columns=columns)
    units = Units(force=1e6, turned=effect != "passive_stiffness", otherwise=True)
    check_alike(diagnose_pendulum, records_of(experiment.records), units)
