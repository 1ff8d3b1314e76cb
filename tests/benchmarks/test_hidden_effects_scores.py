"""Scores against hand counts, closed forms and simulated power."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import expit
from statsmodels.stats.proportion import proportion_confint

from hidden_effects.catalogue import MECHANISMS, OUTSIDE_FORMS, SINGLE
from hidden_effects.power_curve import fit_power_curve, strength_interval
from hidden_effects.run import WHOLE, batches, publish
from hidden_effects.scores import (
    accuracy_table,
    confusion,
    forms_table,
    outcome,
    scores,
    share_with_interval,
)
from hidden_effects.settings import DRAWN, HiddenEffectsSettings
from hidden_effects_cases import diagnosis, oracle
from lumbar.base.errors import InputError
from lumbar.base.files import write_json

FRICTION, HARDENING = "coulomb_friction", "hardening_stiffness"


@pytest.mark.parametrize(
    ("kind", "hidden", "said", "expected"),
    [
        ("single", [FRICTION], diagnosis("named", [FRICTION]), "named"),
        ("single", [FRICTION], diagnosis("named", [FRICTION, HARDENING]), "extra"),
        ("single", [FRICTION], diagnosis("named", [HARDENING]), "wrong"),
        ("single", [FRICTION], diagnosis("tied", ["hysteresis"], [FRICTION]), "tied"),
        ("single", [FRICTION], diagnosis("tied", [FRICTION], ["hysteresis"]), "tied"),
        ("single", [FRICTION], diagnosis("tied", ["hysteresis"], [HARDENING]), "wrong"),
        ("single", [FRICTION], diagnosis("unexplained", [FRICTION]), "unexplained"),
        ("single", [FRICTION], diagnosis("adequate"), "missed"),
        ("single", [FRICTION], {"error": "did not converge"}, "failed"),
        ("pair", [FRICTION, HARDENING], diagnosis("named", [HARDENING, FRICTION]), "named"),
        ("pair", [FRICTION, HARDENING], diagnosis("named", [HARDENING]), "partly"),
        ("pair", [FRICTION, HARDENING], diagnosis("named", [HARDENING, "drift"]), "partly"),
        ("pair", [FRICTION, HARDENING], diagnosis("tied", [HARDENING, "hysteresis"], [FRICTION]), "tied"),
        (
            "pair",
            [FRICTION, HARDENING],
            diagnosis("tied", ["drift"], ["inertia", f"{FRICTION}+{HARDENING}"]),
            "tied",
        ),
        ("outside", ["outside"], diagnosis("unexplained"), "unexplained"),
        ("outside", ["outside"], diagnosis("named", ["drift"]), "wrong"),
        ("outside", ["outside"], diagnosis("named", ["drift"], after="unexplained"), "incomplete"),
        ("null", [], diagnosis("adequate"), "adequate"),
        ("null", [], diagnosis("named", [FRICTION]), "accused"),
        ("null", [], diagnosis("unexplained"), "accused"),
    ],
)
def test_outcome(kind, hidden, said, expected):
    assert outcome(kind, hidden, said) == expected


def labels(repeats: int = 3) -> dict[str, dict]:
    """Truths of a benchmark, of all forms, without their recordings."""
    rng, made = np.random.default_rng(4), {}

    def add(kind, effects, form, number):
        made[f"{kind}_{number:04d}"] = {
            "effects": effects,
            "form": form,
            "kind": kind,
            "noise_colour": ("white", "flicker")[number % 2],
            "noise_rms_N": 0.02,
            "residual_over_noise": [float(np.exp(rng.uniform(0.5, 3.2)))] * len(effects),
        }

    for number, form in enumerate([*SINGLE] * repeats):
        add("single", [form.mechanism], [form.label], number)
    for number, form in enumerate(OUTSIDE_FORMS):
        add("outside", [form.mechanism], [form.label], number)
    for number in range(20):
        add("null", [], [], number)
    add("pair", [FRICTION, HARDENING], [f"{FRICTION}:tanh", f"{HARDENING}:cubic"], 0)
    return made


def test_an_oracle_scores_full_marks():
    truth = labels()
    frame = scores(truth, {name: oracle(label) for name, label in truth.items()})
    assert frame["right"].all()
    table = accuracy_table(frame, HiddenEffectsSettings()).frame
    assert (table["share_percent"] == 100).all()
    assert table["low_percent"].max() < 100
    single = table[table["experiments"].str.startswith("one effect")]
    assert single["test_over_noise"].tolist() == pytest.approx([1.0] * len(single))
    matrix = confusion(frame, list(MECHANISMS)).set_index("hidden")
    assert matrix.loc["nothing", "adequate"] == 20
    assert matrix.loc["outside", "unexplained"] == len(OUTSIDE_FORMS)
    assert np.trace(matrix.loc[list(MECHANISMS), list(MECHANISMS)]) == 3 * len(SINGLE)
    assert matrix.to_numpy().sum() == 3 * len(SINGLE) + len(OUTSIDE_FORMS) + 20


def test_mistakes_are_counted_where_they_belong():
    truth = labels()
    said = {name: oracle(label) for name, label in truth.items()}
    strong = [
        name
        for name, label in truth.items()
        if label["effects"] == ["delay"] and label["residual_over_noise"][0] >= 4
    ]
    said[strong[0]] = diagnosis("named", ["inertia"])
    said[strong[1]] = diagnosis("tied", ["inertia"], ["delay"])
    said["null_0003"] = diagnosis("named", ["my_own_effect"])
    said["null_0005"] = {"error": "no"}
    frame = scores(truth, said)
    table = accuracy_table(frame, HiddenEffectsSettings()).frame.set_index("experiments")
    row = table.loc["one effect, ≥ 4 × noise"]
    assert (row["wrong"], row["tied"], row["right"]) == (1, 1, row["count"] - 2)
    nothing = table.loc["nothing hidden"]
    assert (nothing["accused"], nothing["failed"], nothing["right"]) == (1, 1, 18)
    matrix = confusion(frame, list(MECHANISMS)).set_index("hidden")
    assert matrix.loc["delay", "inertia"] == 1
    assert matrix.loc["delay", "tied"] == 1
    assert matrix.loc["nothing", "my_own_effect"] == 1
    assert matrix.loc["nothing", "failed"] == 1
    by_form = forms_table(frame, HiddenEffectsSettings()).frame
    delay = by_form[by_form["mechanism"] == "delay"]
    assert delay["count"].sum() - delay["right"].sum() == 2
    assert set(", ".join(delay["instead"]).split(", ")) <= {"inertia", "–"}


def test_labels_and_diagnoses_must_belong_together():
    truth = labels()
    said = {name: oracle(label) for name, label in truth.items()}
    said["extra"] = said.pop("null_0000")
    said["null_0001"]["verdict"] = "perhaps"
    with pytest.raises(InputError, match="3 problems") as caught:
        scores(truth, said)
    assert "null_0000: no diagnosis" in str(caught.value)
    assert "extra: no label" in str(caught.value)
    assert "null_0001: verdict 'perhaps'" in str(caught.value)


@pytest.mark.parametrize(("successes", "trials"), [(0, 1000), (10, 1000), (30, 30), (7, 9)])
def test_wilson_interval_is_that_of_statsmodels(successes, trials):
    found = share_with_interval(successes, trials, 0.95)
    low, high = proportion_confint(successes, trials, 0.05, method="wilson")
    assert found["low_percent"] == pytest.approx(100 * low, abs=1e-9)
    assert found["high_percent"] == pytest.approx(100 * high, abs=1e-9)


def test_power_curve_recovers_the_curve_it_was_drawn_from():
    rng = np.random.default_rng(8)
    strength = np.exp(rng.uniform(np.log(1.2), np.log(26), 4000))
    named = rng.random(4000) < expit(-3.0 + 4.0 * np.log(strength))
    curve = fit_power_curve(strength, named)
    truth = np.exp((np.log(19) + 3.0) / 4.0)
    assert curve.strength_at(0.95) == pytest.approx(truth, rel=0.06)
    assert curve.isotonic_strength_at(0.95) == pytest.approx(truth, rel=0.25)
    low, high = strength_interval(curve, 0.95, 0.95, 60, seed=1)
    assert low < truth < high


def test_a_power_curve_needs_experiments_of_different_strength():
    with pytest.raises(InputError, match="raise experiments_per_form"):
        fit_power_curve([3.0, 3.0, 3.0], [True, False, True])


def test_the_whole_benchmark_makes_the_same_experiments_and_more():
    for key in DRAWN:
        assert getattr(WHOLE, key) == getattr(HiddenEffectsSettings(), key)
    assert len(batches(Path(), WHOLE)) == 4 * (12 + 5 + 10) + 20


def test_publishing_writes_tables_and_pictures(tmp_path):
    (batch,) = batches(
        tmp_path, HiddenEffectsSettings(experiments_per_form=0, experiments_per_pair=0, nulls=0, slices=1)
    )
    truth = labels()
    write_json(batch.labels, truth)
    write_json(batch.diagnoses, {name: oracle(label) for name, label in truth.items()})
    publish(tmp_path, [batch], HiddenEffectsSettings(bootstrap_resamples=20))
    names = ["scores.csv", "confusion.csv", "power.json"]
    names += [
        f"tables/{table}.{ending}" for table in ("accuracy", "forms") for ending in ("csv", "tex", "html")
    ]
    names += [f"figures/{figure}.{ending}" for figure in ("confusion", "power") for ending in ("svg", "pdf")]
    assert all((tmp_path / name).stat().st_size for name in names)


def test_logistic_curve_is_the_maximum_that_a_general_optimiser_finds():
    # One failure among many, at the strongest effect: plain Newton steps cycle here.
    x = np.linspace(0.4, 3.2, 44)
    y = np.ones(44)
    y[-1] = 0.0
    curve = fit_power_curve(np.exp(x), y > 0)

    def penalised(weights):
        share = expit(weights[0] + weights[1] * x)
        design = np.column_stack([np.ones(44), x])
        information = design.T @ (design * (share * (1 - share))[:, None])
        likelihood = np.sum(np.log(np.where(y > 0, share, 1 - share)))
        return -likelihood - 0.5 * np.log(np.linalg.det(information))

    found = minimize(penalised, [4.0, -0.5], method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-12})
    assert [curve.intercept, curve.slope] == pytest.approx(found.x, rel=1e-3)
    assert curve.strength_at(0.95) is None
