"""Snakemake and the scripts of its jobs, each forked from one process that has imported their libraries: seconds less each.

What `run` starts runs as ``python -m snakemake`` does, its scripts as they are, in processes of their own; pictures are sketched.
"""

import multiprocessing
import os
import runpy
import sys
from collections.abc import Sequence
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from pathlib import Path

from pictures import sketched

SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload(
    [
        "snakemake.cli",
        "snakemake.report.html_reporter",
        "snakemake.scheduling.job_scheduler",
        "snakemake.script",
        "smart_open",
        "pandas",
        "pydantic",
        "scipy.signal",
        "scipy.integrate",
        "matplotlib.backends.backend_pdf",
        "matplotlib.backends.backend_svg",
        "fontTools.subset",
        "bokeh.embed",
        "bokeh.plotting",
        "clarabel",
        "control",
        "jinja2",
        "c3d",
    ]
)


def run(folder: Path, arguments: Sequence[str], environment: dict[str, str], output: Path) -> int:
    """Run Snakemake in a folder with all its variables; what it and its jobs say is added to a file. Return its status."""
    forkserver.ensure_running()
    address = forkserver._forkserver._forkserver_address
    process = SERVER.Process(target=_snakemake, args=(folder, list(arguments), environment, output, address))
    process.start()
    process.join()
    return process.exitcode


def _at(folder: Path, environment: dict[str, str], output: Path) -> None:
    """Become what a program started there would be."""
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    with output.open("ab") as stream:
        os.dup2(stream.fileno(), 1)
        os.dup2(stream.fileno(), 2)
    # The project's library is that of the folder; this file, last, is what scripts begin in.
    here = Path(__file__).parent
    others = [path for path in sys.path if Path(path) not in (Path(), here, here.parent / "workflow")]
    sys.path[:] = [str(folder), *others, str(here)]


def _snakemake(folder, arguments, environment, output, address) -> None:
    from snakemake.cli import main
    from snakemake.script import PythonScript

    # The scripts are forked from the same process.
    forkserver._forkserver._forkserver_address = address
    forkserver._forkserver.ensure_running = lambda: None
    _at(folder, environment, output)
    PythonScript.execute_script = lambda script, name, edit=False: execute_script(script, name, output)
    sys.argv = ["snakemake", *arguments]
    main()


def _script(begin: Connection, path: str, folder: Path, environment: dict[str, str], output: Path) -> None:
    """Run a script as Python would when started with its path."""
    begin.recv()
    _at(folder, environment, output)
    sys.argv = [path]
    with sketched():
        runpy.run_path(path, run_name="__main__")


def execute_script(script, path: str, output: Path) -> None:
    """In place of `snakemake.script.PythonScript.execute_script`."""
    from run.job_forks import run_forked  # of the folder's workflow

    arguments = (path, Path.cwd(), dict(os.environ), output)
    run_forked(SERVER, _script, arguments, script.bench_record)
