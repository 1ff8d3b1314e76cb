"""Commands on tissue tests, the motion behind them and ratings: from ``lumbar bandwidth`` to ``lumbar propose``; ``survey``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lumbar.base.errors import InputError
from lumbar.cli.options import given_settings

if TYPE_CHECKING:
    from lumbar.interface.refinement import Refinement
    from lumbar.records.record import RecordSet
    from lumbar.settings.study_settings import StudySettings


def run_bandwidth(options) -> None:
    """Print the bandwidths; write them and the spectra where a folder is given."""
    from lumbar.interface.reading import read
    from lumbar.interface.surgeons import bandwidth

    settings = given_settings(options)
    surgeon, data = settings.surgeon, options.data or options.folder.name
    trials = read(options.folder, layout=surgeon.layout, rate=surgeon.rate_Hz)
    found = bandwidth(trials, settings=surgeon, seed=settings.seed, source_label=data)
    print(found)
    if options.output:
        found.save(options.output)


def run_signals(options) -> None:
    """Design the signals, check them against the machine, write them."""
    from lumbar.interface.surgeons import design_signals

    settings = given_settings(options)
    band = options.bandwidth if options.band is None else options.band
    found = design_signals(band, settings=settings.signals, seed=settings.seed)
    found.save(options.output)
    print(f"{found}, in {options.output}")


def run_identify(options) -> None:
    """Identify on one record, test on the others, write models.json and the tables, print what was found."""
    from lumbar.interface.identification import identify
    from lumbar.interface.reading import read

    settings = given_settings(options)
    records = read(options.folder, layout=settings.tissue.layout, rate=settings.tissue.rate_Hz)
    train = options.train or max(records, key=len).name
    found = identify(records, train, settings=settings, source_label=options.data or options.folder.name)
    found.save(options.output)
    print(found)
    if options.passive:
        fits = found.passive(records, settings=settings.runtime)
        fits.save(options.output, found.source_label)
        print(fits)
    print(f"identified on {train}; models.json, table_3_1 and physical_parameters are in {options.output}")


def fit_settings(options) -> StudySettings:
    """Settings of the files of ``--config``, with what the options of `FIT` say in their place."""
    settings = given_settings(options)
    said = {name: getattr(options, name) for name in ("base", "train", "forward", "session")}
    given = {name: value for name, value in said.items() if value is not None}
    return settings.model_copy(update={"improvement": settings.improvement.model_copy(update=given)})


def read_folder(options) -> tuple[RecordSet, StudySettings, str]:
    """Return the records of the folder with their periods, how they are fitted, and what they are called."""
    from lumbar.interface.reading import read
    from lumbar.settings.study_settings import record_layout
    from lumbar.tissue.diagnosis.noise.periods import fold_periods

    settings = fit_settings(options)
    layout, rate = record_layout(settings, settings.improvement.base)
    periods = dict(map(_period, options.period))
    records = read(options.folder, layout=layout, rate=rate).with_periods(periods)
    for name, seconds in periods.items():
        fold_periods(records[name], seconds)  # a period that is asked for and cannot be used is an error
    return records, settings, options.data or options.folder.name


def _period(text: str) -> tuple[str, float]:
    name, _, seconds = text.partition("=")
    try:
        value = float(seconds)
    except ValueError:
        value = 0.0
    if not name or not 0 < value < float("inf"):
        raise InputError(f"--period {text!r}: NAME=SECONDS with positive seconds is needed")
    return name, value


def _refinement(options) -> Refinement:
    """Fit the base with the effects of ``--add`` to the records of the folder."""
    from lumbar.interface.refinement import refine

    records, settings, data = read_folder(options)
    return refine(records, options.add, settings=settings, source_label=data)


def run_compare(options) -> None:
    """Fit the model, compare it with every record, write table, pictures and page, and tell it."""
    _save_and_print(_refinement(options).compare(), options)


def run_locate(options) -> None:
    """Fit the model, see where it fails on every record, write table, pictures and page, and tell it."""
    _save_and_print(_refinement(options).locate(), options)


def run_refine(options) -> None:
    """Refit base and effects jointly, write refined.json, print the error ladder and draw it."""
    _save_and_print(_refinement(options), options)
    print(f"The ladder is drawn in {options.output / 'ladder.svg'}; a device plays the last model:")
    print(f"  lumbar export {options.output / 'refined.json'} --output fmu")


def _save_and_print(found, options) -> None:
    found.save(options.output)
    print(found)


def run_diagnose(options) -> None:
    """Diagnose, write result, evidence, page and error ladder, print the result and its steps if asked for."""
    from lumbar.interface.diagnosis import diagnose

    records, settings, data = read_folder(options)
    diagnosis = diagnose(records, settings=settings, source_label=data)
    diagnosis.save(options.output, options.pictures)
    print(diagnosis)
    if options.explain:
        print("\n".join(diagnosis.explain()))
    print(f"{options.output / 'diagnosis.html'} shows it.")
    result = diagnosis.result
    contact = result.base.fit.structure.base.contact
    if not (diagnosis.settings.forward or result.experiment.points or contact or result.orientation):
        print(f"A device plays its model: lumbar export {options.output / 'refined.json'} --output fmu")


def run_propose(options) -> None:
    """Diagnose, look for a law, print it, and write the effect's file and picture where there is something to write."""
    from lumbar.interface.diagnosis import propose

    records, settings, data = read_folder(options)
    law = propose(records, settings=settings, source_label=data)
    if options.output and law.found:
        law.save(options.output, options.output.stem)
    if options.picture and law.proposal.is_needed:
        law.draw(options.picture)
    print(law)


def run_survey(options) -> None:
    """Write tables, figures and survey.json, and print the overall tests."""
    from lumbar.interface.participants import analyse_survey

    settings = given_settings(options)
    data = options.data or options.file.name
    found = analyse_survey(options.file, settings=settings.survey, seed=settings.seed, source_label=data)
    found.save(options.output)
    print(found)
    print(f"tables and figures are in {options.output}")
