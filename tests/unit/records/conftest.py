"""Fixtures of readers."""

import pytest


@pytest.fixture
def read_in_this_process(monkeypatch):
    """Read C3D files in this process; the child process has tests of its own and takes longer than all else."""
    monkeypatch.setattr("lumbar.records.markers.read_in_child", lambda read, path: read(path))
