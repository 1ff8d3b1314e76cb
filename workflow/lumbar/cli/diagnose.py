"""``lumbar diagnose``: which physical effect a model of tissue tests is missing."""

from __future__ import annotations

from pathlib import Path

from lumbar.cli.settings import add_data, add_output, new_command
from lumbar.cli.tissue_folder import add_selection, read_and_choose


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "diagnose",
        "say which physical effect a model of tissue tests is missing, or that nothing is",
        "lumbar diagnose recordings/tissue --output out",
    )
    parser.add_argument(
        "folder",
        type=Path,
        metavar="FOLDER",
        help="one file per excitation (time_s,position_mm,force_N unless the layout says otherwise)",
    )
    add_selection(parser)
    parser.add_argument(
        "--pictures",
        action="store_true",
        help="draw comparison, location, ladder and signatures too; takes a few seconds more",
    )
    add_output(parser)
    add_data(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Diagnose, write the verdict with its evidence, a page and the error ladder, print the verdict."""
    from lumbar.diagnosis.design.discrimination import separation_sentence
    from lumbar.diagnosis.evidence.diagnosis_files import write_diagnosis
    from lumbar.diagnosis.evidence.evidence import gather_evidence
    from lumbar.diagnosis.selection.diagnose import diagnose
    from lumbar.diagnosis.selection.sentences import details, headline
    from lumbar.files import write_text
    from lumbar.reports.pages.diagnosis_page import diagnosis_page

    settings, records, chosen = read_and_choose(options)
    data = options.data or options.folder.name
    diagnosis = diagnose(records, chosen)
    evidence = gather_evidence(diagnosis, records, chosen, settings.seed, settings.signals.machine)
    pictures = {}
    if options.pictures:
        from lumbar.reports.pages.diagnosis_pictures import diagnosis_pictures

        pictures = diagnosis_pictures(diagnosis, records, chosen, settings.seed, options.output, data)
    page = diagnosis_page(diagnosis, evidence, chosen.candidates, data, pictures)
    write_diagnosis(diagnosis, evidence, options.output, data)
    write_text(options.output / "diagnosis.html", page)
    print(headline(diagnosis))
    for line in details(diagnosis, chosen.candidates):
        print(f"  {line}")
    if evidence.separation is not None:
        print(f"  {separation_sentence(evidence.separation, diagnosis)}")
