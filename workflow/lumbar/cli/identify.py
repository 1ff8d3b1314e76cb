"""``lumbar identify``: viscoelastic models of a set of tissue tests."""

from __future__ import annotations

from pathlib import Path

from lumbar.cli.settings import add_data, add_output, load_settings, new_command, record_files


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "identify",
        "identify the models MW, Maxwell, KB, HO and LE on a set of tissue tests",
        "lumbar identify recordings/tissue --train multisine --output out",
    )
    parser.add_argument(
        "folder",
        type=Path,
        metavar="FOLDER",
        help="one file per excitation (time_s,position_mm,force_N unless the layout says otherwise)",
    )
    parser.add_argument("--train", metavar="NAME", help="record to identify on (default: the longest)")
    add_output(parser)
    add_data(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Identify on one record, test on the others, write models.json and a table of the errors."""
    from lumbar.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
    from lumbar.diagnosis.selection.refine import refined_fit
    from lumbar.errors import InputError
    from lumbar.files import write_json
    from lumbar.identification.identify_tissue import (
        distinct,
        given_model,
        identify,
    )
    from lumbar.identification.table_3_1 import table_3_1
    from lumbar.models.models_file import models_document
    from lumbar.records.columns import read_record
    from lumbar.records.record import same_units

    settings = load_settings(options.config)
    tissue = settings.tissue
    files = record_files(options.folder)
    records = [read_record(path, tissue.layout, rate=tissue.rate_Hz) for path in files]
    same_units(records)
    named = {record.name: record for record in records}
    train = options.train or max(records, key=lambda record: record.duration).name
    if train not in named:
        raise InputError(
            f"--train {train!r}: no such record in {options.folder}; there are {', '.join(named)}"
        )
    training = named.pop(train)
    tests = list(named.values())
    models, _ = identify(training, tests, tissue, settings.seed)
    models.append(given_model(training, tests, tissue.settling_s, **vars(tissue.inverted_linear)))
    if settings.improvement.effects:
        chosen = DiagnosisSettings.from_improvement(settings.improvement, train=train)
        models.append(refined_fit([training, *tests], settings.improvement.effects, chosen))
    data = options.data or options.folder.name
    write_json(options.output / "models.json", models_document(distinct(models), data))
    table = table_3_1(models, tissue, data)
    table.write(options.output / "table_3_1")
    print(f"identified on {train}; models.json and table_3_1 are in {options.output}")
