"""Tests of tissue as laboratories run them, with labels: the diagnosis gives the answers that README.md asks for."""

import pytest
from protocol_judging import NOT_YET, Label, ask_case, judge, read_labels
from simulated_protocols import draw_case, list_cases, write_case

from answers import RIGHT, SHARED, absent, surprise

FOLDER = SHARED / "protocols"
QUICK = (
    "p00",
    "p09",
    "p16",
    "p23",
    "p24",
    "p28",
    "p35",
    "p38",
    "p45",
    "p51",
    "p56",
    "p60",
    "q01",
    "q02",
    "q04",
    "r03",
    "r05",
)
"""One or two recorded cases of every protocol, and each effect in several of them."""
OWN = {name: wanted for number, (name, wanted) in enumerate(list_cases().items()) if number % 6 == 0}
"""One case of nearly every simulated protocol; all are tried by ask_cases.py."""
QUICK += tuple(OWN)[::2]


def cases(labels) -> list:
    marks = {name: [pytest.mark.statistical if name in QUICK else pytest.mark.acceptance] for name in labels}
    for name in marks.keys() & NOT_YET.keys():
        marks[name].append(pytest.mark.xfail(strict=True, raises=AssertionError, reason=NOT_YET[name]))
    return [pytest.param(name, marks=marks[name]) for name in labels]


def recorded() -> list:
    if not (FOLDER / "labels.json").is_file():
        return [pytest.param("all", marks=pytest.mark.skip(reason=absent(FOLDER, "protocols")))]
    return cases(read_labels(FOLDER))


def require_right(name, folder, label):
    judgement, why = judge(label, ask_case(folder, label))
    if words := surprise(name, judgement, why, NOT_YET.get(name, "")):
        pytest.fail(words)
    assert judgement in RIGHT, f"{judgement}: {why}"


@pytest.mark.parametrize("name", recorded())
def test_a_recorded_protocol_is_judged_right(name):
    require_right(name, FOLDER / name, read_labels(FOLDER)[name])


@pytest.mark.parametrize("name", cases(OWN))
def test_a_simulated_protocol_is_judged_right(name, tmp_path):
    case = draw_case(*OWN[name])
    write_case(tmp_path, case)
    require_right(name, tmp_path, Label(case.protocol, case.hidden, case.forward))
