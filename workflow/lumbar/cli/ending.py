"""Last lines of the commands that fit models: error ladder, result, written files and the next command."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.base.errors import LumbarError
from lumbar.cli.command import read_settings
from lumbar.tissue.diagnosis.evidence.evidence import EXCITATION
from lumbar.tissue.diagnosis.selection.candidate import Candidate, is_adequate
from lumbar.tissue.diagnosis.selection.diagnosis_result import Status
from lumbar.tissue.diagnosis.selection.sentences import distinguishing_digits, remaining_error, times_floor
from lumbar.tissue.models.bases import BASES, CHOSEN_BY_DATA

if TYPE_CHECKING:
    from lumbar.interface.diagnosis import Diagnosis
    from lumbar.interface.refinement import Refinement
    from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
    from lumbar.tissue.diagnosis.fitting.preparation import Experiment
    from lumbar.tissue.models.fitted_model import FittedModel

_BAR = 30
"""Length of the longest bar, in characters."""
_MODELS = 4
"""Largest number of models in a ladder."""
_NAMED = 5
"""Largest number of effects that are named for an error."""


def ladder_lines(path: Sequence[Candidate], experiment: Experiment) -> list[str]:
    """Return the error ladder as text: a heading, a linear bar per model, and the noise floor if it is known.

    Parameters
    ----------
    path : sequence of Candidate
        Models, each with one more effect; the base and the last ones are shown.
    experiment : Experiment
        Prepared records.
    """
    floor, errors = experiment.floor, [item.test_rms for item in path]
    rows = [
        (f"+ {item.effects[-1]}" if item.effects else item.fit.structure.base.name, text, item.test_rms)
        for item, text in zip(path, distinguishing_digits(errors, 3), strict=True)
    ]
    left_out = len(rows) - _MODELS
    if left_out > 0:
        name = f"  {left_out + 1} more"
        rows[1 : 2 + left_out] = [(name, *rows[1 + left_out][1:])]
    if floor is not None:
        rows.append(("noise", f"{floor.rms:.3g}", floor.rms))
    mark = "█" if (sys.stdout.encoding or "").lower().startswith("utf") else "#"
    widths = [max(len(row[column]) for row in rows) for column in (0, 1)]
    longest, lines = max(row[2] for row in rows) or 1.0, []
    for name, text, error in rows:
        bar = ("-" if name == "noise" else mark) * max(round(_BAR * error / longest), 1)
        times = "" if floor is None or name == "noise" else f"{times_floor(error, floor)} times the noise"
        lines.append(f"  {name:<{widths[0]}}  {text:>{widths[1]}}  {bar:<{_BAR}}  {times}".rstrip())
    return [f"RMS error on {experiment.test_data}, in {experiment.output_unit}:", *lines]


def comparison_ending(refined: Refinement, options) -> list[str]:
    """Return the last lines of ``lumbar compare``."""
    comparisons = [item.comparison for item in refined.compare()]
    sentence = min(comparisons, key=lambda item: item.vaf.value).sentence
    if len(comparisons) > 1:
        compared = "axes of records" if refined.records[0].axes else "records"
        sentence = f"Worst of {len(comparisons)} {compared}, {sentence}"
    fitted = _fit_options(options, refined.settings, refined.path)
    is_done = is_adequate(refined.path[-1], refined.experiment)
    following = (
        _command("diagnose", options, _fit_options(options, refined.settings, refined.path[:1]))
        if is_done
        else _command("locate", options, fitted)
    )
    return _ending(refined, sentence, options, ("compare_page.html", "compare.csv"), following)


def location_ending(refined: Refinement, options) -> list[str]:
    """Return the last lines of ``lumbar locate``."""
    located = refined.locate()
    addable = refined.addable
    names = [name for name in located.candidate_effects if name in addable][:_NAMED]
    sentence = str(located).splitlines()[0]
    if names:
        sentence += f"\nEffects that leave such an error, those of the first cause first: {', '.join(names)}."
        fitted = [*_fit_options(options, refined.settings, refined.path), "--add", names[0]]
        following = _command("refine", options, fitted)
    else:
        base = _fit_options(options, refined.settings, refined.path[:1])
        following = _command("diagnose", options, base)
    return _ending(refined, sentence, options, ("location_page.html", "location.csv"), following)


def refinement_ending(refined: Refinement, options) -> list[str]:
    """Return the last lines of ``lumbar refine``."""
    verdict = str(refined).partition("Verdict: ")[2].splitlines()[0]
    following = _command("locate", options, _fit_options(options, refined.settings, refined.path))
    if is_adequate(refined.path[-1], refined.experiment):
        following = _export(refined.model, options) or following
    return _ending(
        refined, f"{verdict[0].upper()}{verdict[1:]}", options, ("refined.json", "ladder.svg"), following
    )


def diagnosis_ending(diagnosis: Diagnosis, options) -> list[str]:
    """Return the last lines of ``lumbar diagnose``."""
    result = diagnosis.result
    left = [remaining_error(result)] if result.selected else []
    remarks = len(result.findings) - (result.orientation is not None) + (not result.model.fit.converged)
    files = ("diagnosis.html", "diagnosis.json", "refined.json", EXCITATION, "proposed_law.yaml")
    return [
        *ladder_lines(result.path, result.experiment),
        diagnosis.headline,
        *left,
        *_remarks(remarks, f" or {options.output / 'diagnosis.html'}"),
        _written(options.output, files),
        f"Next: {after_diagnosis(diagnosis, options)}",
    ]


def after_diagnosis(diagnosis: Diagnosis, options) -> str:
    """Return the next step after the verdict of a diagnosis: a command, and first what it needs.

    Parameters
    ----------
    diagnosis : Diagnosis
        The diagnosis.
    options : argparse.Namespace
        Options of ``lumbar diagnose``.
    """
    result, settings = diagnosis.result, diagnosis.settings
    again = _command("diagnose", options, _fit_options(options, settings, ()))
    fitted = _fit_options(options, settings, result.path)
    if result.orientation is not None:
        return f"correct the records, then {again}"
    if result.status == Status.TIED:
        excitation = options.output / EXCITATION
        if excitation.is_file():
            trained = _command(
                "diagnose", options, [*_fit_options(options, settings, ()), "--train", "proposed"]
            )
            return f"play {excitation}, put its record into {options.folder} as proposed.csv, then {trained}"
        motion = diagnosis.candidates[result.selected[-1]].experiment
        return f"{motion}; put the record into {options.folder}, then {again}"
    if result.status == Status.UNEXPLAINED:
        one_motion = not (settings.forward or result.experiment.points or diagnosis.records[0].axes)
        if settings.system == "tissue" and one_motion and result.proposal is None:
            law = ["--output", "law.yaml"]
            return _command("propose", options, _fit_options(options, settings, ()), law)
        return _command("locate", options, fitted)
    if result.is_incomplete and result.further is not None:
        return _command("refine", options, [*fitted, "--add", result.further.effects[-1]])
    if result.is_incomplete:
        return _command("locate", options, fitted)
    return _export(diagnosis.model, options) or _command("compare", options, fitted)


def _ending(refined: Refinement, sentence: str, options, files: Iterable[str], following: str) -> list[str]:
    return [
        *ladder_lines(refined.path, refined.experiment),
        sentence,
        *_remarks(len(refined.findings)),
        _written(options.output, files),
        f"Next: {following}",
    ]


def _remarks(number: int, place: str = "") -> list[str]:
    remarks = "1 remark" if number == 1 else f"{number} remarks"
    return [f"{remarks} on records and fit: --verbose{place}"] if number else []


def _written(folder: Path, names: Iterable[str]) -> str:
    return f"Written: {', '.join(str(folder / name) for name in names if (folder / name).is_file())}"


def _fit_options(options, settings: DiagnosisSettings, path: Sequence[Candidate]) -> list[str]:
    """Return ``--base`` and ``--add`` of the last model of a path; the options' base for an empty path."""
    chosen = path[0].fit.structure.base.name if path else ""
    base = chosen if settings.base == CHOSEN_BY_DATA and chosen in BASES else options.base
    added = [word for name in (path[-1].effects if path else ()) for word in ("--add", name)]
    return [*(["--base", base] if base else []), *added]


def _command(name: str, options, fitted: Sequence[str] = (), output: Sequence[str] = ()) -> str:
    """Return a command on the same folder with the same options of settings and fit.

    Parameters
    ----------
    name : str
        Name of the command.
    options : argparse.Namespace
        Options of the present command.
    fitted : sequence of str
        Options of base and effects.
    output : sequence of str
        Option of the output; default the present one.
    """
    arguments = ["lumbar", name, str(options.folder), *fitted, *_settings(options)]
    for key in ("period",) if "--train" in fitted else ("train", "period"):
        arguments += [part for value in getattr(options, key) or () for part in (f"--{key}", value)]
    arguments += [f"--{key}" for key in ("forward", "session") if getattr(options, key)]
    arguments += ["--data", options.data] if options.data else []
    return shlex.join([*arguments, *(output or ["--output", str(options.output)])])


def _settings(options) -> list[str]:
    files = [word for path in options.config for word in ("--config", str(path))]
    return [*files, *(["--trust"] if options.trust else [])]


def _export(model: FittedModel, options) -> str:
    """Return the command that exports the last model of ``refined.json``; empty if no device can play the model."""
    from lumbar.tissue.fmu.build.export_model import export_models

    try:
        export_models([model], read_settings(options).runtime)
    except LumbarError:
        return ""
    models = str(options.output / "refined.json")
    return shlex.join(["lumbar", "export", models, *_settings(options), "--output", "fmu"])
