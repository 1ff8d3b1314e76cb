"""A study may name every base that there is, and no other."""

from lumbar.settings.improvement import BASE_NAMES, system_of
from lumbar.tissue.models.bases import BASES, CHOSEN_BY_DATA


def test_the_names_of_the_settings_are_those_of_the_models():
    assert (CHOSEN_BY_DATA, *BASES) == BASE_NAMES
    assert {name: system_of(name) for name in BASES} == {name: base.system for name, base in BASES.items()}
