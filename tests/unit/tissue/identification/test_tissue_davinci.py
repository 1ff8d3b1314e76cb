"""A real surgical tool whose friction no linear model describes."""

import pytest

from lumbar.records.columns import read_record
from lumbar.tissue.identification.identify_tissue import identify
from study_settings import changed, study_settings


@pytest.fixture(scope="module")
def study(project, shared):
    settings = study_settings("studies/davinci_tool.yaml").tissue
    records = [
        read_record(shared / "real" / entry.file, settings.layout, entry.name, rate=settings.rate_Hz)
        for entry in settings.records[:3]
    ]
    return settings, records


def test_units_of_the_recording(study):
    """The header says sines of 30 degrees amplitude; the torque of the 40 % level stays below 0.15 N·m."""
    _, records = study
    for record in records:
        assert record["input"].max() - record["input"].min() == pytest.approx(60 * 3.14159 / 180, rel=0.02)
        assert abs(record["output"]).max() < 0.15
        assert record.sampling_time == pytest.approx(0.005)
        # 20 s at 200 Hz less the ends that the resampling filter cannot see whole.
        assert len(record) == 4000 - 20


def test_a_spring_explains_little_and_fits_on_one_sine_fail_on_another(study):
    settings, (slow, middle, fast) = study
    models, _ = identify(slow, [middle, fast], changed(settings, search={"order_max": 2}), 1)
    found = {(model.name, model.estimator): model for model in models}
    assert found["LE", "arx"].scores.vaf_percent < 40
    maxwell = found["Maxwell", "output_error"].scores
    assert maxwell.vaf_percent > 80
    # At three times the frequency the viscous stand-in for friction fails.
    assert maxwell.vaf_tests_percent[1] < 40
    assert found["HO", "arx"].scores.condition_number > 1e3
    assert "springs and dashpots need more than 0" in found["KB", "arx"].no_parameters_because
