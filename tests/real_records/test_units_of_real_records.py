"""Public records say the same in other units, turned round and in another order."""

from dataclasses import replace

import pytest
from data_sets import READERS
from test_real_records import name_of_folder

import lumbar
from answers import absent
from lumbar.settings.study_settings import StudySettings
from other_units import FAST, SLOW, check_alike

MINUTES = ("silverbox", "wiener_hammerstein")
"""Each diagnosis takes more than a minute."""
ONE_SIDED = ("coupled_drives_1", "coupled_drives_2", "coupled_drives_3")
"""Their sensor gives an absolute value, which turned round is none."""


@pytest.mark.nightly
@pytest.mark.parametrize("units", [SLOW, FAST], ids=["slow", "fast"])
@pytest.mark.parametrize("name", sorted(READERS.keys() - MINUTES))
def test_a_verdict_on_public_records_hangs_on_no_unit(shared, name, units):
    folder = shared / "real"
    if words := absent(folder / name_of_folder(name), "real_records"):
        pytest.skip(words)
    records, keywords = READERS[name](folder)
    settings = keywords.get("settings") or StudySettings()
    settings = replace(settings, improvement=replace(settings.improvement, propose_law=False))

    def diagnose(seen, train):
        chosen = {**keywords, "settings": settings, "train": train or keywords.get("train")}
        return lumbar.diagnose(seen, **chosen).verdict

    check_alike(diagnose, records, replace(units, turned=units.turned and name not in ONE_SIDED))
