"""A fitted model: what it converts to, what it prints, and that its file says the same again or what is wrong."""

import json
from dataclasses import replace

import control
import numpy as np
import periodic_records
import pytest
from effect_entries import BASE_NUMBERS, COMBINATIONS, effect_entry
from viscoelastic import discretise

from case_tables import cases
from lumbar.base.errors import InputError, NumericalError
from lumbar.records.record import Channel, Record
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.uncertainty import derived_estimates, estimates
from lumbar.tissue.diagnosis.selection.refine import refine
from lumbar.tissue.effects.catalogue import CATALOGUES
from lumbar.tissue.effects.signature import standard_motion
from lumbar.tissue.models.fitted_model import FittedModel, models_document, read_models
from lumbar.tissue.models.model_data import FittedParameter, Port, Scores
from lumbar.tissue.models.tissue_models import KB
from lumbar.tissue.models.transfer_function import FirstOrder, TransferFunction

T = 0.01
PORTS = Port("position", "mm", 3.0), Port("force", "N", -2.0)
DISCRETE = FittedModel(
    "KB",
    TransferFunction((1.9, -1.2), (1.0, -0.45)),
    T,
    *PORTS,
    base="KB",
    estimator="arx",
    trained_on="multisine",
    alpha=0.27,
    parameters=(
        FittedParameter("spring_stiffness", "k_e", "N/mm", 1.27, 1.2, 1.3),
        FittedParameter("k1", "k_1", "N/mm", 1.5, None, None, derived=True),
    ),
    scores=Scores(vaf_percent=81.2, tests=("noise", "tone"), nmse_tests=(0.2, None)),
    remark="largest alpha of the grid",
)


def read_model(base: str, *keys: str) -> FittedModel:
    return FittedModel.from_json(effect_entry(base, *keys), CATALOGUES)


def record(position, step=T, unit="mm") -> Record:
    time = step * np.arange(len(position))
    channels = {"input": Channel(position, "position", unit), "output": Channel(0 * position, "force", "N")}
    return Record("walk", time, channels)


def walk(samples=400) -> np.ndarray:
    motion = np.random.default_rng(5).standard_normal(samples + 30)
    return np.convolve(motion, np.hanning(25))[25 : samples + 25]


def tissue_records(spring=0.5, branch=3.0, relaxation=0.034) -> list[Record]:
    """Two records of a Kelvin–Boltzmann tissue with white noise of 2 %."""
    truth = discretise(FirstOrder.from_base(spring, branch, relaxation), T)
    records = []
    for name, seed in (("long", 1), ("other", 2)):
        rng = np.random.default_rng(seed)
        position = np.convolve(rng.standard_normal(2030), np.hanning(25))[25:2025]
        force = truth.simulate(position)
        force = force + 0.02 * force.std() * rng.standard_normal(len(force))
        records.append(periodic_records.record(position, force, name))
    return records


@pytest.mark.parametrize("base", ["LE", "Maxwell", "KB"])
def test_base_matches_its_transfer_function(base):
    """Against python-control's own simulation of the transfer function on a grid fifty times as fine."""
    model, fine = read_model(base), T / 50 * np.arange(200 * 50 + 1)
    position = np.sin(5 * fine) - 0.4 * np.sin(23 * fine)
    expected = control.forced_response(model.to_control(), fine, position).outputs[::50]
    result = model.simulate(record(position[::50]))
    np.testing.assert_allclose(result, expected, atol=2e-5 * np.abs(expected).max())
    assert model.to_state_space()(2j) == pytest.approx(model.to_control()(2j))


def test_improper_models_have_no_state_space():
    (spring, viscosity), _ = BASE_NUMBERS["KV"]
    s = 2j
    assert read_model("KV").to_control()(s) == pytest.approx(spring + viscosity * s)
    (inertia, damping, gravity), _ = BASE_NUMBERS["pendulum"]
    assert read_model("pendulum").to_control()(s) == pytest.approx(inertia * s**2 + damping * s + gravity)
    for base in ("KV", "pendulum"):
        with pytest.raises(NumericalError, match="improper"):
            read_model(base).to_state_space()


def test_a_discrete_model_is_the_same_in_all_its_forms():
    z = np.exp(1j * np.linspace(0.01, np.pi, 40))
    expected = (1.9 - 1.2 / z) / (1 - 0.45 / z)
    for system in (DISCRETE.to_control(), DISCRETE.to_state_space()):
        assert system.dt == T
        np.testing.assert_allclose(system(z), expected, rtol=1e-12)
    late = replace(DISCRETE, structure=TransferFunction((0.0, 0.3), (1.0, -0.35)))
    np.testing.assert_allclose(late.to_control()(z), 0.3 / z / (1 - 0.35 / z), rtol=1e-12)
    gain = replace(DISCRETE, structure=TransferFunction((-0.125,)))
    assert gain.to_state_space().nstates == 0
    zeros = replace(DISCRETE, structure=TransferFunction((1.0, 0.0, 0.0), (1.0, -0.5, 0.0)))
    assert zeros.to_state_space().nstates == 1
    assert gain.to_control()(z[3]) == -0.125


def test_effects_have_no_transfer_function():
    with pytest.raises(NumericalError, match=r"KB\+coulomb_friction: .*\(coulomb_friction\)"):
        read_model("KB", "coulomb_friction/coulomb").to_control()


def test_discrete_model_is_simulated_about_rest_at_its_rate():
    held = DISCRETE.simulate(record(np.full(50, 4.0)))
    np.testing.assert_allclose(held, -2.0 + 0.7 / 0.55)
    with pytest.raises(InputError, match=r"walk .*200 Hz.*\bKB .*100 Hz"):
        DISCRETE.simulate(record(walk(), step=0.005))
    with pytest.raises(InputError, match=r"walk: .*'m'.*\bKB .*'mm'"):
        DISCRETE.simulate(record(walk(), unit="m"))


MODELS = [DISCRETE, read_model("pendulum"), *(read_model(*item) for item in COMBINATIONS)]


@pytest.mark.parametrize("model", MODELS, ids=lambda item: item.name)
def test_written_content_is_read_again(model):
    content = json.loads(json.dumps(models_document([model], "synthetic twin", 0.1)))
    assert read_models(content, CATALOGUES) == [model]
    assert content["models"][0] == model.to_json()


@pytest.mark.parametrize(("change", "message"), cases(__file__, "wrong"))
def test_problems_of_models_file_name_their_place(change, message):
    content = models_document([DISCRETE], "test")
    content["models"][0] |= change
    with pytest.raises(InputError, match=message):
        read_models(json.loads(json.dumps(content)), CATALOGUES)


def test_given_constants_are_written_with_model():
    entry = effect_entry("LE", "hardening_stiffness/power")
    model = FittedModel.from_json(entry, CATALOGUES)
    assert "constants" not in model.to_json()["structure"]["effects"][0]
    entry["structure"]["effects"][0]["constants"] = {"z_1": 2.0}
    other = FittedModel.from_json(entry, CATALOGUES)
    assert other.to_json()["structure"]["effects"][0]["constants"] == {"z_1": 2.0}
    assert FittedModel.from_json(json.loads(json.dumps(other.to_json())), CATALOGUES) == other
    # Fn·sign(z)·|z/z_1|^n on one motion, which remembers forces of both.
    motion = standard_motion(1.0)
    here, there = (item.structure.forms[0].columns(motion, np.array([3.0]))[0] for item in (model, other))
    np.testing.assert_allclose(there, here / 2**3, atol=1e-12)
    total = [item.structure.simulate(motion, np.ones(2), np.array([3.0])) for item in (model, other)]
    np.testing.assert_allclose(total[0] - total[1], here - there, atol=1e-12)
    entry["structure"]["effects"][0]["constants"] = {"g": 1.6}
    with pytest.raises(InputError, match=r"structure\.effects\.hardening_stiffness: .*'g'.*\bz_1\b"):
        FittedModel.from_json(entry, CATALOGUES)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([], "schema: list"),
        (None, "schema: NoneType"),
        ({"schema": "lumbar.models/1", "models": []}, "schema: .*'lumbar.models/1'.*'lumbar.models/2'"),
        ({"schema": "lumbar.models/2"}, r"models: .*\bNone\b.*\blist\b"),
        ({"schema": "lumbar.models/2", "models": []}, r"models: .*\blist\b"),
        ({"schema": "lumbar.models/2", "models": [3]}, r"models\.0: .*\b3\b.*\bname, structure"),
    ],
)
def test_other_content_than_models_is_rejected(content, message):
    with pytest.raises(InputError, match=message):
        read_models(content, CATALOGUES)


def test_models_file_in_documentation_is_valid(project):
    text = (project / "docs" / "contracts.md").read_text(encoding="utf-8")
    example = text[text.index('{"schema": "lumbar.models/2"') :].split("```")[0]
    assert [model.name for model in read_models(json.loads(example), CATALOGUES)] == ["KB", "LE+drift"]


def test_parameter_is_found_by_name():
    model = read_model("KB", "coulomb_friction/coulomb")
    assert model["relaxation_time"].value == BASE_NUMBERS["KB"][1][0]
    assert model["coulomb_friction.coulomb_force"].effect == "coulomb_friction"
    with pytest.raises(
        InputError, match=r"KB\+coulomb_friction .*'tau'.*\bspring_stiffness.*\.coulomb_force"
    ):
        model["tau"]


def test_text_shows_equation_parameters_and_scores():
    assert "H(z) = (1.9 - 1.2 z^-1)/(1 - 0.45 z^-1), 100 Hz" in str(DISCRETE)
    small = TransferFunction((1.9, -2.5e-7), (1, -0.45))
    page = replace(DISCRETE, structure=small, remark="<b>")._repr_html_()
    assert r"$$H(z) = \frac{1.9 - 2.5 \cdot 10^{-7} z^{-1}}{1 - 0.45 z^{-1}}$$" in page
    assert "&lt;b&gt;" in page
    with_effect = read_model("KB", "coulomb_friction/coulomb")
    for part in (with_effect.structure.base, *with_effect.structure.forms):
        assert part.text in str(with_effect)
        assert part.latex.replace("<", "&lt;") in with_effect._repr_html_()
    assert "\\" not in str(with_effect)


def test_elements_have_formula_and_intervals_by_simulation():
    """Intervals of k1 … against draws of the fitted parameters from their joint normal distribution."""
    from lumbar.tissue.diagnosis.fitting.uncertainty import scaled_covariance

    records = tissue_records()
    experiment, (candidate,) = refine(records, [], DiagnosisSettings(base="KB", train="long"))
    fit, training = candidate.fit, experiment.training
    assert [item.name for item in estimates(fit, training, "mm", "N")] == [
        item.name for item in (*KB.base.linear, *KB.base.nonlinear)
    ]
    result = derived_estimates(fit, training, "mm", "N")
    scaled, size = scaled_covariance(fit, training)
    centre = np.array([*fit.linear, *np.log(fit.nonlinear), fit.zero])
    draws = np.random.default_rng(3).multivariate_normal(centre, scaled / np.outer(size, size), 4000)
    elements = [KB.derive(spring, branch, np.exp(log)) for spring, branch, log, _ in draws]
    for item in result:
        low, high = np.quantile([element[item.name] for element in elements], [0.025, 0.975])
        assert item.derived
        assert item.high - item.low == pytest.approx(high - low, rel=0.1)
        assert item.low == pytest.approx(low, rel=0.01)
    assert {item.name: item.value for item in result} == pytest.approx(KB.derive(*fit.linear, *fit.nonlinear))
