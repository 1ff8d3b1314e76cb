"""Commands on tissue tests, models, surgeons' motion and ratings: ``lumbar bandwidth`` to ``export``, and ``survey``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import lumbar
from lumbar.base.errors import InputError
from lumbar.cli.command import read_settings
from lumbar.cli.ending import comparison_ending, diagnosis_ending, location_ending, refinement_ending
from lumbar.settings.study_settings import StudySettings, record_layout
from lumbar.tissue.effects.catalogue import CATALOGUES, MOTION_SENSOR, catalogue_with

if TYPE_CHECKING:
    from lumbar.interface.refinement import Refinement
    from lumbar.tissue.models.form import Effect


def run_bandwidth(options) -> None:
    """Print the bandwidths; write them and the spectra if a folder is given."""
    settings = read_settings(options)
    surgeon = settings.surgeon
    trials = lumbar.read(options.folder, layout=surgeon.layout, rate=surgeon.rate_Hz)
    label = options.data or options.folder.name
    result = lumbar.bandwidth(trials, settings=surgeon, seed=settings.seed, source_label=label)
    print(result)
    if options.output:
        result.save(options.output)


def run_signals(options) -> None:
    """Design the signals, check them against the machine, write them."""
    settings = read_settings(options)
    band = options.bandwidth if options.band is None else options.band
    result = lumbar.design_signals(band, settings=settings.signals, seed=settings.seed)
    result.save(options.output)
    print(f"{result}, in {options.output}")


def run_identify(options) -> None:
    """Identify on one record, test on the others, write models.json and the tables, print the result."""
    settings = read_settings(options)
    records = lumbar.read(options.folder, layout=settings.tissue.layout, rate=settings.tissue.rate_Hz)
    train, label = options.train or max(records, key=len).name, options.data or options.folder.name
    result = lumbar.identify(records, train, settings=settings, source_label=label)
    result.save(options.output)
    print(result)
    if options.passive:
        fits = result.passive(records, settings=settings.runtime)
        fits.save(options.output, result.source_label)
        print(fits)
    print(f"identified on {train}; models.json, table_3_1 and physical_parameters are in {options.output}")


def fit_settings(options) -> StudySettings:
    """Return the settings of ``--config``, overridden by the options of the fit."""
    settings = read_settings(options)
    values = {name: getattr(options, name) for name in ("base", "train", "forward", "session")}
    given = {name: value for name, value in values.items() if value is not None}
    return settings.model_copy(update={"improvement": settings.improvement.model_copy(update=given)})


def fit_arguments(options) -> dict[str, Any]:
    """Return ``records`` of the folder with their periods, ``settings`` and ``source_label`` of a fit."""
    from lumbar.tissue.diagnosis.noise.periods import fold_periods

    settings = fit_settings(options)
    layout, rate = record_layout(settings, settings.improvement.base)
    periods = dict(map(_period, options.period))
    records = lumbar.read(options.folder, layout=layout, rate=rate).with_periods(periods)
    for name, seconds in periods.items():
        fold_periods(records[name], seconds)  # a given period that cannot be used is an error
    return {
        "records": records,
        "settings": settings,
        "source_label": options.data or options.folder.name,
    }


def _period(text: str) -> tuple[str, float]:
    name, _, seconds = text.partition("=")
    try:
        value = float(seconds)
    except ValueError:
        value = 0.0
    if not name or not 0 < value < float("inf"):
        raise InputError(f"--period {text!r}: NAME=SECONDS with positive seconds is needed")
    return name, value


def run_compare(options) -> None:
    """Fit the model, compare it with every record, write table, figures and page, print what follows from it."""
    refined = _refine(options)
    _finish(refined.compare(), comparison_ending, refined, options)


def run_locate(options) -> None:
    """Fit the model, locate its errors on every record, write table, figures and page, print the causes."""
    refined = _refine(options)
    _finish(refined.locate(), location_ending, refined, options)


def run_refine(options) -> None:
    """Refit base and effects jointly, write refined.json, print the error ladder and draw it."""
    refined = _refine(options)
    _finish(refined, refinement_ending, refined, options)


def run_effects(options) -> None:
    """Print every effect of the catalogues and of the settings, each with its mechanism."""
    files = read_settings(options).improvement.effect_files
    for system in CATALOGUES:
        _print_effects(system, catalogue_with(files, "pendulum" if system == "pendulum" else "KB"))
    _print_effects("sensor of the motion, with --forward", MOTION_SENSOR)


def _print_effects(heading: str, effects: Mapping[str, Effect]) -> None:
    print(f"Effects ({heading}):")
    print(*(f"  {name:<26}{effect.mechanism}" for name, effect in effects.items()), sep="\n")


def _refine(options) -> Refinement:
    if "?" in options.add:
        run_effects(options)
        sys.exit(0)
    return lumbar.refine(effects=options.add, **fit_arguments(options))


def _finish(result, ending: Callable, source, options) -> None:
    """Write a result and print it: all sentences if requested, then the last lines."""
    result.save(options.output)
    if options.verbose:
        print(result, end="\n\n")
    print(*ending(source, options), sep="\n")


def run_diagnose(options) -> None:
    """Diagnose, write result, evidence, page and error ladder, print the result, and its steps if requested."""
    diagnosis = lumbar.diagnose(**fit_arguments(options))
    diagnosis.save(options.output, options.pictures)
    if options.verbose:
        print(diagnosis, end="\n\n")
    if options.explain:
        print(*diagnosis.explain(), sep="\n")
    print(*diagnosis_ending(diagnosis, options), sep="\n")


def run_propose(options) -> None:
    """Diagnose, search for a law, print it, and write the effect's file and figure if there is a law."""
    law = lumbar.propose(**fit_arguments(options))
    if options.output and law.has_law:
        law.save(options.output, options.output.stem)
    if options.picture and law.proposal.is_needed:
        law.draw(options.picture)
    print(law)


def run_export(options) -> None:
    """Compile and pack the models, or write their Prony series."""
    settings = read_settings(options)
    if options.prony:
        if options.rate or options.target:
            raise InputError(
                "--prony writes text for finite elements: --rate and --target do not apply; leave them out"
            )
        files = lumbar.export_prony(
            options.models,
            options.output,
            options.model,
            trained_on=options.trained_on,
            effect_files=settings.improvement.effect_files,
            settings=settings.runtime,
        )
        print(*files, sep="\n")
        return
    files = lumbar.export_fmu(
        options.models,
        options.output,
        options.model,
        trained_on=options.trained_on,
        rate_Hz=options.rate,
        targets=options.target,
        effect_files=settings.improvement.effect_files,
        settings=settings.runtime,
    )
    for file in files:
        print(file)


def run_render(options) -> None:
    """Print the rendering result of each model; write the table and the figures if a folder is given."""
    settings = read_settings(options)
    rendering = lumbar.render(
        options.models,
        options.model,
        trained_on=options.trained_on,
        mass_kg=options.mass,
        damping_N_s_m=options.damping,
        hand_stiffness_N_m=options.hand,
        rate_Hz=options.rate,
        effect_files=settings.improvement.effect_files,
        settings=settings.runtime,
    )
    print(rendering)
    if options.output:
        rendering.save(options.output)


def run_survey(options) -> None:
    """Write tables, figures and survey.json, and print the overall tests."""
    settings, label = read_settings(options), options.data or options.file.name
    result = lumbar.analyse_survey(
        options.file, settings=settings.survey, seed=settings.seed, source_label=label
    )
    result.save(options.output)
    print(result)
    print(f"tables and figures are in {options.output}")
