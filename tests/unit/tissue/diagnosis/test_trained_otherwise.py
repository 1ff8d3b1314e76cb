"""Records that differ: the model is tried the other way, and records that soften one after another are said to be a session."""

import numpy as np
import pytest
from periodic_records import multisine, noise, record

from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.selection.diagnose import diagnose
from lumbar.tissue.diagnosis.selection.verdict import details
from lumbar.tissue.effects.catalogue import TISSUE


def springs(stiffness: dict[str, np.ndarray | float]) -> list:
    made = []
    for seed, (name, value) in enumerate(stiffness.items()):
        position = multisine(4, 500, range(1, 8), seed)
        made.append(record(position, value * position + 0.01 * noise(len(position), seed + 5), name))
    return made


def told(records, kind: str, **settings):
    found = diagnose(records, DiagnosisSettings(base="LE", train="a", most_effects=1, **settings))
    return found, [item for item in found.findings if item.kind == kind]


def test_the_model_is_tried_the_other_way_where_only_training_is_explained():
    found, (finding,) = told(springs({"a": 0.8, "b": 0.9, "c": 0.9}), "trained_otherwise")
    spread = float(np.std(multisine(4, 500, range(1, 8), 0)))
    assert finding.value == pytest.approx(0.1 * spread, rel=0.05)
    assert "fitted to b and c leaves 0.01 N there" in finding.sentence
    assert "no one set of parameters holds" in finding.sentence and "--session" in finding.sentence
    assert finding.sentence in details(found, TISSUE)


def test_nothing_is_tried_where_unseen_records_are_explained_too():
    assert not told(springs({"a": 0.8, "b": 0.8}), "trained_otherwise")[1]


def test_records_that_hardly_move_are_not_trained_on():
    records = springs({"a": 0.8, "b": 0.9})
    small = records[1].with_values(input=0.02 * records[1]["input"], output=0.04 * records[1]["output"])
    assert not told([records[0], small], "trained_otherwise")[1]


def test_one_session_is_suggested_where_the_stiffness_falls_cycle_by_cycle():
    worn = np.repeat(0.9 * 0.99 ** np.arange(8), 500)
    _, (finding,) = told(springs({"a": worn[:2000], "b": worn[2000:]}), "falling_stiffness")
    assert finding.value == pytest.approx(0.9 * 0.99**7, rel=0.01) and "--session" in finding.sentence
    rest = springs({"a": worn[:2000], "b": worn[:2000]})
    assert not told(rest, "falling_stiffness")[1]
    assert not told(springs({"a": worn[:2000], "b": worn[2000:]}), "falling_stiffness", session=True)[1]
