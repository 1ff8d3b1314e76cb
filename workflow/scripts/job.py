"""Logging, errors and typed parameters around the library call of a script."""

import os
import signal
import sys
import traceback

INTERRUPTED = 130
"""Exit status after Ctrl-C, the convention for programs ended by SIGINT."""


def stem(files) -> str:
    """Return the path without ending that the files of one artefact share."""
    return os.path.splitext(files[0])[0]  # noqa: PTH122 - a string, as outputs are


class _Tee:
    """Standard error that is also written to the rule's log."""

    def __init__(self, terminal, path):
        self.terminal = terminal
        self.path = path
        self.log = open(path, "w", encoding="utf-8")  # noqa: PTH123, SIM115 - open until `close`

    def write(self, text: str) -> int:
        self.terminal.write(text)
        self._to_log(lambda: self.log.write(text))
        return len(text)

    def flush(self) -> None:
        self.terminal.flush()
        self._to_log(lambda: self.log.flush())

    def close(self) -> None:
        self._to_log(lambda: self.log.close())

    def _to_log(self, action) -> None:
        """Write to the log; report a full disk a single time, so that the job's error stays visible."""
        if self.log is None:
            return
        try:
            action()
        except OSError as error:
            self.log = None
            self.terminal.write(f"{self.path}: {error.strerror}: the log ends here\n")


def run(main, snakemake) -> None:
    """Call a job's function; an error that the user can fix ends the job with only its message.

    Parameters
    ----------
    main : callable
        Takes ``input``, ``output`` and the rule's parameters by their names, settings as the classes of its annotations.
    snakemake : Script
        Object that Snakemake gives to a script.

    Warnings, progress and errors go to the rule's log file and to the terminal. Other exceptions are programming
    errors: they keep their traceback.
    """
    from lumbar.base.errors import user_message
    from run.jobs import end_with_parent

    end_with_parent()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # Snakemake ends a job by SIGTERM
    terminal = sys.stderr
    try:
        sys.stderr = _Tee(terminal, snakemake.log[0])
        main(snakemake.input, snakemake.output, **_typed_parameters(main, snakemake.params))
    except KeyboardInterrupt:
        print(f"{snakemake.rule}: interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except Exception as error:
        message = user_message(error)
        print(f"{snakemake.rule}: {message}" if message else traceback.format_exc(), file=sys.stderr)
        sys.exit(1)
    finally:
        if sys.stderr is not terminal:
            sys.stderr.close()
            sys.stderr = terminal


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
