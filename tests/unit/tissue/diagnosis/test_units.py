"""A verdict hangs on no unit: another clock, other units of motion and force, both turned round, records in another order.

Three things cannot be turned round, by convention: a contact pushes and does not pull, what grows with depth grows where the
position does, and a sensor that gives the absolute value gives no negative one.
"""

from dataclasses import replace

import numpy as np
import pytest
from effect_entries import FORM_NUMBERS, effect_entry
from force_driven import FORCE_IN, forward_records

import lumbar
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.selection.diagnose import diagnose
from lumbar.tissue.effects.catalogue import catalogues_with
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.twin.examples import example_records
from other_units import FAST, SLOW, Units, check_alike
from pendulum_experiments import EFFECTS, make_pendulum_experiment, records_of

ONE_SIDED = ("contact_loss/sharp", "contact_loss/soft", "depth_dependent_damping/one_sided")
ONE_SIDED += ("depth_dependent_damping/hunt_crossley",)


def of_tissue(records, train):
    return diagnose(records, DiagnosisSettings(train=train))


def of_pendulum(records, train):
    return diagnose(records, DiagnosisSettings("pendulum", train))


def of_forward(records, train):
    return lumbar.diagnose(records, train=train, settings=FORCE_IN).result


def hidden(key: str) -> list:
    """The example's motions on a Kelvin–Boltzmann tissue with one effect, and noise of 0.01 N."""
    model = FittedModel.from_json(effect_entry("KB", key), catalogues_with([]))
    random = np.random.default_rng(50)
    records = []
    for record in example_records():
        force = model.simulate(record)
        records.append(record.with_values(output=force + 0.01 * random.standard_normal(len(force))))
    return records


@pytest.mark.parametrize("key", ["hardening_stiffness/power", "coulomb_friction/coulomb"])
def test_the_verdict_is_the_same_in_other_units(key):
    found = check_alike(of_tissue, hidden(key), SLOW)
    assert (found.status, found.selected) == ("named", (key.split("/")[0],))


@pytest.mark.nightly
@pytest.mark.parametrize("units", [SLOW, FAST], ids=["slow", "fast"])
@pytest.mark.parametrize("key", FORM_NUMBERS)
def test_every_form_of_the_catalogue_is_the_same_in_other_units(key, units):
    check_alike(of_tissue, hidden(key), replace(units, turned=units.turned and key not in ONE_SIDED))


@pytest.mark.nightly
@pytest.mark.parametrize("units", [SLOW, FAST], ids=["slow", "fast"])
@pytest.mark.parametrize(
    "effect", ["nothing", "coulomb_friction", "hardening_stiffness", "quadratic_damping"]
)
def test_records_that_the_force_drove_are_the_same_in_other_units(effect, units):
    check_alike(of_forward, forward_records(effect), units)


@pytest.mark.nightly
@pytest.mark.parametrize("columns", [True, False], ids=["measured", "angle_alone"])
@pytest.mark.parametrize("effect", ["", *EFFECTS])
def test_a_pendulum_is_the_same_in_other_units_of_moment(effect, columns):
    """The angle has no unit, and g, which is known, holds the clock: only moments, signs and order can change.

    The parameters of passive stiffness have the names of their sides.
    """
    experiment = make_pendulum_experiment(effect, 0, columns=columns)
    units = Units(force=1e6, turned=effect != "passive_stiffness", otherwise=True)
    check_alike(of_pendulum, records_of(experiment.records), units)
