"""Operators with memory and general forms against brute force, differential equations and closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from periodic_records import record

from lumbar.tissue.diagnosis.fitting.joint_fit import fit_base
from lumbar.tissue.diagnosis.fitting.preparation import Experiment, prepare
from lumbar.tissue.diagnosis.selection.candidate import Candidate, evaluate
from lumbar.tissue.diagnosis.selection.forward_selection import extend
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.operators import (
    bouc_wen,
    bouc_wen_general,
    elastoplastic,
    play,
    presliding,
    relaxation,
)
from lumbar.tissue.models.structure import Structure

STEP = 0.01


def wandering(seed, samples=1500):
    random = np.random.default_rng(seed)
    time = np.arange(samples) * STEP
    lines = random.uniform(0.1, 4, 12)
    position = np.cos(2 * np.pi * np.outer(time, lines) + random.uniform(0, 6, 12)) @ (1 / lines)
    return Motion(time, position, STEP, smooth=False)


def test_reversals_skip_rests():
    motion = Motion(np.arange(8) * STEP, np.array([0.0, 1, 1, 2, 2, 1, 0, 1]), STEP, smooth=False)
    assert motion.reversals.tolist() == [0, 4, 6, 7]
    assert motion.stretch.tolist() == [0, 0, 0, 0, 1, 1, 2, 2]


FINE = 50
"""Steps between two samples of a motion that is known finely."""


def band_limited(seed: int, fastest: float = 5.0) -> tuple[Motion, Motion]:
    """A motion up to 5 Hz as a sensor samples it, and in fine steps."""
    random = np.random.default_rng(seed)
    lines, phases = random.uniform(0.1, fastest, 12), random.uniform(0, 6, 12)
    time = np.arange(1 + 1499 * FINE) * STEP / FINE
    position = np.cos(2 * np.pi * np.outer(time, lines) + phases).sum(axis=1)
    sampled = Motion(time[::FINE], position[::FINE], STEP)
    return sampled, Motion(time, position, STEP / FINE, smooth=False)


OPERATORS = {
    "play": lambda motion: play(motion, 0.4),
    "presliding": lambda motion: presliding(motion, 0.3),
    "bouc_wen": lambda motion: bouc_wen(motion, 0.3),
    "bouc_wen_general": lambda motion: bouc_wen_general(motion, 0.3, 0.8),
    "elastoplastic": lambda motion: elastoplastic(motion, 0.3),
}


@pytest.mark.parametrize("name", OPERATORS)
@pytest.mark.parametrize("seed", range(3))
def test_a_smooth_motion_turns_between_its_samples(name, seed):
    sampled, fine = band_limited(seed)
    truth = OPERATORS[name](fine)[::FINE]
    apart = Motion(sampled.time, sampled.position, STEP, smooth=False)
    within, without = (OPERATORS[name](motion) - truth for motion in (sampled, apart))
    assert np.abs(within).mean() < 0.05 * np.abs(without).mean()
    assert abs(within.mean()) < 1e-3 * np.abs(truth).mean()


def test_a_branch_behind_play_follows_what_moves_between_samples():
    sampled, fine = band_limited(3)
    truth = relaxation(Motion(fine.time, play(fine, 0.4), fine.sampling_time, smooth=False), 0.1)[::FINE]
    error = relaxation(sampled.through(lambda motion: play(motion, 0.4)), 0.1) - truth
    coarse = relaxation(Motion(sampled.time, play(sampled, 0.4), STEP, smooth=False), 0.1) - truth
    assert np.sqrt(np.mean(error**2)) < 0.3 * np.sqrt(np.mean(coarse**2))


def test_rests_and_corners_of_a_machine_are_no_turns_between_samples():
    ramps = np.concatenate([np.arange(50), np.full(30, 50.0), 50 - np.arange(50), np.arange(20)])
    motion = Motion(np.arange(len(ramps)) * STEP, ramps, STEP)
    np.testing.assert_allclose(motion.turns, ramps[motion.reversals], atol=1e-12)


FORMS = {form.name: form for name in ("hysteresis", "coulomb_friction") for form in TISSUE[name].forms}


def recorded(name: str, seed: int, form: str, linear: tuple[float, ...], nonlinear: tuple[float, ...]):
    """Four periods of a multisine of 3 mm on a spring and dashpot with a form of friction, noise of 0.01 N."""
    random, lines = np.random.default_rng(seed), np.arange(1, 50) / 10
    time = np.arange(0, 10, STEP)
    period = np.cos(2 * np.pi * np.outer(time, lines) + random.uniform(0, 6.28, len(lines))) @ lines**-0.7
    position = np.tile(3 * period / np.abs(period).max(), 4)
    motion = Motion(np.arange(len(position)) * STEP, position, STEP)
    tissue = Structure(BASES["KV"], (FORMS[form],))
    force = tissue.simulate(motion, np.array([0.8, 0.03, *linear]), np.array(nonlinear))
    force = force + 0.01 * random.standard_normal(len(force))
    return record(position, force, name)


def experiment_of(form: str, *nonlinear: float, linear: tuple[float, ...] = (0.6,)) -> Experiment:
    """Two records of a tissue with friction."""
    records = [recorded(name, seed, form, linear, nonlinear) for seed, name in enumerate(("train", "unseen"))]
    return prepare(records, "train")


def extended(experiment: Experiment, *names: str, effect: str = "hysteresis") -> list[Candidate]:
    """Spring and dashpot with these forms of an effect, or all, best first."""
    effect = TISSUE[effect]
    if names:
        forms = tuple(replace(FORMS[name], general=len(names) > 1 and FORMS[name].general) for name in names)
        effect = replace(effect, forms=forms)
    base = evaluate(fit_base(Structure(BASES["KV"]), experiment.training), experiment)
    return extend(base, {effect.name: effect}, experiment)


def test_the_loop_of_the_benchmark_is_found_with_its_parameters():
    """w = (γ − δ)/2γ = 1.1875 for γ = 0.8, δ = −1.1, beyond what a quadratic energy admits."""
    experiment = experiment_of("bouc_wen_general", 0.6, 1.1875)
    best = extended(experiment)[0]
    assert best.fit.structure.forms[0].name == "bouc_wen_general"
    assert best.fit.nonlinear == pytest.approx([0.6, 1.1875], rel=0.03)
    assert best.fit.linear == pytest.approx([0.8, 0.03, 0.6], rel=0.1)
    assert best.test_rms < 1.1 * experiment.floor.rms


@pytest.mark.parametrize("form", ["dahl", "bouc_wen"])
def test_a_simple_loop_is_not_generalised(form):
    found = extended(experiment_of(form, 0.6))
    assert found[0].fit.structure.forms[0].name == form
    assert all(not item.fit.structure.forms[0].general for item in found)


def test_a_general_loop_that_removes_less_than_half_of_the_rest_is_not_taken():
    """Of an elastoplastic loop it leaves less than Dahl's, as any curve with a parameter more."""
    experiment = experiment_of("elastoplastic", 0.6)
    simple, general = (extended(experiment, name)[0] for name in ("dahl", "bouc_wen_general"))
    noise = experiment.floor.rms
    assert (
        0.5 * (simple.train_rms**2 - noise**2) + noise**2 < general.train_rms**2 < 0.95 * simple.train_rms**2
    )
    assert {
        item.fit.structure.forms[0].name for item in extended(experiment, "dahl", "bouc_wen_general")
    } == {"dahl"}


def test_stribecks_friction_is_taken_where_breaking_away_shows():
    weak = extended(experiment_of("coulomb", 0.5), effect="coulomb_friction")
    assert weak[0].fit.structure.forms[0].name == "coulomb"
    assert all(not item.fit.structure.forms[0].general for item in weak)
    experiment = experiment_of("stribeck", 0.5, 8.0, linear=(0.5, 0.5))
    best = extended(experiment, effect="coulomb_friction")[0]
    assert best.fit.structure.forms[0].name == "stribeck"
    assert best.fit.linear[2:] == pytest.approx([0.5, 0.5], rel=0.1)
