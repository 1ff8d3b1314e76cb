"""Fixtures of several folders: FMUs and lifts of the twin, made once, and the command."""

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from unittest import mock

import numpy as np
import pytest
from effect_entries import effect_entry
from runtime_models import SETTINGS, export, models_json, selected, unzipped

from running import ZIG_CACHE
from study_settings import changed, study_settings


@pytest.fixture(scope="session")
def zig_cache():
    """Return the cache that the workflow uses too; a cold one costs seconds and has a test of its own."""
    return ZIG_CACHE


@contextmanager
def sketched() -> Iterator[None]:
    """Let Matplotlib neither solve constrained layouts nor write more of a PDF file than its first bytes."""
    from matplotlib.backends.backend_pdf import FigureCanvasPdf
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    with (
        mock.patch.object(ConstrainedLayoutEngine, "execute", lambda engine, figure: None),
        mock.patch.object(
            FigureCanvasPdf, "print_pdf", lambda canvas, path, **options: path.write_bytes(b"%PDF-")
        ),
    ):
        yield


@pytest.fixture(scope="module", autouse=True)
def pictures_are_sketched(request):
    """How pictures look is asked in reports/ only; elsewhere they only have to be there."""
    with nullcontext() if request.path.parent.name == "publishing" else sketched():
        yield


@pytest.fixture(scope="session")
def examples():
    """Return two records of the synthetic twin."""
    from lumbar.twin.examples import example_records

    return example_records()


@pytest.fixture(scope="session")
def fmu_models():
    """Return models for export."""

    return selected(models_json(), SETTINGS)


@pytest.fixture(scope="session")
def fmu_folder(fmu_models, share_result):
    """Return a folder with the FMUs of the shared models and of one with an effect and an awkward name."""

    def make(folder):
        export(fmu_models, folder)
        awkward = models_json(effect_entry("KB", "coulomb_friction/coulomb"))
        chosen = selected(awkward, changed(SETTINGS, models=["KB+coulomb_friction"], moving_average_ms=0))
        export(chosen, folder, "A & B <lab>")

    return share_result("fmu", make)[0]


@pytest.fixture
def fmu_instance(fmu_folder, tmp_path):
    """Return a function that instantiates an FMU; all instances are freed at the end."""
    from lumbar.tissue.fmu.instance import Instance, UnzippedFmu

    made = []

    def instantiate(name: str, version: int, event_mode: bool = False, folder=fmu_folder):
        path = folder / f"{name}_fmi{version}.fmu"
        fmu = UnzippedFmu(unzipped(path, tmp_path / "unzipped" / folder.name / path.stem))
        made.append(Instance(fmu, event_mode))
        return made[-1].slave

    yield instantiate
    for instance in made:
        instance.free()


@pytest.fixture(scope="session")
def fmu_positions():
    """Return positions of a random walk in mm."""
    return np.cumsum(np.random.default_rng(7).standard_normal(200)) * 0.2


@pytest.fixture(scope="session")
def twin_lift(tmp_path_factory):
    """Return a function that gives the marker file of a lift of the synthetic twin."""
    from lumbar.twin.lifting_recordings import write_lift

    folder = tmp_path_factory.mktemp("twin")

    def written(name: str):
        path = folder / f"{name}.c3d"
        if not path.exists():
            write_lift(study_settings().twin.lifting, name, [3], path, None)
        return path

    return written


class Command:
    """Calls the command in this process."""

    def __init__(self, capsys):
        self.capsys = capsys

    def __call__(self, *arguments) -> tuple[int, str, str]:
        """Return its exit status, standard output and standard error."""
        from lumbar import cli

        try:
            status = cli.main([str(argument) for argument in arguments])
        except SystemExit as end:
            status = end.code
        captured = self.capsys.readouterr()
        return status, captured.out, captured.err

    def done(self, *arguments) -> str:
        """Return what it prints; it must do what it is asked."""
        status, out, err = self(*arguments)
        assert status == 0, err
        return out

    def refused(self, *arguments) -> str:
        """Return its refusal, of status 1 and without a traceback."""
        status, _, err = self(*arguments)
        assert status == 1 and "Traceback" not in err
        return err


@pytest.fixture
def run(capsys) -> Command:
    return Command(capsys)


@pytest.fixture(scope="module")
def functions(zig_cache, tmp_path_factory):
    """Elementary functions as the C code of FMUs computes them."""
    from c_programs import portable_functions

    return portable_functions(tmp_path_factory.mktemp("math"), zig_cache)
