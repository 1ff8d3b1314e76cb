"""Workers of a session share what one of them made, or the reason why it could not be made."""

import multiprocessing
from pathlib import Path

import pytest

from making_once import MadeOnce

WORKERS = 4


def slowly_made(folder: Path) -> int:
    """Count calls beside the folder, and give the others time to come too."""
    with (folder.parent / "calls").open("a") as calls:
        calls.write("x")
    multiprocessing.Event().wait(0.3)
    (folder / "file").write_text("whole")
    return 42


def ask(root: Path) -> tuple[str, int]:
    folder, made = MadeOnce(root)("thing", slowly_made)
    return (folder / "file").read_text(), made


def test_workers_that_ask_at_once_share_one_thing(tmp_path):
    with multiprocessing.get_context("spawn").Pool(WORKERS) as pool:
        answers = pool.map(ask, [tmp_path] * WORKERS, chunksize=1)
    assert answers == [("whole", 42)] * WORKERS
    assert (tmp_path / "calls").read_text() == "x"


def test_names_are_told_apart(tmp_path):
    once = MadeOnce(tmp_path)
    folders = [once(name, lambda folder: folder.name) for name in ("a", "b", "a")]
    assert folders == [(tmp_path / name, name) for name in ("a", "b", "a")]


def test_a_failure_is_told_to_everybody_and_not_tried_again(tmp_path):
    calls = []

    def fail(folder):
        calls.append(folder)
        raise ValueError("no basin")

    for _ in range(2):
        with pytest.raises(AssertionError, match="thing: ValueError: no basin"):
            MadeOnce(tmp_path)("thing", fail)
    assert len(calls) == 1
