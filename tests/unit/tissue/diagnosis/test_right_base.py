"""The right base and origin: no effect does the work of a spring, a dashpot or another law about a prestrain."""

import numpy as np
import pytest
from fine_tissue import FINE, branch, experiment, sampled

from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.preparation import choose_training, prepare
from lumbar.tissue.diagnosis.selection.candidate import Candidate, add_form, contradictions, fit_base
from lumbar.tissue.diagnosis.selection.diagnosis_steps import diagnose
from lumbar.tissue.diagnosis.selection.forward_selection import Selection
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.models.bases import BASES

STEP, PRESTRAIN = 0.02, 9.0


def kelvin_boltzmann(position, step, spring=0.3):
    return spring * position + 0.5 * branch(position, 0.3, step)


def prestrained(added, seconds=(40, 20, 20, 20), frequencies=(0.1, 0.4, 1.5, 3.0)):
    """Sines about one prestrain, at rest before; `added` is a force of position and step."""
    records = []
    for seed, (duration, frequency) in enumerate(zip(seconds, frequencies, strict=True)):
        time = np.arange(round(duration / STEP) * FINE) * STEP / FINE
        position = PRESTRAIN + 2.0 * np.sin(2 * np.pi * frequency * time + seed)
        force = kelvin_boltzmann(position, STEP) + added(position, STEP)
        records.append(sampled(f"f{frequency:g}", STEP, position, force, 0.01, seed))
    return records


@pytest.mark.statistical
def test_dashpot_is_not_tied_with_a_form_that_reduces_to_it():
    result = diagnose(experiment(lambda time, x, v, step: kelvin_boltzmann(x, step) + 0.02 * v))
    assert (result.status, result.selected, result.tied_with) == ("named", ("viscous_damping",), [])
    assert not any("depth_dependent_damping" in item.candidate.effects for item in result.ranking)


@pytest.mark.statistical
def test_friction_is_named_with_the_spring_of_the_tissue():
    """All positions are on one side of 0: with the branch alone a law of position would do the work of the spring."""

    def rubbing(time, position, speed, step):
        moved = position - position.mean() + 6.0
        return kelvin_boltzmann(moved, step) + 0.02 * speed + 0.4 * np.tanh(speed / 0.05)

    result = diagnose(experiment(rubbing, noise=0.02))
    assert set(result.selected) == {"coulomb_friction", "viscous_damping"}
    assert (result.status, result.base.fit.structure.base.name) == ("named", "KB")


def test_law_that_is_a_straight_line_here_is_contradicted():
    """|z| with z of one sign is the spring that the branch lacks."""
    records = experiment(lambda time, x, v, step: kelvin_boltzmann(x, step))
    for item in records:
        item["input"][:] += 8.0
    prepared = prepare(records)
    base = fit_base(BASES["Maxwell"], prepared)
    two_sided = next(form for form in TISSUE["quadratic_stiffness"].forms if form.name == "two_sided")
    model = add_form(base, two_sided, prepared)
    assert model.fit.linear[1] == pytest.approx(0.3, rel=0.05)
    assert contradictions(model.fit, prepared)


@pytest.mark.statistical
@pytest.mark.parametrize(
    ("added", "hidden"),
    [
        (lambda position, step: 0.001 * position**3, "hardening_stiffness"),
        (lambda position, step: 4.0 * branch(position, 2.0, step), "second_relaxation"),
    ],
)
def test_sines_about_a_prestrain_show_the_effect(added, hidden):
    result = diagnose(prestrained(added))
    assert (result.status, result.selected) == ("named", (hidden,))


def test_sines_are_fitted_together_with_the_most_different_frequency():
    records = prestrained(lambda position, step: 0.0)
    chosen, unseen = choose_training(records, None)
    assert [item.name for item in chosen] == ["f0.1", "f3"]
    assert [item.name for item in unseen] == ["f0.4", "f1.5"]
    others = experiment(lambda time, x, v, step: x)
    assert [item.name for item in choose_training([*others, records[1]], None)[0]] == ["multisine"]


def clipped(fall: float) -> tuple[Candidate, object]:
    """A force that is clipped, and falls at times by `fall` (N) while the tool goes on."""

    def force(time, position, speed, step):
        whole = 1.2 * position + 0.5 * branch(position, 0.3, step)
        return np.clip(whole, -1.0, 1.0) - fall * ((position > 1.0) & (speed > 0))

    prepared = prepare(experiment(force))
    return add_form(fit_base(BASES["KB"], prepared), TISSUE["saturation"].forms[0], prepared), prepared


@pytest.mark.parametrize(("fall", "is_one_to_one"), [(0.0, True), (1.2, False)])
def test_force_that_falls_while_the_tool_goes_on_is_not_clipped(fall, is_one_to_one):
    model, prepared = clipped(fall)
    assert (not contradictions(model.fit, prepared)) is is_one_to_one


@pytest.mark.parametrize(("noise", "status"), [(0.002, "unexplained"), (0.5, "named")])
def test_part_of_a_rest_far_above_the_scatter_is_not_explained(noise, status):
    """Most of the error's variance is removed, and many times the scatter of neighbouring samples is left."""

    def rippled(time, position, speed, step):
        return 1.2 * position + 0.3 * position**3 + 0.5 * np.sin(5 * position)

    prepared = prepare(experiment(rippled, noise=noise, fastest=1.0, seconds=(3.8, 3.6)))
    assert prepared.floor is None
    base = fit_base(BASES["LE"], prepared)
    model = add_form(base, TISSUE["hardening_stiffness"].forms[0], prepared)
    selection = Selection(prepared, base, DiagnosisSettings(catalogue=TISSUE), singles=[model])
    assert selection.status(model, [], share=0.8) == status
    assert selection.status(model, [], share=0.99) == "named"
