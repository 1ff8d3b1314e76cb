"""What a diagnosis says of its errors: digits that tell rungs apart, an order that rounding does not turn round."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from lumbar.publishing.figures.comparison_figures import ladder_figure
from lumbar.tissue.diagnosis.evidence.discrimination import Separation, separation_sentence
from lumbar.tissue.diagnosis.selection.candidate import by_score
from lumbar.tissue.diagnosis.selection.verdict import told_apart


def test_errors_that_fall_read_as_falling():
    assert told_apart([1.42, 1.404, 1.398, 1.3951], 2) == ["1.42", "1.404", "1.398", "1.395"]
    assert told_apart([0.23, 0.0099], 4) == ["0.23", "0.0099"]


def test_equal_errors_need_no_digits():
    assert told_apart([1.4, 1.4, 1.4 + 1e-12], 2) == ["1.4", "1.4", "1.4"]


def test_the_figure_of_a_ladder_tells_its_rungs_apart():
    rungs = [
        {"label": str(number), "train_rms": error, "test_rms": error + 0.01}
        for number, error in enumerate((1.42, 1.404, 1.398))
    ]
    words = [text.get_text() for text in ladder_figure(rungs, "N", None).axes[0].texts]
    assert words[:3] == ["1.42", "1.404", "1.398"]


def candidate(score, *effects):
    return SimpleNamespace(score=score, effects=effects)


@pytest.mark.parametrize("sign", [-1, 1])
def test_scores_equal_to_rounding_are_ordered_by_name(sign):
    scores = (-1000.0 + sign * 1e-5, -1000.0, -1000.5)
    found = by_score([candidate(score, name) for score, name in zip(scores, "bac", strict=True)])
    assert [item.effects[0] for item in found] == ["c", "a", "b"]


@pytest.mark.parametrize("distance", [9.3, 9.7])
def test_an_excitation_worse_than_the_record_at_hand_is_not_proposed(distance):
    excitation = SimpleNamespace(words="a chirp", within=True)
    found = Separation(excitation, distance, 0.1, 9.6, ("drift",), 42)
    training = SimpleNamespace(name="multisine")
    diagnosis = SimpleNamespace(
        selected=("hysteresis",), experiment=SimpleNamespace(output_unit="N", training=training)
    )
    sentence = separation_sentence(found, diagnosis)
    assert found.improves == (distance > 9.6)
    assert ("record a chirp" in sentence) == found.improves
    assert ("records at hand separate hysteresis from drift better" in sentence) != found.improves
