"""Logging, errors and typed parameters around the library call of a script."""

import os
import signal
import sys
import traceback
from contextlib import redirect_stderr, redirect_stdout

INTERRUPTED = 130
"""Exit status after Ctrl-C, the convention for programs ended by SIGINT."""


def stem(files) -> str:
    """Return the path without ending that the files of one artefact share."""
    return os.path.splitext(files[0])[0]  # noqa: PTH122 - a string, as outputs are


class _Log:
    """Standard output and error of a job: the rule's log file."""

    def __init__(self, path, terminal):
        self.path = path
        self.terminal = terminal
        self.file = open(path, "w", encoding="utf-8")  # noqa: PTH123, SIM115 - open until `close`

    def write(self, text: str) -> int:
        self._try(lambda: self.file.write(text))
        return len(text)

    def flush(self) -> None:
        self._try(lambda: self.file.flush())

    def close(self) -> None:
        self._try(lambda: self.file.close())

    def isatty(self) -> bool:
        return False

    def show(self, error: str, status: int = 1) -> int:
        """Write an error to the log and to the terminal; return the exit status."""
        self.write(f"{error}\n")
        print(error, file=self.terminal)
        return status

    def _try(self, action) -> None:
        """Write to the file; report a full disk a single time, so that the job's error stays visible."""
        if self.file is None:
            return
        try:
            action()
        except OSError as error:
            self.file = None
            self.terminal.write(f"{self.path}: {error.strerror}: the log ends here\n")


def run(main, snakemake) -> None:
    """Call a job's function; an error that the user can fix ends the job with only its message.

    Parameters
    ----------
    main : callable
        Takes ``input``, ``output`` and the rule's parameters by their names, settings as the classes of its annotations.
    snakemake : Script
        Object that Snakemake gives to a script.

    Warnings and progress go to the rule's log file, errors to the terminal too. Other exceptions are programming
    errors: they keep their traceback.
    """
    from lumbar.base.errors import user_message
    from run.jobs import end_with_parent

    end_with_parent()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # Snakemake ends a job by SIGTERM
    status = 0
    log = _Log(snakemake.log[0], sys.stderr)
    try:
        with redirect_stdout(log), redirect_stderr(log):
            main(snakemake.input, snakemake.output, **_typed_parameters(main, snakemake.params))
    except KeyboardInterrupt:
        status = log.show(f"{snakemake.rule}: interrupted", INTERRUPTED)
    except Exception as error:
        message = user_message(error)
        status = log.show(f"{snakemake.rule}: {message}" if message else traceback.format_exc())
    finally:
        log.close()
    if status:
        sys.exit(status)


def _log_failed_import(kind, error, trace) -> None:
    """Write an error before `run`, such as a failed import of the script, to the rule's log and to the terminal."""
    import __main__

    with open(__main__.snakemake.log[0], "w", encoding="utf-8") as log:  # noqa: PTH123 - pathlib is not imported yet
        traceback.print_exception(kind, error, trace, file=log)
    sys.__excepthook__(kind, error, trace)


if "snakemake" in vars(sys.modules["__main__"]):  # a script of a rule, which imports this module first
    sys.excepthook = _log_failed_import


def _typed_parameters(main, params) -> dict:
    """Return the rule's parameters with the types that `main` declares; ``code`` only re-runs a job if its code changes.

    Raises
    ------
    TypeError
        If the rule passes other parameters than the job takes.
    """
    from typing import get_type_hints

    from pydantic import TypeAdapter

    from lumbar.settings.section import remove_defaults

    kinds = {name: kind for name, kind in get_type_hints(main).items() if name != "return"}
    given = {name: value for name, value in params.items() if name != "code"}
    if kinds.keys() != given.keys():
        raise TypeError(
            f"the rule passes {', '.join(sorted(given))}; the job takes {', '.join(sorted(kinds))}"
        )
    return {
        name: remove_defaults(TypeAdapter(kind).validate_python(given[name])) for name, kind in kinds.items()
    }
