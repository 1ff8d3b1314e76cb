"""Tables of position and force without a clock: only laws of position are searched."""

import json
import re

import numpy as np
import pytest

import lumbar
from running import python

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


def test_table_without_clock_is_diagnosed_by_laws_of_position(tmp_path):
    diagnosis = diagnose(write(tmp_path / "a.csv"))
    assert (diagnosis.result.status, diagnosis.selected) == ("named", ("hardening_stiffness",))
    (finding,) = diagnosis.result.findings
    assert (finding.kind, finding.value, finding.unit) == ("static_points", 25.0, "1")
    assert {name for item in diagnosis.result.ranking for name in item.candidate.effects} <= STATIC
    cubic = next(item for item in diagnosis.model.parameters if item.name == "cubic_stiffness")
    assert cubic.low < 0.02 < cubic.high


def test_order_of_points_does_not_matter(tmp_path):
    order = np.random.default_rng(3).permutation(len(POSITION))
    lines = write(tmp_path / "a.csv").read_text().splitlines()
    shuffled = tmp_path / "b.csv"
    shuffled.write_text("\n".join([lines[0], *(lines[1 + index] for index in order)]) + "\n")
    one, other = (diagnose(tmp_path / name).result for name in ("a.csv", "b.csv"))
    assert one.selected == other.selected
    assert one.model.test_rms == pytest.approx(other.model.test_rms, rel=1e-9)


@pytest.mark.parametrize("times", [["0"] * 25, [""] * 25, ["7.5"] * 25])
def test_equal_or_missing_times_are_not_a_clock(tmp_path, times):
    (record,) = lumbar.read(write(tmp_path / "a.csv", time=times))
    assert record.points and re.search(r"\b25 points\b", repr(record))


def test_incomplete_or_renamed_clock_is_an_error(tmp_path):
    times = [f"{0.1 * number:.1f}" for number in range(25)]
    with pytest.raises(lumbar.InputError, match=r"line 2\b.*\btime\b.*\bnan\b"):
        lumbar.read(write(tmp_path / "a.csv", time=["", *times[1:]]))
    path = write(tmp_path / "a.csv", time=times)
    path.write_text(path.read_text().replace("time_s", "seconds"))
    with pytest.raises(lumbar.InputError, match=r"a\.csv\b(.|\n)*\btime\b.*'time_s'"):
        lumbar.read(path)


def test_line_is_adequate_and_unknown_law_is_unexplained(tmp_path):
    line = diagnose(write(tmp_path / "a.csv", law=np.zeros_like))
    wave = diagnose(write(tmp_path / "b.csv", law=lambda x: np.sin(1.2 * x)))
    assert (line.result.status, wave.result.status) == ("adequate", "unexplained")
    assert line.result.experiment.floor is None and not wave.selected


@pytest.mark.statistical
def test_false_alarms_are_as_rare_as_stated(tmp_path):
    alarms = 0
    for seed in range(25):
        result = diagnose(write(tmp_path / "a.csv", law=np.zeros_like, seed=seed)).result
        alarms += bool(result.selected)
        assert result.selected or all(item.p_value > 0.001 for item in result.ranking)
    assert alarms <= 1


def test_second_table_is_unseen(tmp_path):
    write(tmp_path / "a.csv"), write(tmp_path / "b.csv", np.linspace(0.0, 9.0, 14), seed=2)
    diagnosis = diagnose(tmp_path)
    assert [item.name for item in diagnosis.result.experiment.tests] == ["b"]
    assert diagnosis.selected == ("hardening_stiffness",)


def test_late_contact_is_a_spring_with_contact(tmp_path):
    path = write(tmp_path / "a.csv", np.linspace(0, 12, 40), lambda x: 0.8 * (np.maximum(x, 5) - x) - 4.0)
    result = diagnose(path).result
    assert result.base.fit.structure.base.name == "LE-contact" and result.status == "adequate"
    assert result.experiment.surface == pytest.approx(5.0, abs=0.2)


def test_saved_page_has_no_quantities_of_time(tmp_path):
    diagnose(write(tmp_path / "a.csv")).save(tmp_path / "out", pictures=True)
    page = re.sub(r"<(svg|style).*?</\1>", "", (tmp_path / "out/diagnosis.html").read_text(), flags=re.S)
    assert "cubic" in page and not re.search(r"\bHz\b|free-run|mm/s|period", page)
    assert {"diagnosis.json", "refined.json", "ladder.csv"} <= {
        item.name for item in (tmp_path / "out").iterdir()
    }


@pytest.mark.parametrize(
    "function",
    [
        lumbar.identify,
        lumbar.propose,
        lambda records: lumbar.refine(records, ["inertia"]),
        lambda records: lumbar.diagnose(records, base="KB"),
    ],
)
def test_functions_that_need_a_clock_reject_points(tmp_path, function):
    records = lumbar.read(write(tmp_path / "a.csv"))
    with pytest.raises(lumbar.InputError, match="clock"):
        function(records)


def test_points_have_no_rate_and_are_not_mixed_with_records(tmp_path):
    with pytest.raises(lumbar.InputError, match=r"a\.csv\b.*\bclock\b"):
        lumbar.read(write(tmp_path / "a.csv"), rate=10.0)
    write(tmp_path / "b.csv", time=[f"{0.1 * number:.1f}" for number in range(25)])
    with pytest.raises(lumbar.InputError, match=r"^b: .*\bclock\b"):
        diagnose(tmp_path)


def test_explain_prints_every_step_and_the_deciding_one(tmp_path):
    write(tmp_path / "a.csv")
    program = "from lumbar.cli import main; main()"
    options = "diagnose", tmp_path, "--output", tmp_path / "out", "--explain"
    lines = python("-c", program, *options).splitlines()
    steps = json.loads((tmp_path / "out/diagnosis.json").read_text())["steps"]
    assert [item["step"] for item in steps][:3] == ["prepare points", "choose the base", "select effects"]
    for item in steps:
        assert any(line.startswith(f"{item['step']}: {item['reason']}") for line in lines)
    assert [line.split(":")[0] for line in lines if line.endswith("[decided: named]")] == ["find ties"]


@pytest.mark.parametrize("width", [0.0, 0.5])
def test_loops_ask_for_a_clock(tmp_path, width):
    """A loop of loading and unloading is reported; two equal branches are not."""
    half = np.linspace(0.0, 10.0, 25)
    direction = np.repeat([1.0, -1.0], 25)
    path = write(
        tmp_path / "a.csv", np.concatenate([half, half[::-1]]), lambda x: 0.02 * x**3 + width * direction
    )
    result = diagnose(path).result
    assert any(item.kind == "loops" for item in result.findings) is (width > 0)
    assert result.status == ("unexplained" if width else "named")
