"""``lumbar bandwidth``: bandwidth of surgeons' tool motion."""

from __future__ import annotations

from pathlib import Path

from lumbar.cli.options import add_data, add_output, new_command
from lumbar.study.load_study import load_settings


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "bandwidth",
        "bandwidth of surgeons' tool motion by Welch's method, with intervals",
        "lumbar bandwidth recordings/surgeon --output out",
    )
    parser.add_argument(
        "folder",
        type=Path,
        metavar="FOLDER",
        help="one file per trial (time_s,z_mm unless the layout says otherwise); the part of its name before "
        "'_trial' is the surgeon",
    )
    add_output(parser, required=False)
    add_data(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Print the bandwidths; write them and the spectra where a folder is given."""
    from lumbar.interface.reading import read
    from lumbar.interface.surgeons import bandwidth

    settings = load_settings(*options.config)
    surgeon, data = settings.surgeon, options.data or options.folder.name
    trials = read(options.folder, layout=surgeon.layout, rate=surgeon.rate_Hz)
    found = bandwidth(trials, settings=surgeon, seed=settings.seed, data=data)
    print(found)
    if options.output:
        found.save(options.output)
