"""Tables of position and force without a clock: a mode of their own, in which laws of position alone are looked for."""

import json
import re

import numpy as np
import pytest

import lumbar
from lumbar.base.errors import InputError
from lumbar.cli import main
from lumbar.tissue.diagnosis.selection.sentences import CONDITIONAL
from lumbar.tissue.diagnosis.selection.thresholds import LEVEL

POSITION = np.linspace(-2.0, 12.0, 25)
STATIC = {"hardening_stiffness", "strain_softening", "quadratic_stiffness", "contact_loss", "saturation"}


def write(path, position=POSITION, law=lambda x: 0.02 * x**3, *, time=None, seed=1, noise=0.05):
    force = 0.3 + 0.8 * position + law(position)
    force = force + noise * np.random.default_rng(seed).standard_normal(len(position))
    names = ["position_mm,force_N", *(f"{a:.5f},{b:.5f}" for a, b in zip(position, force, strict=True))]
    if time is not None:
        names = [f"{first},{line}" for first, line in zip(["time_s", *time], names, strict=True)]
    path.write_text("\n".join(names) + "\n")
    return path


def diagnose(path):
    return lumbar.diagnose(lumbar.read(path))


def test_a_table_without_a_clock_is_diagnosed_by_laws_of_position_alone(tmp_path):
    found = diagnose(write(tmp_path / "a.csv"))
    assert (found.result.status, found.selected) == ("named", ("hardening_stiffness",))
    (finding,) = found.result.findings
    assert (finding.kind, finding.value, finding.unit) == ("static_points", 25.0, "1")
    tried = {name for item in found.result.ranking for name in item.candidate.effects}
    assert tried <= STATIC
    cubic = next(item for item in found.model.parameters if item.name == "cubic_stiffness")
    assert cubic.low < 0.02 < cubic.high


def test_the_order_of_points_says_nothing(tmp_path):
    order = np.random.default_rng(3).permutation(len(POSITION))
    lines = write(tmp_path / "a.csv").read_text().splitlines()
    shuffled = tmp_path / "b.csv"
    shuffled.write_text("\n".join([lines[0], *(lines[1 + index] for index in order)]) + "\n")
    one, other = (diagnose(tmp_path / name).result for name in ("a.csv", "b.csv"))
    assert one.selected == other.selected
    assert one.model.test_rms == pytest.approx(other.model.test_rms, rel=1e-9)


@pytest.mark.parametrize("times", [["0"] * 25, [""] * 25, ["7.5"] * 25])
def test_times_that_are_equal_or_missing_are_no_clock(tmp_path, times):
    (record,) = lumbar.read(write(tmp_path / "a.csv", time=times))
    assert record.points and "25 points without a clock" in repr(record)


def test_one_missing_time_is_no_table_of_points(tmp_path):
    times = ["", *(f"{0.1 * number:.1f}" for number in range(1, 25))]
    with pytest.raises(InputError, match=r"line 2.*time is nan"):
        lumbar.read(write(tmp_path / "a.csv", time=times))


def test_a_clock_under_another_name_is_not_overlooked(tmp_path):
    path = write(tmp_path / "a.csv", time=[f"{0.1 * number:.1f}" for number in range(25)])
    path.write_text(path.read_text().replace("time_s", "seconds"))
    with pytest.raises(InputError, match="no column 'time_s'; the header has seconds, position_mm, force_N"):
        lumbar.read(path)


def test_nothing_is_missing_from_a_line_and_a_law_of_no_catalogue_is_unexplained(tmp_path):
    line = diagnose(write(tmp_path / "a.csv", law=np.zeros_like))
    wave = diagnose(write(tmp_path / "b.csv", law=lambda x: np.sin(1.2 * x)))
    assert (line.result.status, wave.result.status) == ("adequate", "unexplained")
    assert line.result.experiment.floor is None and not wave.selected


@pytest.mark.statistical
def test_false_alarms_are_as_rare_as_said(tmp_path):
    alarms = 0
    for seed in range(25):
        found = diagnose(write(tmp_path / "a.csv", law=np.zeros_like, seed=seed)).result
        alarms += bool(found.selected)
        assert found.selected or all(item.p_value > LEVEL / 10 for item in found.ranking)
    assert alarms <= 1


def test_another_table_is_the_unseen_one(tmp_path):
    write(tmp_path / "a.csv"), write(tmp_path / "b.csv", np.linspace(0.0, 9.0, 14), seed=2)
    found = diagnose(tmp_path)
    assert [item.name for item in found.result.experiment.tests] == ["b"]
    assert found.selected == ("hardening_stiffness",)


def test_a_tool_that_meets_the_tissue_late_is_a_spring_with_contact(tmp_path):
    path = write(tmp_path / "a.csv", np.linspace(0, 12, 40), lambda x: 0.8 * (np.maximum(x, 5) - x) - 4.0)
    found = diagnose(path).result
    assert found.base.fit.structure.base.name == "LE-contact" and found.status == "adequate"
    assert found.experiment.surface == pytest.approx(5.0, abs=0.2)


def test_what_is_saved_speaks_of_no_time(tmp_path):
    found = diagnose(write(tmp_path / "a.csv"))
    found.save(tmp_path / "out", pictures=True)
    page = re.sub(r"<(svg|style).*?</\1>", "", (tmp_path / "out/diagnosis.html").read_text(), flags=re.S)
    assert page.count(CONDITIONAL) == 1
    assert "cubic stiffness" in page and not re.search(r"\bHz\b|free-run|mm/s|period", page)
    assert {"diagnosis.json", "refined.json", "ladder.csv"} <= {
        item.name for item in (tmp_path / "out").iterdir()
    }


def test_what_needs_a_clock_refuses_points_in_words(tmp_path):
    records = lumbar.read(write(tmp_path / "a.csv"))
    for verb in (
        lambda: lumbar.identify(records),
        lambda: lumbar.refine(records, ["inertia"]),
        lambda: lumbar.propose(records),
        lambda: lumbar.diagnose(records, base="KB"),
        lambda: lumbar.read(tmp_path / "a.csv", rate=10.0),
    ):
        with pytest.raises(InputError, match=r"clock"):
            verb()


def test_tables_with_and_without_a_clock_are_not_mixed(tmp_path):
    write(tmp_path / "a.csv")
    write(tmp_path / "b.csv", time=[f"{0.1 * number:.1f}" for number in range(25)])
    with pytest.raises(InputError, match="b: has a clock"):
        diagnose(tmp_path)


def test_explain_prints_every_step_and_the_deciding_one(tmp_path, capsys):
    write(tmp_path / "a.csv")
    assert main(["diagnose", str(tmp_path), "--output", str(tmp_path / "out"), "--explain"]) == 0
    lines = capsys.readouterr().out.splitlines()
    steps = json.loads((tmp_path / "out/diagnosis.json").read_text())["steps"]
    assert [item["step"] for item in steps][:3] == ["prepare points", "choose the base", "select effects"]
    for item in steps:
        assert any(line.startswith(f"{item['step']}: {item['reason']}") for line in lines)
    assert [line.split(":")[0] for line in lines if line.endswith("[decided: named]")] == ["find ties"]
