"""``lumbar bandwidth``: bandwidth of surgeons' tool motion."""

from __future__ import annotations

from pathlib import Path

from lumbar.cli.settings import add_data, add_output, load_settings, new_command, record_files


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
    from lumbar.files import write_csv, write_json
    from lumbar.records.columns import read_record
    from lumbar.settings.plain import plain
    from lumbar.signals.surgeon_motion import (
        motion_bandwidths,
        motion_spectra,
        spectra_table,
    )

    settings = load_settings(options.config)
    surgeon = settings.surgeon
    files = record_files(options.folder)
    records = [read_record(path, surgeon.layout, rate=surgeon.rate_Hz) for path in files]
    surgeons = [record.name.split("_trial")[0] for record in records]
    spectra = motion_spectra(records, surgeons, surgeon.welch)
    bandwidths = motion_bandwidths(spectra, surgeon.bandwidth, settings.seed)
    for quantity in spectra.psd:
        for rule, value in bandwidths[quantity].items():
            print(f"{quantity}, {rule}: {_text(value)}")
    if options.output:
        label = {"data": options.data or options.folder.name}
        write_json(options.output / "bandwidth.json", {**bandwidths, "welch": plain(surgeon.welch), **label})
        write_csv(options.output / "psd.csv", spectra_table(spectra).assign(**label))


def _text(bandwidth: dict) -> str:
    if bandwidth["value_Hz"] is None:
        return "none within the analysis band"
    ends = [bandwidth["low_Hz"], bandwidth["high_Hz"]]
    interval = "no interval" if None in ends else f"interval {ends[0]:.3g} to {ends[1]:.3g} Hz"
    return f"{bandwidth['value_Hz']:.3g} Hz ({interval})"
