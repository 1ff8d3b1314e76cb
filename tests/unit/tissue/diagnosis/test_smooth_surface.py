"""A surface stands in where no short law comes near: judged unseen, guarded beyond, exported; never made of noise."""

import json
from dataclasses import replace

import numpy as np
import pytest
from runtime_models import SETTINGS, held_to_its_simulation, selected
from test_law_proposal import FEW, error, experiment, lateral, nothing, sines, terms

from lumbar.tissue.diagnosis.law.proposal import propose, surface_model
from lumbar.tissue.diagnosis.law.spline import NAME, smooth_surfaces
from lumbar.tissue.diagnosis.selection.refine import refined_document
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.effects.notation import carried_effects
from lumbar.tissue.models.motion import Motion
from study_settings import changed


def two_steps(position, velocity):
    """Two layers that give way one after the other: in no catalogue and no library of terms."""
    return 0.5 * np.tanh((position - 1.2) / 0.25) + 0.35 * np.tanh((position + 1.5) / 0.2)


def lopsided(position, velocity):
    """A force of position and velocity that is no product of short factors."""
    return 0.3 * np.tanh((velocity - 4 * np.sin(position)) / 6)


@pytest.fixture(scope="module")
def stepped():
    prepared, base = experiment(two_steps)
    return propose(prepared, base, terms=terms(*FEW))


@pytest.fixture(scope="module")
def refined(stepped):
    """``refined.json`` of the model with the surface, as a file would hold it."""
    model = surface_model(stepped, "steps")
    return json.loads(json.dumps(refined_document([model], stepped.experiment, "steps")))


def carried(content):
    """The model to export, its effect from the file."""
    catalogue = {**TISSUE, **carried_effects(content, TISSUE)}
    return selected(
        content,
        changed(SETTINGS, models=[f"KB+{NAME}"], estimator="output_error", trained_on="long"),
        catalogue,
    )[0]


def test_a_law_of_no_catalogue_becomes_a_surface_near_the_floor(stepped):
    floor = stepped.experiment.floor.rms
    assert stepped.is_surface
    assert stepped.base.test_rms > 8 * floor
    assert stepped.law.candidate.test_rms < 1.2 * floor
    assert error(stepped.law.fit, sines(10, 50, even=False), two_steps) < 1.3
    first = stepped.sentences[0]
    assert "smooth surface, no mechanism" in first and "KB+smooth_surface" in first


def test_it_goes_on_as_it_ends_beyond_the_data(stepped):
    """A ramp far beyond: the base's own spring alone adds to it there."""
    time = np.linspace(0, 100, 10001)
    far = np.linspace(0, 20, len(time))
    with_it, without = stepped.law.fit, stepped.base.fit
    structure = with_it.structure
    (form,) = structure.forms
    added = np.stack(form.columns(Motion(time, far, time[1]), np.zeros(0)), axis=1)
    added = added @ with_it.linear[len(without.linear) :]
    assert np.ptp(added[far > 5]) < 1e-12
    assert np.ptp(added[far < 3]) > 0.3
    assert error(with_it, sines(10, 51, size=6.0, even=False), two_steps) < 0.5 * error(
        without, sines(10, 51, size=6.0, even=False), two_steps
    )


def test_files_of_models_carry_it(refined, stepped):
    (entry,) = refined["models"]
    assert entry["name"] == f"KB+{NAME}"
    assert refined["effects"][NAME]["mechanism"].endswith("held constant beyond the data.")
    model = carried(refined)
    walk = np.cumsum(np.random.default_rng(2).standard_normal(500)) * 0.2
    motion = Motion(0.01 * np.arange(500), walk, 0.01)
    expected = stepped.law.fit.simulate(motion) - stepped.law.fit.zero
    assert model.dynamics.response(walk) == pytest.approx(expected, abs=0.02 * np.ptp(expected))


def test_an_fmu_plays_it(refined, zig_cache, tmp_path):
    model = carried(refined)
    held_to_its_simulation(model, tmp_path, zig_cache)


@pytest.mark.parametrize("hidden", [nothing, lateral])
def test_none_is_made_of_noise_or_of_what_does_not_follow_the_motion(hidden):
    prepared, base = experiment(hidden)
    found = propose(prepared, base, terms=terms(*FEW))
    assert found.law is None and surface_model(found) is None


def test_over_position_and_velocity_only_amplitudes_with_samples_are_there():
    prepared, base = experiment(lopsided)
    best = smooth_surfaces(base, prepared)[0]
    assert "position and velocity" in best.terms[0].words
    assert best.candidate.test_rms < 0.5 * base.test_rms
    (form,) = best.fit.structure.forms
    short = replace(prepared, training=prepared.training.split(0.6)[0])
    fewer = {len(law.fit.structure.forms[0].linear) for law in smooth_surfaces(base, short)}
    assert len(form.linear) <= 11 * 5 and min(fewer) == 7
