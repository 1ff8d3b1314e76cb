"""A library that ``lumbar render`` plays is confined as one under check is: it reads and writes nothing, and ends alone."""

import os
import sys

import pytest

from lumbar.base import confined, landlock
from lumbar.base.errors import InputError
from lumbar.settings.runtime import RuntimeSettings
from lumbar.tissue.fmu.check.instance import Instance
from lumbar.tissue.haptics import judgement
from lumbar.tissue.haptics.judgement import judge_fmu

ON_LINUX = pytest.mark.skipif(sys.platform != "linux", reason="plays libraries for Linux")
NAME = "KB+coulomb_friction"


@pytest.fixture
def rendered(fmu_folder, zig_cache, monkeypatch):
    """Render an FMU in two ways, its library doing something at every sample but under check."""
    settings = RuntimeSettings(compiler_cache=str(zig_cache))
    path = fmu_folder / f"{NAME}_fmi3.fmu"
    # What is patched is there in a fork of this process, not of the template, which other tests' threads would make it ask.
    monkeypatch.setattr(confined, "_has_threads", lambda: False)

    def render(do, way):
        sample, here = Instance.sample, os.getpid()

        def hostile(self, position):
            assert os.getpid() != here, "it is played in this process"
            do()
            return sample(self, position)

        if way == "its answers":
            check = judgement.unpacked

            def unpacked(path):
                monkeypatch.setattr(Instance, "sample", hostile)
                return check(path)

            monkeypatch.setattr(judgement, "unpacked", unpacked)
            return judge_fmu(path, settings, trust=True)
        monkeypatch.setattr(Instance, "sample", hostile)
        return judge_fmu(path, settings)  # by its record, which the library is

    return render


WAYS = pytest.mark.parametrize("way", ["its answers", "in the loop"])


@ON_LINUX
@WAYS
def test_it_reads_and_writes_nothing(rendered, way, tmp_path):
    if not landlock.version():
        pytest.skip("this kernel has no Landlock")
    canary, marker = tmp_path / "canary", tmp_path / "marker"
    canary.write_text("4711")

    def hostile():
        for path, mode in ((canary, "r"), (marker, "w")):
            with pytest.raises(PermissionError):
                path.open(mode)
        if os.path.lexists(marker):
            os.abort()

    rendered(hostile, way)
    assert not marker.exists()


@ON_LINUX
@WAYS
@pytest.mark.parametrize(
    ("do", "words"),
    [
        (os.abort, r"KB\+coulomb_friction_fmi3\.fmu: the library crashes with SIGABRT"),
        (lambda: os._exit(0), r"_fmi3\.fmu: the library ends the program that plays it"),
        (lambda: bytearray(10**9), r"_fmi3\.fmu: the library takes more memory than 500 MB"),
    ],
    ids=["crash", "end", "memory"],
)
def test_it_ends_alone_and_is_told(rendered, way, do, words):
    with pytest.raises(InputError, match=words):
        rendered(do, way)
