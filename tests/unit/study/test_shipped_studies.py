"""Studies of config/studies in a fresh clone: one has its recording, the others say where theirs are obtained."""

import pytest

import lumbar
from lumbar.base.errors import InputError
from lumbar.interface.reading import read_listed
from lumbar.study.load_study import load_study_file
from refusing import has_tokens


def test_shipped_recording_is_that_of_a_maxwell_model(project, monkeypatch):
    """An independent fit of the record gives a stiffness of 2.053 and a relaxation time of 2.000 s."""
    monkeypatch.delenv("LUMBAR_DATA", raising=False)
    study = load_study_file(project, project / "config" / "studies" / "rheos.yaml")
    tissue = study.settings.tissue
    paths = [study.recording(record.file) for record in tissue.records]
    records = read_listed(paths, tissue.records, tissue.layout, tissue.rate_Hz)
    diagnosis = lumbar.diagnose(records, settings=study.settings)
    assert diagnosis.status == "adequate" and diagnosis.model.base == "Maxwell"
    found = {parameter.name: parameter for parameter in diagnosis.model.parameters}
    for name, value in {"branch_stiffness": 2.053, "relaxation_time": 2.0}.items():
        assert found[name].low < value < found[name].high


@pytest.mark.parametrize(
    ("name", "tokens"),
    [
        ("davinci_tool", "ODbL … MRDLab/mis-tool-characterization … davinci_tool_friction"),
        ("friction_damper", "CC BY-SA … ARTS-Laboratory/ … friction_damper"),
        ("box_transfer", "GPL-3.0 … pyomeca/ezc3d-testFiles … lifting/s2m_box_transfer"),
    ],
)
def test_study_without_its_recordings_says_where_to_obtain_them(project, tmp_path, monkeypatch, name, tokens):
    study = project / "config" / "studies" / f"{name}.yaml"
    for root, problem in ((tmp_path / "none", "no folder"), (tmp_path, "does not contain")):
        monkeypatch.setenv("LUMBAR_DATA", str(root))
        with pytest.raises(InputError) as error:
            load_study_file(project, study)
        assert "1 problem" in str(error.value)
        assert has_tokens(str(error.value), f"{name}.yaml, line … data_root: … {problem} … {tokens}")
