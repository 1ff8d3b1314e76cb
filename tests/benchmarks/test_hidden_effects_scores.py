"""Scores against hand counts."""

import numpy as np
import pytest

from hidden_effects.catalogue import MECHANISMS, OUTSIDE_FORMS, SINGLE
from hidden_effects.scores import (
    accuracy_table,
    confusion,
    forms_table,
    outcome,
    scores,
)
from hidden_effects.settings import HiddenEffectsSettings
from hidden_effects_cases import diagnosis, oracle

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
