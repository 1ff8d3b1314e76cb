"""The ``lumbar`` command, which applies the steps of the workflow to files and folders."""

from lumbar.cli.command import main

__all__ = ["main"]
