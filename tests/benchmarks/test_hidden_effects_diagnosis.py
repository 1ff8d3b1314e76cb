"""A small seeded part of the benchmark: hidden effects are written to files, diagnosed blind, then compared.

The generator shares no code with the diagnosis; labels are read by the assertions only.
"""

import json

import pytest

from hidden_effects.catalogue import MECHANISMS, SINGLE
from hidden_effects.diagnosing import diagnose_folders
from hidden_effects.experiment import plan_batch, write_experiments
from hidden_effects.scores import outcome
from hidden_effects.settings import HiddenEffectsSettings
from lumbar.tissue.diagnosis.selection.diagnose import diagnose

pytestmark = pytest.mark.statistical

STRONG = HiddenEffectsSettings(
    periods=3,
    slices=1,
    residual_over_noise=(5, 15),
    noise_colours={"white": 1, "autoregressive": 0, "flicker": 0},
)
OTHER_FORM = 1
"""Of each mechanism its second form, where it has one: not the one that comes to mind first."""


def one_form_of(mechanism: str) -> int:
    numbers = [number for number, form in enumerate(SINGLE) if form.mechanism == mechanism]
    return numbers[min(OTHER_FORM, len(numbers) - 1)]


def diagnosed(folder, kind: str, number: int) -> tuple[str, dict, dict]:
    """Outcome, diagnosis and truth of one experiment."""
    plans = [plan for plan in plan_batch(kind, 0, STRONG) if plan.number == number]
    write_experiments(folder / "recordings", folder / "labels.json", plans, STRONG)
    ((name, found),) = diagnose_folders(
        folder / "recordings", lambda records: diagnose(records).to_json()
    ).items()
    label = json.loads((folder / "labels.json").read_text())[name]
    return outcome(kind, label["effects"], found), found, label


@pytest.mark.parametrize("mechanism", MECHANISMS)
def test_a_single_effect_is_named_and_explained_to_the_noise(tmp_path, mechanism):
    result, found, label = diagnosed(tmp_path, "single", one_form_of(mechanism))
    assert result == "named", (
        label["form"],
        label["residual_over_noise"],
        found["verdict"],
        found["selected"],
    )
    assert found["ladder"][-1]["test_rms"] < 0.5 * found["ladder"][0]["test_rms"]


# The second is a random telegraph signal: noise to any model, and no more than spikes to the floor.
@pytest.mark.parametrize("number", [0, 2])
def test_what_the_catalogue_does_not_hold_stays_unexplained(tmp_path, number):
    result, found, label = diagnosed(tmp_path, "outside", number)
    assert result == "unexplained", (label["form"], found["verdict"], found["selected"])
