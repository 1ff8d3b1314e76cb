"""``lumbar signals``: excitation signals for a testing machine."""

from __future__ import annotations

from pathlib import Path

from lumbar.cli.settings import add_output, load_settings, new_command


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
    from lumbar.errors import InputError
    from lumbar.files import read_json, write_csv, write_json
    from lumbar.signals.excitation import design_excitation, excited_band
    from lumbar.signals.signal_properties import machine_file, multisine_description, signal_properties

    settings = load_settings(options.config)
    signals = settings.signals
    band = options.band
    if band is None:
        band = excited_band(read_json(options.bandwidth), signals)
    elif not 0 < band < signals.rate_Hz / 2:
        raise InputError(f"--band is {band:g} Hz; allowed: above 0 and below {signals.rate_Hz / 2:g} Hz")
    excitation = design_excitation(band, signals, settings.seed)
    for signal in excitation.signals:
        write_csv(options.output / f"{signal.name}.csv", machine_file(signal))
    write_json(options.output / "multisine.json", multisine_description(excitation, signals))
    table = signal_properties(excitation, "")
    write_csv(options.output / "properties.csv", table.frame)
    names = ", ".join(f"{signal.name}.csv" for signal in excitation.signals)
    print(f"{names}: excited up to {band:g} Hz, in {options.output}")
