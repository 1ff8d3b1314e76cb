"""``lumbar signals``: excitation signals for a testing machine."""

from __future__ import annotations

from pathlib import Path

from lumbar.cli.options import add_output, new_command
from lumbar.study.load_study import load_settings


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "signals",
        "excitation signals (multisine, noise, chirp) for a testing machine",
        "lumbar signals --band 5 --output signals\n"
        "  lumbar signals --bandwidth out/bandwidth.json --output signals",
    )
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--band", type=float, metavar="HZ", help="upper end of the band to excite")
    source.add_argument(
        "--bandwidth", type=Path, metavar="JSON", help="take it from 'lumbar bandwidth --output'"
    )
    add_output(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Design the signals, check them against the machine, write them."""
    from lumbar.interface.surgeons import design_signals

    settings = load_settings(*options.config)
    band = options.bandwidth if options.band is None else options.band
    found = design_signals(band, settings=settings.signals, seed=settings.seed)
    found.save(options.output)
    print(f"{found}, in {options.output}")
