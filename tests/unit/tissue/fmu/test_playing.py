"""What is said when the process that plays libraries does not come back."""

from __future__ import annotations

import sys

import pytest

from lumbar.base.errors import InputError
from lumbar.tissue.fmu.check.playing import played


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-in for Python is a shell script")
def test_no_library_is_blamed_for_a_check_that_is_killed_from_outside(tmp_path, monkeypatch):
    killed = tmp_path / "killed"
    killed.write_text("#!/bin/sh\nkill -9 $$\n")
    killed.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(killed))
    with pytest.raises(InputError, match="killed from outside"):
        played([(tmp_path,)], tmp_path)
