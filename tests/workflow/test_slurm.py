"""A chapter through a SLURM of one node, its running job cancelled: tried again, and the same bytes as without SLURM."""

import pytest

from cluster.faults import CHAPTER, RESULTS, job_cancelled
from cluster.slurm_node import differing, obstacle, slurm_node
from running import copy_project, snakemake


@pytest.fixture
def node(tmp_path):
    missing = obstacle()
    if missing:
        pytest.skip(missing)
    with slurm_node(tmp_path / "node", 2) as node:
        yield node


def test_a_chapter_through_slurm_has_the_same_bytes_also_when_its_job_is_cancelled(node, tmp_path):
    expected, folder = (copy_project(tmp_path / name) for name in ("local", "slurm"))
    job_cancelled(node, folder)
    snakemake(expected, "--cores", "1", CHAPTER).whole()
    assert not differing(expected / RESULTS, folder / RESULTS)
