"""Files that are broken at random end in a recording or in a refusal that names them."""

import pytest
from fuzzed_files import LONGEST_S, read_any, read_changed, sound_files


def test_sound_files_are_read(tmp_path):
    """What is broken below is sound before."""
    for name, content in sound_files().items():
        (tmp_path / name).write_bytes(content)
        read_any(tmp_path / name)


@pytest.mark.statistical
def test_broken_files_end_in_a_recording_or_a_refusal(tmp_path):
    outcome = read_changed(tmp_path, 600, seed=7)
    assert outcome.failures == []
    assert sum(outcome.read.values()) + sum(outcome.refused.values()) == 600
    assert min(sum(outcome.read.values()), sum(outcome.refused.values())) > 50
    assert outcome.longest_s < LONGEST_S
