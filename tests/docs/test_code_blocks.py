"""The code that README and pages show: Python runs, commands and targets are understood."""

import re
import shlex
from dataclasses import replace

import numpy as np
import pytest
import yaml

from column_files import write_columns, write_records
from generate.thesis_items import DOCS
from lumbar.cli.command import build_parser, command_names
from twin_examples import example_lift, example_records

PROJECT = DOCS.parent
PAGES = {
    path.relative_to(PROJECT).as_posix(): path.read_text(encoding="utf-8")
    for path in [PROJECT / "README.md", *sorted(DOCS.rglob("*.md"))]
}


def blocks(page: str, *languages: str) -> list[str]:
    """Contents of the code blocks in these languages; "" is one without."""
    found = re.findall(r"^ *```(\w*)[^\n]*\n(.*?)^ *```", page, flags=re.M | re.S)
    return [content for language, content in found if language in languages]


def command_lines(program: str) -> list[tuple[str, str]]:
    """Pages and lines of their blocks that call a program, continued lines joined."""
    return [
        (name, line.strip())
        for name, page in PAGES.items()
        for block in blocks(page, "", "sh")
        for line in block.replace("\\\n", " ").splitlines()
        if line.strip().startswith(program + " ")
    ]


COMMANDS = set(command_names())
LUMBAR = [
    (name, line)
    for name, line in command_lines("lumbar")
    if line.split()[1] in COMMANDS or line.split()[1].isidentifier()
]


@pytest.mark.parametrize(("name", "line"), LUMBAR, ids=[line[:60] for _, line in LUMBAR])
def test_a_command_is_understood(name, line):
    parsed = build_parser().parse_args(shlex.split(line, comments=True)[1:])
    assert parsed is not None


@pytest.mark.parametrize("program", ["make", "snakemake"])
def test_targets_and_files_of_commands_are_there(program):
    lines = command_lines(program)
    assert len(lines) > 3
    targets = set(re.findall(r"^([a-z-]+):", (PROJECT / "Makefile").read_text(encoding="utf-8"), flags=re.M))
    for name, line in lines:
        words = shlex.split(line, comments=True)[1:]
        if program == "make":
            assert {word for word in words if re.fullmatch("[a-z-]+", word)} <= targets, f"{name}: {line}"
        for word in words:
            if re.match("(config|examples)/.*ya?ml$", word) and "my_lab" not in word:
                assert (PROJECT / word).is_file(), f"{name}: {line}"


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    """A folder with what the pages' Python names: recordings, a lift, ratings of groups, the project's configuration."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "config").symlink_to(PROJECT / "config")
    multisine, other = example_records()
    named = (multisine, *(replace(other, name=name) for name in ("chirp", "noise")))
    write_records(tmp_path / "recordings", named, "%.8f")
    example_lift(tmp_path / "expert_23kg.c3d")
    person = example_lift(tmp_path / "trial.c3d")
    (tmp_path / "ann.yaml").write_text(
        yaml.safe_dump({"subject": person.model_dump(mode="json")}), encoding="utf-8"
    )
    position, force = (other[role][:600] for role in ("input", "output"))
    counts = {"time [s]": np.arange(600) / 200, "encoder [counts]": 100 * position}
    write_columns(tmp_path / "counts.csv", "%.6f", **counts, **{"torque transducer [V]": force / 35.15})
    generator = np.random.default_rng(1)
    people = [
        f"p{number},{group},23,margin,all,{generator.normal():.4f},m,higher"
        for number, group in enumerate("eeeeennnnn")
    ]
    head = "person,group,box_mass_kg,measure,plane,value,unit,safer"
    (tmp_path / "measures.csv").write_text("\n".join([head, *people]), encoding="utf-8")
    return tmp_path


SCRIPTS = {
    "README.md": "fmu/*_fmi3.fmu",
    "docs/lifting/measures.md": "comparison/*.csv",
    "docs/lifting/quality.md": "trial.c3d",
    "docs/python.md": "lift.html",
    "docs/tissue/import.md": "records/study.yaml",
}
"""Pages with Python, and what it leaves or reads."""
QUICK = {"docs/lifting/measures.md", "docs/lifting/quality.md", "docs/tissue/import.md"}


@pytest.mark.parametrize(
    "page", [pytest.param(page, marks=[] if page in QUICK else pytest.mark.nightly) for page in SCRIPTS]
)
def test_python_of_a_page_runs_as_it_stands(page, workplace):
    code = "\n".join(blocks(PAGES[page], "python"))
    exec(compile(code, page, "exec"), {"__name__": "__main__"})
    assert list(workplace.glob(SCRIPTS[page]))


def test_python_of_every_page_is_run():
    assert set(SCRIPTS) == {name for name, page in PAGES.items() if blocks(page, "python")}
