"""``lumbar inspect``: what is in marker files, what is wrong with them, what the pipeline makes of them."""

from __future__ import annotations

from pathlib import Path

from lumbar.base.errors import InputError, Problems
from lumbar.cli.options import new_command
from lumbar.study.load_study import load_settings


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "inspect",
        "say what is in marker files, what is wrong with them and what the pipeline makes of them",
        "lumbar inspect expert_23kg.c3d --height 1.75 --picture expert_23kg.svg",
    )
    parser.add_argument(
        "files",
        type=Path,
        nargs="+",
        metavar="FILE",
        help="C3D, TRC, CSV, MAT or BVH file with markers (.gz too)",
    )
    parser.add_argument(
        "--height", type=float, metavar="M", help="stature: lengths of the body are compared with it"
    )
    parser.add_argument("--json", action="store_true", help="print a list of JSON objects, one per file")
    parser.add_argument(
        "--picture",
        type=Path,
        metavar="FILE",
        help="draw heights, gaps and findings of one file as .svg or .pdf",
    )
    parser.set_defaults(run=run)


def run(options) -> None:
    """Inspect the files, print what was found, draw it where asked; files that cannot be read come last."""
    import json

    from lumbar.interface.inspecting import check_picture, inspect

    if options.picture and len(options.files) > 1:
        raise InputError(f"--picture draws one file; {len(options.files)} are given")
    if options.picture:
        check_picture(options.picture)
    settings = load_settings(*options.config).lifting if options.config else None
    problems, found = Problems("files"), []
    for path in options.files:
        try:
            found.append(inspect(path, settings=settings, height_m=options.height))
        except InputError as error:
            problems.add("", str(error))
    if options.json:
        print(json.dumps([one.as_dict() for one in found], indent=2))
    else:
        print("\n\n".join(map(str, found)))
    if options.picture and found:
        found[0].save_picture(options.picture)
    problems.raise_if_any()
