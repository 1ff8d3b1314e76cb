"""What counts as adequate where nothing repeats, and a second effect beside one that dwarfs it."""

from __future__ import annotations

import numpy as np
import pytest
from fine_tissue import FINE, branch, sampled, sines
from periodic_records import noise

from lumbar.tissue.diagnosis.selection.diagnose import diagnose


def single_shots(force, sigma: float = 0.01, seconds: float = 18.0) -> list:
    """Two records, in neither of which anything repeats; `force` from time, position, speed and the record's number."""
    made = []
    for seed, name in enumerate(("first", "second")):
        time, position, speed = sines(seed, seconds, 0.02, 4.0, 0.0417 + 0.003 * seed)
        made.append(sampled(name, 0.02, position, force(time, position, speed, seed), sigma, seed))
    return made


@pytest.mark.parametrize("pole", [0.0, 0.9], ids=["white", "coloured"])
def test_a_model_that_explains_next_to_nothing_is_not_adequate(pole):
    def foreign(time, position, speed, seed):
        return 0.02 * position + np.repeat(noise(len(time) // FINE, seed + 40, pole), FINE)

    found = diagnose(single_shots(foreign))
    explained = 1 - (found.base.test_rms / np.std(found.experiment.tests[0].force)) ** 2
    assert explained < 0.05
    assert found.experiment.floor is None
    assert (found.verdict, found.selected) == ("unexplained", ())
    assert found.complete is None


def test_without_a_noise_floor_the_right_model_is_adequate():
    def relaxing(time, position, speed, seed):
        return 1.2 * position + 0.8 * branch(position, 0.3, 0.02)

    found = diagnose(single_shots(relaxing))
    assert found.experiment.floor is None
    assert (found.verdict, found.selected) == ("adequate", ())


def test_a_second_effect_beside_one_that_dwarfs_it_is_found():
    """Inertia leaves the base 300 times the noise, dry friction 8 times: a share of the base's error would hide it."""
    made = []
    for seed, (name, slowest, seconds) in enumerate((("multisine", 0.25, 16), ("other", 0.261, 8))):
        time, position, speed = sines(seed, seconds, 0.01, 12.0, slowest)
        force = 1.2 * position + 0.02 * speed + 0.09 * np.tanh(speed / 2)
        force = force + 1.4e-3 * np.gradient(speed, time)
        made.append(sampled(name, 0.01, position, force, 0.01, seed))
    found = diagnose(made)
    assert found.base.test_rms > 100 * 0.01
    assert set(found.selected) == {"inertia", "coulomb_friction"}
    assert found.complete
    assert found.model.test_rms == pytest.approx(0.01, rel=0.1)


def test_the_part_of_a_single_record_that_is_held_back_goes_on_where_the_first_one_ends():
    """A spring that wears with the path: a clock that began anew would find it whole again."""
    _time, position, _ = sines(5, 40.0, 0.02, 3.0, 0.0417)
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(position)))])
    force = (1.5 - 0.5 * (1 - np.exp(-path / 150.0))) * position
    found = diagnose([sampled("only", 0.02, position, force, 0.02, 5)])
    (held_back,) = found.experiment.tests
    assert len(found.experiment.training.force) == 1400
    assert held_back.force.size >= 600
    assert (found.verdict, found.selected) == ("named", ("softening",))
    assert found.model.test_rms == pytest.approx(0.02, rel=0.1)
    wear = {item.name: item for item in found.ranking[0].estimates}
    assert {"stiffness_lost", "share_lost"} & set(wear)  # of a spring alone they are the same
    assert wear["path_constant"].low < 150.0 < wear["path_constant"].high
