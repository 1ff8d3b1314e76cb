"""The loop as the pages show it, compare, locate, refine and export: its commands run, in their order, on a folder of records."""

import json
import re
import shlex

import pytest

from column_files import write_records
from lumbar.twin.examples import example_records

LOOP = ("compare", "locate", "refine", "export")


def commands(page: str) -> list[list[str]]:
    """Commands of the loop in the code blocks of a page, without their remarks."""
    blocks = re.findall(r"^```\n(.*?)^```", page, flags=re.M | re.S)
    lines = [line for block in blocks for line in block.splitlines() if line.startswith("lumbar ")]
    split = [shlex.split(line, comments=True)[1:] for line in lines]
    return [command for command in split if command[0] in LOOP]


def section(page: str, start: str, stop: str) -> str:
    return page[page.index(start) : page.index(stop)]


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("page", "start", "stop", "folder"),
    [
        ("docs/index.md", "### What is your model missing?", "### From Python", "FOLDER"),
        ("docs/tissue/tutorial.md", "## 1. ", "## 5. ", "results/thesis/twin/two_hidden_effects"),
    ],
)
def test_the_loop_runs_as_it_stands(run, project, monkeypatch, tmp_path, page, start, stop, folder):
    monkeypatch.chdir(tmp_path)
    write_records(tmp_path / folder, example_records(), "%.8f")
    listed = commands(section((project / page).read_text(encoding="utf-8"), start, stop))
    assert set(LOOP) <= {command[0] for command in listed}
    for command in listed:
        status, out, err = run(*command, *(["--target", "host"] if command[0] == "export" else []))
        assert status == 0, (command, err)
        if command[0] == "refine":
            models = json.loads((tmp_path / "out" / "refined.json").read_text(encoding="utf-8"))["models"]
            assert f"+ {command[-3]}: " in out and "\nNoise floor: " in out and "\nVerdict: " in out
            assert "out/ladder.svg" in out and (tmp_path / "out" / "ladder.svg").is_file()
        if command[0] == "locate":
            assert out.splitlines()[0].startswith("All 2 records: ")
    made = {path.name for path in (tmp_path / "fmu").iterdir()}
    assert made == {f"{models[-1]['name']}_fmi{version}.fmu" for version in (2, 3)}
