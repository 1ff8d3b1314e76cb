"""Records of several axes: from column files and layouts, in parts and at other rates, and what is refused of them."""

import numpy as np
import pytest

import lumbar
from case_tables import cases
from refusing import has_tokens, refusal

TIME = np.arange(400) / 100
FULL = cases(__file__, "read")[0]["header"]


def columns(**roles: tuple) -> dict:
    """Return column settings by role from name, unit and quantity."""
    return {
        role: dict(zip(("column", "unit", "quantity"), item, strict=True)) for role, item in roles.items()
    }


def column(name: str) -> np.ndarray:
    """Numbers of a column, of which each name has its own."""
    return TIME if name in ("time_s", "t") else np.sin((3 + sum(map(ord, name)) % 7) * TIME + len(name))


def written(tmp_path, header: str, table=None, name="trial.csv"):
    table = np.column_stack([column(item) for item in header.split(",")]) if table is None else table
    np.savetxt(tmp_path / name, table, delimiter=",", header=header, comments="", fmt="%.9f")
    return tmp_path / name


@pytest.mark.parametrize("case", cases(__file__, "read"))
def test_columns_of_axes_are_read_in_any_order(tmp_path, case):
    [record] = lumbar.read(written(tmp_path, case["header"]))
    axes = tuple(case["axes"].split())
    assert record.axes == axes
    assert list(record.channels) == [f"{side}_{axis}" for side in ("input", "output") for axis in axes]
    expected = np.stack([column(f"force_{axis}_N") for axis in axes])
    assert record.stacked("output") == pytest.approx(expected, abs=1e-8)
    assert f"position {', '.join(axes)} (mm), force {', '.join(axes)} (N)" in record.summary
    along = record.axis(axes[-1])
    assert along.axes == ()
    assert list(along.channels) == ["input", "output"]
    assert along.stacked("output") == pytest.approx(expected[-1:], abs=1e-8)
    assert has_tokens(refusal(record.axis, "w"), "axis 'w'")


@pytest.mark.parametrize("case", cases(__file__, "refused"))
def test_incomplete_axes_in_header_are_rejected(tmp_path, case):
    message = refusal(lumbar.read, written(tmp_path, case["header"]))
    assert [tokens for tokens in case["tokens"] if not has_tokens(message, tokens)] == []


@pytest.mark.parametrize("case", cases(__file__, "values"))
def test_each_axis_is_checked_and_one_may_be_constant(tmp_path, case):
    values = [
        eval(text, {"np": np, "w": np.sin(5 * TIME), "t": TIME}) for text in case["position"] + case["force"]
    ]
    path = written(tmp_path, FULL, np.column_stack([TIME, *values]))
    if not case["tokens"]:
        assert lumbar.read(path)[0].stacked("input").shape == (3, len(TIME))
        return
    message = refusal(lumbar.read, path)
    assert [tokens for tokens in case["tokens"] if not has_tokens(message, tokens)] == []


@pytest.mark.parametrize("case", cases(__file__, "layouts"))
def test_layout_needs_equal_axes_of_both_sides(case):
    sides = {"i": ("mm", "position"), "o": ("N", "force")}
    roles = {
        role: (role, case["units"].get(role, sides[role[0]][0]), sides[role[0]][1]) for role in case["roles"]
    }
    with pytest.raises(ValueError, match="axes") as caught:
        lumbar.ColumnLayout(columns=columns(time=("t", "s", "time"), **roles))
    assert [tokens for tokens in case["tokens"] if not has_tokens(str(caught.value), tokens)] == []


def test_layout_may_name_axes(tmp_path):
    roles = {
        f"{side}_{axis}": (f"{side[0]}{axis}", "mm", side) for side in ("input", "output") for axis in "xz"
    }
    layout = lumbar.ColumnLayout(columns=columns(time=("t", "s", "time"), **roles))
    [record] = lumbar.read(written(tmp_path, "t,ox,oz,iz,ix"), layout=layout)
    assert record.axes == ("x", "z")
    assert record["input_z"] == pytest.approx(column("iz"), abs=1e-8)


def test_records_of_one_set_have_the_same_axes(tmp_path):
    one = written(tmp_path, FULL)
    other = written(tmp_path, "time_s,position_mm,force_N", name="other.csv")
    assert has_tokens(refusal(lumbar.read, [one, other]), "other … axis … x, y, z … trial")


def test_study_with_axes_has_no_default_columns(tmp_path):
    lines = [
        f"{side}_{axis}: {{column: {side[0]}{axis}, unit: mm}}"
        for side in ("input", "output")
        for axis in "xy"
    ]
    study = tmp_path / "study.yaml"
    study.write_text("tissue:\n  layout:\n    columns:\n      " + "\n      ".join(lines))
    assert list(lumbar.load_settings(study).tissue.layout.columns) == [
        "time",
        *(line.split(":")[0] for line in lines),
    ]
    study.write_text(study.read_text() + "\n      input: {column: z, unit: mm}")
    message = refusal(lumbar.load_settings, study)
    assert has_tokens(message, f"{study}, line 3: tissue.layout.columns: … input … axes")
