"""What every script does around its one library call: logging, errors and progress."""

import os
import signal
import sys
import traceback

INTERRUPTED = 130
"""Exit status after Ctrl-C, as of every program that SIGINT ends."""


def stem(files) -> str:
    """Return the path without ending that the files of one artefact share."""
    return os.path.splitext(files[0])[0]  # noqa: PTH122 - a string, as outputs are


class _Tee:
    """Standard error that is shown to the user and kept in the rule's log."""

    def __init__(self, terminal, path):
        self.terminal = terminal
        self.path = path
        self.log = open(path, "w", encoding="utf-8")  # noqa: PTH123, SIM115 - open as long as it is tee'd

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
        """On a full disk the terminal is told once, and the job's own error is not hidden behind the log's."""
        if self.log is None:
            return
        try:
            action()
        except OSError as error:
            self.log = None
            self.terminal.write(f"{self.path}: {error.strerror}: the log ends here\n")


def run(main, snakemake) -> None:
    """Call a job's function; an error that a user can mend ends the job with its message alone.

    Parameters
    ----------
    main : callable
        Takes ``input``, ``output`` and the rule's parameters by their names, settings as the classes of its annotations.

    Warnings, progress and errors go to the rule's log file and to the terminal. Other exceptions are programming
    errors: they keep their traceback.
    """
    from lumbar.base.errors import user_message
    from run.jobs import end_with_parent

    end_with_parent()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # which is how Snakemake ends a job
    terminal = sys.stderr
    try:
        sys.stderr = _Tee(terminal, snakemake.log[0])
        main(snakemake.input, snakemake.output, **_typed_parameters(main, snakemake.params))
    except KeyboardInterrupt:
        print(f"{snakemake.rule}: interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except Exception as error:
        told = user_message(error)
        print(f"{snakemake.rule}: {told}" if told else traceback.format_exc(), file=sys.stderr)
        sys.exit(1)
    finally:
        if sys.stderr is not terminal:
            sys.stderr.close()
            sys.stderr = terminal


def _typed_parameters(main, params) -> dict:
    """The rule's parameters as `main` names and annotates them; ``code`` is there to run the job again.

    Raises
    ------
    TypeError
        If the rule passes others than the job takes.
    """
    from typing import get_type_hints

    from pydantic import TypeAdapter

    from lumbar.settings.section import without_defaults

    kinds = {name: kind for name, kind in get_type_hints(main).items() if name != "return"}
    given = {name: value for name, value in params.items() if name != "code"}
    if kinds.keys() != given.keys():
        raise TypeError(
            f"the rule passes {', '.join(sorted(given))}; the job takes {', '.join(sorted(kinds))}"
        )
    return {
        name: without_defaults(TypeAdapter(kind).validate_python(given[name])) for name, kind in kinds.items()
    }
