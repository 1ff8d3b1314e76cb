"""Parts of a selection: base, order of candidates, thresholds of null experiments, shares and zeros."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosing import diagnose_few
from fine_tissue import FINE, branch, experiment
from periodic_records import multisine, noise, record, relaxing_force

import lumbar
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import add, fit_base
from lumbar.tissue.diagnosis.fitting.preparation import Experiment, prepare
from lumbar.tissue.diagnosis.selection.alternatives import apparent_zeros
from lumbar.tissue.diagnosis.selection.base_choice import better_base, find_base
from lumbar.tissue.diagnosis.selection.candidate import Candidate, evaluate, sort_by_score
from lumbar.tissue.diagnosis.selection.diagnosis_steps import diagnose
from lumbar.tissue.diagnosis.selection.forward_selection import Selection
from lumbar.tissue.diagnosis.selection.refine import refine
from lumbar.tissue.diagnosis.selection.thresholds import (
    TIED,
    NullDistribution,
    null_distribution,
    number_of_forms,
)
from lumbar.tissue.effects.catalogue import CATALOGUES, PENDULUM, TISSUE
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.structure import Structure
from pendulum_experiments import make_pendulum_experiment, records_of


def test_fast_relaxation_is_fitted():
    """At 5 kHz a relaxation time of 1 ms is five samples; it must not rest on a bound of 8 ms."""
    relaxation = 0.001

    def fast(time, position, speed, step):
        return 1.2 * position + 0.8 * branch(position, relaxation, step)

    prepared = prepare(experiment(fast, step=2e-4, fastest=200.0, seconds=(8, 4)))
    _, base = find_base(prepared, "auto", {})
    assert base.fit.structure.base.name == "KB"
    assert base.fit.nonlinear[0] == pytest.approx(relaxation, rel=0.01)
    assert base.fit.linear == pytest.approx([1.2, 0.8], rel=0.01)
    assert base.test_rms == pytest.approx(0.01, rel=0.05)


MASS, DAMPING, LAG = 0.02, 0.2, 0.012


def moved_mass(ripple: float) -> tuple[Experiment, Candidate]:
    """A mass on a spring and a dashpot that lags, with a ripple of the position; fitted with a dashpot that does not."""

    def force(time, position, speed, step):
        carried = MASS * np.gradient(speed, step / FINE) + 1.2 * position
        return carried + (DAMPING / LAG) * branch(position, LAG, step) + ripple * np.sin(4 * position)

    prepared = prepare(experiment(force))
    bare = fit_base(Structure(BASES["KV"]), prepared.training)
    return prepared, evaluate(add(bare, TISSUE["inertia"].forms[0], prepared.training), prepared)


def test_branch_replaces_dashpot_if_it_explains_the_rest():
    prepared, model = moved_mass(ripple=0.0)
    assert better_base(model, prepared) == "KB"


def test_branch_that_explains_little_does_not_replace_dashpot():
    """Its likelihood is larger, but both leave a ripple; with a dashpot the mass is that of slow motion, m − bτ."""
    prepared, model = moved_mass(ripple=0.3)
    bare = fit_base(Structure(BASES["KB"]), prepared.training)
    rival = evaluate(add(bare, TISSUE["inertia"].forms[0], prepared.training), prepared)
    assert rival.score < model.score - TIED
    assert better_base(model, prepared) is None
    assert model.fit.linear[2] == pytest.approx(MASS - DAMPING * LAG, rel=0.1)


@pytest.mark.parametrize("sign", [-1, 1])
def test_equal_scores_are_ordered_by_name(sign):
    scores = (-1000.0 + sign * 1e-5, -1000.0, -1000.5)
    candidates = [
        SimpleNamespace(score=score, effects=(name,)) for score, name in zip(scores, "bac", strict=True)
    ]
    result = sort_by_score(candidates)
    assert [item.effects[0] for item in result] == ["c", "a", "b"]


@pytest.fixture(scope="module")
def result():
    """Diagnosis of Coulomb friction with noise of 0.05."""
    records = []
    for name, seed in (("multisine", 0), ("other", 3)):
        position = multisine(8, seed=seed)
        force = relaxing_force(position) + 0.4 * np.sign(np.gradient(position))
        records.append(record(position, force + 0.05 * noise(len(position), seed + 20), name))
    return diagnose_few(records, train="multisine", most_effects=1)


def test_removed_share_refers_to_base_error(result):
    """If the noise is unknown, nothing is subtracted."""
    settings = DiagnosisSettings(catalogue=TISSUE)
    known = Selection(result.experiment, result.base, settings, singles=[])
    blind = Selection(replace(result.experiment, floor=None), result.base, settings, singles=[])
    before, after, floor = result.base.test_rms, result.model.test_rms, result.experiment.noise
    assert blind.share_removed(result.model) == pytest.approx(1 - after**2 / before**2)
    assert known.share_removed(result.model) == pytest.approx((before**2 - after**2) / (before**2 - floor**2))


def test_fit_without_convergence_names_nothing(result):
    stopped = replace(result.model, fit=replace(result.model.fit, converged=False))
    selection = Selection(result.experiment, result.base, DiagnosisSettings(catalogue=TISSUE), singles=[])
    assert selection.status(stopped, [], 0.99) == "unexplained"
    selection.selected_path = [result.base, stopped]
    settled = selection.fitted_path()[-1]
    assert settled.fit.converged and settled.test_rms == pytest.approx(result.model.test_rms, rel=1e-6)


def judged(*errors: np.ndarray):
    """A verdict whose model leaves these errors of unseen records, its own zero at 1."""
    tests = []
    for number, error in enumerate(errors):
        motion = Motion(0.01 * np.arange(len(error)), np.zeros(len(error)), 0.01)
        tests.append(FitData(f"unseen_{number}", motion, error, settling=50, has_own_zero=True))
    fit = SimpleNamespace(zero=1.0, simulate=lambda motion: np.zeros(len(motion)))
    training = SimpleNamespace(name="training")
    return SimpleNamespace(
        model=SimpleNamespace(fit=fit, test_rms=0.1),
        experiment=SimpleNamespace(
            tests=tests, training=training, output_unit="N", noise=0.1, test_data="unseen records"
        ),
    )


def test_moved_zero_is_found_from_start_of_record():
    white = 0.1 * np.random.default_rng(1).standard_normal((2, 1000))
    moved = judged(white[0] + 0.5, white[1] - 0.3)
    assert apparent_zeros(moved) is None
    crept = np.minimum(np.arange(1000) / 300, 1.0)
    rate = judged(white[0] + 0.5 * crept, white[1] - 0.3 * crept)
    finding = apparent_zeros(rate)
    assert (finding.kind, finding.value, finding.unit) == ("apparent_zeros", 1.0, "N")


def test_p_values_follow_null_table():
    table = NullDistribution(np.sort(np.random.default_rng(1).chisquare(2, 2000)), 28)
    assert table.p_value(-1.0) == 1.0
    assert table.p_value(np.log(2) * 2) == pytest.approx(0.5, abs=0.04)
    assert table.p_value(40.0) == pytest.approx(np.exp(-20), rel=0.5)
    assert table.p_value(10.0, forms=56) == pytest.approx(2 * table.p_value(10.0))
    assert len(null_distribution().ratios) >= 200
    for system, catalogue in CATALOGUES.items():
        # Of candidates that have come since, the probability grows in proportion.
        assert 0.9 <= null_distribution(system).forms / number_of_forms(catalogue) <= 1


@pytest.mark.parametrize(("floors", "after"), [(1.05, "adequate"), (1.15, "adequate"), (1.30, "unexplained")])
def test_completeness_follows_status_of_refined_model(floors, after):
    """A refined model whose unseen error is a given number of noise floors, and a catalogue without further effects."""

    def stiffening(position):
        return 0.6 * position + 0.01 * position**3

    catalogue = {"hardening_stiffness": TISSUE["hardening_stiffness"]}
    records = []
    for seed, name in enumerate("ab"):
        position = multisine(8, seed=seed)
        records.append(record(position, stiffening(position) + 0.01 * noise(len(position), seed + 20), name))
    settings = DiagnosisSettings(base="LE", catalogue=catalogue)
    floor = prepare(records).floor.rms
    # A force that follows the motion: noise of any colour would not count.
    other = np.sign(np.gradient(records[1]["input"])) * np.sqrt(floors**2 - 1) * floor
    disturbed = records[1].with_values(output=records[1]["output"] + other)
    result = diagnose([records[0], disturbed], settings)
    assert result.model.test_rms / result.experiment.floor.rms == pytest.approx(floors, abs=0.03)
    assert (result.refined_status, result.complete, result.further) == (after, after == "adequate", None)


def test_refine_rejects_effect_without_its_channel():
    measured = replace(PENDULUM["variable_length"], forms=PENDULUM["variable_length"].forms[:2])
    settings = DiagnosisSettings(base="pendulum", catalogue={"variable_length": measured})
    records = records_of(make_pendulum_experiment("drag", 0).records)
    with pytest.raises(lumbar.InputError, match=r"^variable_length .*\blength$"):
        refine(records, ["variable_length"], settings)
