"""What every script does around its one library call: logging, errors and progress."""

from __future__ import annotations

import os
import sys
import traceback


def stem(files) -> str:
    """Return the path without ending that the files of one artefact share."""
    return os.path.splitext(files[0])[0]  # noqa: PTH122 - a string, as outputs are


class _Tee:
    """Standard error that is kept in the rule's log and shown to the user."""

    def __init__(self, *streams):
        self.streams = streams

    def write(self, text: str) -> int:
        for stream in self.streams:
            stream.write(text)
        return len(text)

    def flush(self) -> None:
        for stream in self.streams:
            stream.flush()


def run(main, snakemake) -> None:
    """Call ``main(input, output, params)``; a `LumbarError` ends the job with its message alone.

    Warnings, progress and errors go to the rule's log file and to the terminal. Other exceptions are programming
    errors: they keep their traceback.
    """
    from lumbar.errors import LumbarError

    terminal = sys.stderr
    with open(snakemake.log[0], "w", encoding="utf-8") as log:  # noqa: PTH123 - must stay open while tee'd
        sys.stderr = _Tee(terminal, log)
        try:
            main(snakemake.input, snakemake.output, snakemake.params)
        except LumbarError as error:
            print(f"{snakemake.rule}: {error}", file=sys.stderr)
            sys.exit(1)
        except Exception:
            traceback.print_exc()
            sys.exit(1)
        finally:
            sys.stderr = terminal
