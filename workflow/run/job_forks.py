"""Scripts of a run on this machine, each forked from one process that has imported their libraries: seconds less a job.

What a job does stays the same: its script runs as it is, in a process of its own, with the same log and benchmark.
"""

import atexit
import multiprocessing
import os
import resource
import runpy
import signal
import subprocess
import sys
import threading
from multiprocessing import forkserver
from multiprocessing.connection import Connection, wait

_WORTH_IT = 4
"""Scripts from which on one import of all libraries takes less than every script's own."""
_SERVER = multiprocessing.get_context("forkserver")
_SERVER_GONE = 255
"""Exit code where the server was killed, which would have told it, and with it the process."""
_REAPING = threading.Lock()
"""Starting a process asks all others whether they have ended; of two threads that ask the same one, one is told of a failure."""


def fork_scripts(workflow) -> None:
    """Let the run that begins fork its scripts, where it has several and starts them itself.

    On a cluster, in a container or in a conda environment every script starts a Python of its own, as on other systems
    than Linux, whose libraries may hold threads that a fork does not survive.
    """
    from snakemake.script import PythonScript

    elsewhere = not workflow.local_exec or workflow.deployment_settings.deployment_method
    replaced = PythonScript.execute_script.__module__ != "snakemake.script"
    scripts = sum(job.rule.script is not None for job in workflow.dag.needrun_jobs())
    if sys.platform == "linux" and not elsewhere and not replaced and scripts >= _WORTH_IT:
        _SERVER.set_forkserver_preload(["run.job_libraries"])
        forkserver.ensure_running()
        PythonScript.execute_script = execute_script


def execute_script(script, path: str, edit: bool = False) -> None:
    """In place of `snakemake.script.PythonScript.execute_script`, which starts Python with the path of the script."""
    run_forked(_SERVER, _run, (path, str(script.resources["tmpdir"])), script.bench_record)


def run_forked(server, target, arguments: tuple, bench_record) -> None:
    """Run a function in a process of its own and measure it.

    `target` takes a connection, from which it receives once before it begins and to which it may send its processor seconds at
    the end, and the arguments, the first the script's path.

    Raises
    ------
    subprocess.CalledProcessError
        The process failed or was killed.
    """
    from snakemake.benchmark import benchmarked

    begin, measured = server.Pipe()
    process = server.Process(target=target, args=(begin, *arguments))
    with _REAPING:
        process.start()
    # A forked process is gone as soon as it ends: it waits until it is measured.
    with benchmarked(process.pid, bench_record), begin, measured:
        begin.close()  # the process holds the only other end
        measured.send(True)
        wait([process.sentinel])
        seconds = _received(measured)
    if bench_record is not None and seconds is not None:
        # What Snakemake samples, every half minute at last, lacked a quarter of the default study's processor time.
        bench_record.cpu_time, bench_record.cpu_usage = seconds, 100 * seconds
        bench_record.data_collected = True
    with _REAPING:
        process.join()
    if process.exitcode:
        status = -signal.SIGKILL if process.exitcode == _SERVER_GONE else process.exitcode
        raise subprocess.CalledProcessError(status, [sys.executable, arguments[0]])


def _received(measured: Connection) -> float | None:
    """Return what a process that has ended sent; None where it was killed or has nothing to say."""
    try:
        return measured.recv() if measured.poll() else None
    except (EOFError, ConnectionResetError):
        return None


def _run(begin: Connection, path: str, temporary: str) -> None:
    """Run a script as Python would when started with its path."""
    from run.jobs import end_with_parent

    # The server, once killed: Snakemake then holds the job for failed and removes its files.
    end_with_parent()
    # Snakemake, once killed: the server ends when nobody holds this pipe any more, and every forked process is given it.
    os.close(forkserver._forkserver._forkserver_alive_fd)
    begin.recv()
    os.environ.update(dict.fromkeys(("TMPDIR", "TMP", "TEMPDIR", "TEMP"), temporary))
    sys.argv = [path]
    try:
        runpy.run_path(path, run_name="__main__")
    finally:
        atexit._run_exitfuncs()  # a forked process ends without
        used = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
        begin.send(sum(item.ru_utime + item.ru_stime for item in used))
