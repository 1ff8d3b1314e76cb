"""The notebooks run from top to bottom in an empty folder, and are kept without what they printed."""

import nbformat
import pytest

from case_tables import cases
from generate.thesis_items import DOCS

FOLDER = DOCS.parent / "examples" / "notebooks"
PRINTED = cases(__file__, "printed")
"""What its text speaks of, in this order."""


def test_every_notebook_is_tried():
    assert {path.stem for path in FOLDER.glob("*.ipynb")} == set(PRINTED)


@pytest.mark.parametrize("name", PRINTED)
def test_notebook_has_no_outputs_and_states_its_data(name):
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    nbformat.validate(notebook)
    assert "synthetic twin" in notebook.cells[0].source
    assert all(
        not cell.outputs and cell.execution_count is None
        for cell in notebook.cells
        if cell.cell_type == "code"
    )


@pytest.mark.parametrize(
    "name", ["own_tissue_test", "own_lift", pytest.param("own_effect_to_fmu", marks=pytest.mark.nightly)]
)
def test_a_notebook_runs(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    space = {"__name__": "__main__"}
    for cell in nbformat.read(FOLDER / f"{name}.ipynb", as_version=4).cells:
        if cell.cell_type == "code":
            exec(compile(cell.source, f"{name}:{cell.id}", "exec"), space)
    printed = capsys.readouterr().out
    places = [printed.find(words) for words in PRINTED[name]]
    assert -1 not in places and places == sorted(places)
