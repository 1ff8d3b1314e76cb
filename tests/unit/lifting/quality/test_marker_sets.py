"""Labels of public marker sets: each leads to its landmark or to none, also in parts, with prefixes and with numbers."""

import random

import pytest

from lumbar.lifting.quality.marker_sets import SETS, landmarks, recognise

WORDS = SETS[-1]


@pytest.fixture(params=SETS[:-1], ids=lambda kind: kind.title)
def kind(request):
    return request.param


def meanings(kind):
    """Return the pairs of label and landmark that a set states."""
    return {
        (label.lower(), name) for name, choices in kind.choices.items() for one in choices for label in one
    }


def test_every_part_of_a_set_leads_to_its_landmarks_or_none(kind):
    rng, right = random.Random(3), meanings(kind)
    for share in [0.2, 0.4, 0.6, 0.8] * 5 + [1.0]:
        labels = [label.lower() for label in sorted(kind.labels) if rng.random() < share]
        best, found = recognise(labels)
        assert {(label, name) for name, chosen in found.items() for label in chosen} <= right
    assert (best, found.keys()) == (kind, kind.choices.keys())


@pytest.mark.parametrize("form", ["Anna:{}", "Anna_{}", "{}", "3 - {}", "12_{}"])
def test_prefixes_and_numbers_do_not_count(kind, form):
    labels = [label.lower() for label in sorted(kind.labels)]
    found = recognise(form.format(label) for label in labels)[1]
    assert found == {
        name: tuple(form.format(label) for label in chosen) for name, chosen in recognise(labels)[1].items()
    }


@pytest.mark.parametrize(
    ("labels", "meant"),
    [
        ("L.Knee.Lat L.Knee.Med L_Wrist_Radius L_Wrist_Ulna", "KNEE KNEE_MEDIAL WRIST -"),
        ("Left Elbow,lateral;shoulder_left;LToeTip;heel-L".replace(";", " "), "- - SHOULDER TOE HEEL"),
        ("LFSH LHIP R_Thigh_Med Torso L1 R1 L2 R2", "- - - - - - - -"),
        ("LFHD LFIN LUPA LTHI LTIB LKNE", "- - - - - KNEE"),
    ],
)
def test_words_of_laboratories(labels, meant):
    by_label = {label: name.removeprefix("L_") for name, label in landmarks(labels.split()).items()}
    assert [by_label.get(label, "-") for label in labels.split()] == meant.split()


def test_sources_are_named_and_words_are_the_last_resort(kind):
    assert kind.source and not WORDS.source
    assert not {label for label, _ in meanings(kind)} & {label.lower() for label in kind.others}


def test_clavicle_of_a_skeleton_is_no_shoulder():
    parts = ("Shoulder", "Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot", "ToeBase")
    found = landmarks([side + part for side in ("Left", "Right") for part in parts] + ["Hips", "Spine"])
    assert (found["L_SHOULDER"], found["R_KNEE"], found["L5"]) == ("LeftArm", "RightLeg", "Spine")
