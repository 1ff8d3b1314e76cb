"""Functions on records of several axes: the diagnosis and its page, or an error."""

import pytest

import lumbar
from space_records import FRICTION, POSITION, TIME, record, record_of

SETTINGS = lumbar.StudySettings(improvement=lumbar.ImprovementSettings(base="LE", most_effects=1))


@pytest.fixture(scope="module")
def diagnosis():
    return lumbar.diagnose([record(FRICTION)], settings=SETTINGS, source_label="made up")


@pytest.mark.nightly
def test_page_shows_axes_effect_and_pictures(diagnosis, tmp_path):
    assert diagnosis.selected == ("coulomb_friction",)
    diagnosis.save(tmp_path)
    page = (tmp_path / "diagnosis.html").read_text(encoding="utf-8")
    assert diagnosis.sentences[0] in page
    assert all(diagnosis.axes_table.header(name) in page for name in diagnosis.axes_table.first)
    assert "N/mm" in page and page.count("<figure>") == 4
    written = {path.name for path in tmp_path.iterdir()}
    assert {"location.csv", "comparison.svg", "refined.json", "principal_axes.csv"} <= written


def test_positions_may_count_from_a_distant_origin(diagnosis, tmp_path):
    moved = record(FRICTION)
    foot = dict(zip("xyz", (300.0, -450.0, 120.0), strict=True))
    moved = moved.with_values(**{f"input_{axis}": moved[f"input_{axis}"] + at for axis, at in foot.items()})
    result = lumbar.diagnose([moved], settings=SETTINGS, source_label="made up")
    assert result.selected == ("coulomb_friction",)
    (offset,) = [item for item in result.result.findings if item.kind == "position_offset"]
    assert offset.sentence == result.sentences[2]
    assert result.model.rests == pytest.approx(tuple(foot.values()), abs=0.1)
    result.save(tmp_path, pictures=False)
    read = lumbar.load_models(tmp_path / "refined.json")[-1]
    assert read.rests == result.model.rests and read.zeros == result.model.zeros
    assert not diagnosis.model.rests


@pytest.mark.parametrize("function", ["identify", "propose"])
def test_functions_of_one_axis_reject_several(function):
    with pytest.raises(lumbar.InputError, match=rf"multisine: .*\b{function}\b.*\bcompare, locate\b"):
        getattr(lumbar, function)([record(FRICTION)])


def test_spatial_diagnosis_has_no_interactive_page_and_no_law(diagnosis):
    with pytest.raises(lumbar.InputError, match=r"records .*\baxes\b"):
        diagnosis.page()
    with pytest.raises(lumbar.InputError, match=r"\bpropose\b.*\baxis\b"):
        diagnosis.propose()


def test_effect_along_an_unrecorded_axis_is_rejected(tmp_path):
    effect_file = tmp_path / "y_spring.yaml"
    parameter = '{name: cubic_stiffness, unit: "{y}/{x}^3"}'
    form = f"{{name: cubic, equation: ky*z_y**2*z, parameters: {{ky: {parameter}}}}}"
    effect_file.write_text(
        f"name: y_spring\nmechanism: It stiffens along y.\nsource: made up\nforms: [{form}]\n"
    )
    settings = SETTINGS.model_copy(
        update={"improvement": SETTINGS.improvement.model_copy(update={"effect_files": (str(effect_file),)})}
    )
    flat = record_of("flat", TIME, POSITION[:2], record(FRICTION).stacked("output")[:2], "xz")
    with pytest.raises(lumbar.InputError, match=r"\by_spring\b.*\bx, z\b"):
        lumbar.refine([flat], ["y_spring"], settings=settings)
