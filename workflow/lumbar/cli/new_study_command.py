"""``lumbar new-study``: from a folder of lifting recordings to a study and subjects that a person completes."""

from __future__ import annotations

from pathlib import Path

from lumbar.cli.options import new_command


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "new-study",
        "commented study and subject files for a folder of lifting recordings; what only a person knows is marked FILL_IN",
        "lumbar new-study recordings --name my_lab",
    )
    parser.add_argument(
        "folder",
        type=Path,
        metavar="FOLDER",
        help="marker files (C3D, TRC, BVH, CSV, MAT; .gz too); a folder below it is a person",
    )
    parser.add_argument("--name", metavar="NAME", help="of the study (default: the folder's)")
    parser.add_argument(
        "--project",
        type=Path,
        default=Path(),
        metavar="DIR",
        help="folder of the workflow: config/studies and config/subjects lie below it (default: here)",
    )
    parser.set_defaults(run=run)


def run(options) -> None:
    """Look at the recordings, write the files, say what is to be filled in."""
    from lumbar.interface.new_study import new_study

    study = new_study(options.folder, options.name)
    study.save(options.project)
    print(study)
