"""Public records of which it is known what linear models miss: the diagnosis names it, as published, in any units and order."""

from dataclasses import replace
from functools import partial

import pytest
from data_sets import READERS, positioning_axis
from record_judging import expectations, judge

import lumbar
from answers import RIGHT, absent, ask, surprise
from lumbar.settings.study_settings import StudySettings
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.joint_fit import add, fit_base
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.structure import Structure
from other_units import FAST, SLOW, check_alike

EXPECTATIONS = expectations()
NIGHTLY = ("coupled_drives_1",)
"""Tried by ``make test-statistical``, as the friction damper is by its study; the others by ``make acceptance``."""


def parameter(name: str):
    marks = [pytest.mark.nightly if name in NIGHTLY else pytest.mark.acceptance]
    if reason := EXPECTATIONS[name].not_yet:
        marks.append(pytest.mark.xfail(strict=True, raises=AssertionError, reason=reason))
    return pytest.param(name, marks=marks)


def test_every_entry_has_a_reader():
    assert EXPECTATIONS.keys() == READERS.keys()


@pytest.mark.parametrize("name", map(parameter, EXPECTATIONS))
def test_what_is_known_is_found(shared, name):
    folder = shared / "real"
    if words := absent(folder / name_of_folder(name), "real_records"):
        pytest.skip(words)
    expected, answer = EXPECTATIONS[name], ask(partial(READERS[name], folder))
    best = expected.published("best", READERS[name](folder)[0])
    judgement, why = judge(expected, best, answer)
    if words := surprise(name, judgement, why, expected.not_yet):
        pytest.fail(words)
    assert judgement in RIGHT, f"{judgement}: {why}"


def name_of_folder(name: str) -> str:
    """An entry's name is that of its folder, and what is done with it."""
    return next(item for item in ("coupled_drives", "bouc_wen", name) if name.startswith(item))


def test_intervals_hold_the_published_parameters_of_the_positioning_axis(shared):
    """What friction leaves depends on the stroke: intervals as of white noise are a third as wide."""
    if words := absent(shared / "real" / "positioning_axis", "real_records"):
        pytest.skip(words)
    records, keywords = positioning_axis(shared / "real")
    prepared = Experiment.from_records(records, DiagnosisSettings(**keywords)).drop_whitening()
    fit = fit_base(Structure(BASES["KV"]), prepared.training)
    for effect in ("inertia", "coulomb_friction"):
        fit = add(fit, TISSUE[effect].forms[0], prepared.training)
    found = {item.name: item for item in estimates(fit, prepared.training, "mm", "N")}
    for name, value in EXPECTATIONS["positioning_axis"].parameters.items():
        assert found[name].low < value < found[name].high, name
        assert found[name].high - found[name].low < 0.2 * found[name].value, name


@pytest.mark.acceptance
def test_two_tanks_are_predicted_as_by_grey_boxes_of_the_literature(project, shared):
    """0.57 V of a linear model, 0.191 V of the best published one (Cascaded tanks benchmark, 2016)."""
    if words := absent(shared / "real" / "cascaded_tanks", "real_records"):
        pytest.skip(words)
    tanks, _ = READERS["cascaded_tanks"](shared / "real")
    path = project / "examples" / "own_base" / "two_tanks.yaml"
    refined = lumbar.refine(tanks, [], base=str(path), train="estimation")
    assert refined.model.scores.test_rms < 0.26


MINUTES = ("silverbox", "wiener_hammerstein")
"""Each diagnosis takes more than a minute."""
ONE_SIDED = ("coupled_drives_1", "coupled_drives_2", "coupled_drives_3")
"""Their sensor gives an absolute value, which turned round is none."""


ANEW = {name: (SLOW, FAST)[number % 2] for number, name in enumerate(sorted(READERS.keys() - MINUTES))}
"""Units that the records are told in anew: slow and turned round, and fast, in turns, as either takes minutes of some."""


@pytest.mark.parametrize(
    ("name", "units"),
    [
        pytest.param(
            *item, marks=pytest.mark.nightly if item[0] in NIGHTLY else pytest.mark.acceptance, id=item[0]
        )
        for item in ANEW.items()
    ],
)
def test_a_verdict_on_public_records_hangs_on_no_unit(shared, name, units):
    folder = shared / "real"
    if words := absent(folder / name_of_folder(name), "real_records"):
        pytest.skip(words)
    records, keywords = READERS[name](folder)
    settings = keywords.get("settings") or StudySettings()
    settings = settings.model_copy(
        update={"improvement": settings.improvement.model_copy(update={"propose_law": False})}
    )

    def diagnose(seen, train):
        chosen = {**keywords, "settings": settings, "train": train or keywords.get("train")}
        return lumbar.diagnose(seen, **chosen).result

    check_alike(diagnose, records, replace(units, turned=units.turned and name not in ONE_SIDED))
