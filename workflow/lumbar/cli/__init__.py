"""The ``lumbar`` command: on files and folders what the workflow does on a study."""

from lumbar.cli.command import main

__all__ = ["main"]
