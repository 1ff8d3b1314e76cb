"""Units and names of columns in several spellings and languages."""

import numpy as np
import pytest

from lumbar.records.importing.raw_table import find_unit, parse_unit, split_name_and_unit
from lumbar.records.importing.roles import name_match_score
from refusing import has_tokens, refusal


@pytest.mark.parametrize(
    ("spelling", "quantity", "factor"),
    [
        ("µm", "length", 1e-3),
        ("mN", "force", 1e-3),
        ("LBF", "force", 4.4482216152605),  # international pound 0.45359237 kg times 9.80665 m/s²
        ("kgf", "force", 9.80665),
        ("N m", "torque", 1.0),
        ("in-lbf", "torque", 0.1129848290276167),  # NIST SP 811
        ("°", "angle", np.pi / 180),
        ("V", "reading", 1.0),
        ("[m/s]", "velocity", 1e3),
        ("mm/min", "velocity", 1 / 60),
        ("m·s⁻¹", "velocity", 1e3),
        ("deg/s", "angular velocity", np.pi / 180),
        ("rpm", "angular velocity", 2 * np.pi / 60),
    ],
)
def test_spellings_of_units_are_read(spelling, quantity, factor):
    unit = find_unit(spelling)
    assert unit.quantity == quantity
    assert unit.factor == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize("spelling", ["furlong", "mn", "nM", "", "1"])
def test_ambiguous_unit_is_unknown(spelling):
    assert find_unit(spelling) is None


@pytest.mark.parametrize(
    ("cell", "parted"),
    [
        ("Weg / mm", ("Weg", "mm")),
        ("TimeMs", ("Time", "Ms")),
        ("x_m", ("x", "m")),
        ("vel_in_s", ("vel_in", "s")),
        ("pos_mm_min", ("pos_mm", "min")),
        ("Strain (%)", ("Strain (%)", "")),
    ],
)
def test_header_is_split_into_name_and_unit(cell, parted):
    assert split_name_and_unit(cell) == parted


@pytest.mark.parametrize(
    ("name", "role", "plainness"),
    [
        ("Traversenweg", "position", 3),
        ("LoadCell1", "force", 3),
        ("t", "time", 1),
        ("Sollweg", "position", 0),
        ("Soll Weg", "position", -1),
        ("Force rate", "force", -1),
        ("Temperature", "time", -1),
    ],
)
def test_column_names_are_scored_by_role(name, role, plainness):
    assert name_match_score(name, role) == plainness


def test_unit_option_may_have_calibration_factor():
    assert parse_unit("2e-3 kN/count", "--force-unit").factor == pytest.approx(2.0)
    assert parse_unit("0.5 mm/s/V", "--position-unit").factor == 0.5
    assert parse_unit("0.5 mm/s", "--position-unit").quantity == "velocity"
    for wrong in ("35.15", "0 N", "35 furlongs", "3 N/s"):
        assert has_tokens(refusal(parse_unit, wrong, "--force-unit"), f"--force-unit '{wrong}' … N")
