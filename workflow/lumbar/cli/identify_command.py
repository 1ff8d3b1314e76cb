"""``lumbar identify``: viscoelastic models of a set of tissue tests."""

from __future__ import annotations

from lumbar.cli.options import add_data, add_folder, add_output, new_command
from lumbar.study.load_study import load_settings


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "identify",
        "identify the models MW, Maxwell, KB, HO and LE on a set of tissue tests",
        "lumbar identify recordings/tissue --train multisine --output out",
    )
    add_folder(parser)
    parser.add_argument("--train", metavar="NAME", help="record to identify on (default: the longest)")
    parser.add_argument(
        "--passive",
        action="store_true",
        help="fit passive models beside them (passive_models.json, for 'lumbar export') and say what they cost",
    )
    add_output(parser)
    add_data(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Identify on one record, test on the others, write models.json and the tables, print what was found."""
    from lumbar.interface.identification import identify
    from lumbar.interface.reading import read

    settings = load_settings(*options.config)
    records = read(options.folder, layout=settings.tissue.layout, rate=settings.tissue.rate_Hz)
    train = options.train or max(records, key=len).name
    found = identify(
        records,
        train,
        settings=settings,
        data=options.data or options.folder.name,
    )
    found.save(options.output)
    print(found)
    if options.passive:
        fits = found.passive(records, settings=settings.runtime)
        fits.save(options.output, found.data)
        print(fits)
    print(f"identified on {train}; models.json, table_3_1 and physical_parameters are in {options.output}")
