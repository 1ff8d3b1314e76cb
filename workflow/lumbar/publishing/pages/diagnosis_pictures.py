"""The pictures of a diagnosis as files."""

from collections.abc import Sequence
from pathlib import Path

from lumbar.publishing.figures.comparison_figures import (
    ladder_figure,
    record_comparison_figure,
    signature_figure,
)
from lumbar.publishing.figures.law_figure import law_figure, linear_figure
from lumbar.publishing.figures.location_figures import (
    location_figure,
    spatial_comparison_figure,
    spatial_location_figure,
)
from lumbar.publishing.figures.style import save
from lumbar.publishing.pages.html import LOCATION_CAPTION, SPACE_CAPTION
from lumbar.tissue.diagnosis.residuals.locate import ResidualReport, axis_reports
from lumbar.tissue.diagnosis.selection.result import DiagnosisResult
from lumbar.tissue.diagnosis.selection.sentences import runner_up
from lumbar.tissue.diagnosis.spatial.spatial_reports import SpatialReport
from lumbar.tissue.effects.signature import pictured_form
from lumbar.tissue.models.form import Effect


def draw_pictures(
    diagnosis: DiagnosisResult,
    reports: Sequence[ResidualReport | SpatialReport],
    catalogue: dict[str, Effect],
    folder: Path,
    source_label: str,
) -> dict[str, Path]:
    """Write ``comparison``, ``location``, ``ladder``, ``signatures``, and of results that have them ``proposed_law`` and
    ``linear_dynamics``.

    Parameters
    ----------
    diagnosis : DiagnosisResult
        Path, ranking, law and linear dynamics.
    reports : sequence of ResidualReport or SpatialReport
        Those of the base model.
    catalogue : dict of str to Effect
        Catalogue of one axis, along which signatures are drawn.
    folder, source_label
        Folder of the files; origin of the data.

    Returns
    -------
    dict of str to pathlib.Path
        SVG files by caption.
    """
    simulated, base = axis_reports(reports), diagnosis.base.fit.structure.base
    # The record of whose output the model explains the smallest share.
    shown = min(simulated, key=lambda item: item.comparison.vaf.value)
    whole = next(report for report in reports if shown in report.axes)
    trained = next(item for item in reports if item.record.name == diagnosis.experiment.floor_from)
    if isinstance(trained, SpatialReport):
        location = SPACE_CAPTION
        figures = {
            "comparison": spatial_comparison_figure(whole, base.name),
            "location": spatial_location_figure(trained),
        }
    else:
        comparisons, location = [item.comparison for item in simulated], LOCATION_CAPTION
        figures = {
            "comparison": record_comparison_figure(shown.record, shown.values, comparisons, base.name),
            "location": location_figure(trained.location),
        }
    figures["ladder"] = ladder_figure(diagnosis.path, diagnosis.experiment)
    # Signatures of the selected effects and of the runner-up's, or of the latter only.
    second = runner_up(diagnosis)
    names = [*diagnosis.selected, *(second.candidate.effects if second is not None else ())]
    effects = [catalogue[name] for name in dict.fromkeys(names) if name in catalogue]
    drawn = [effect for effect in effects if pictured_form(effect) is not None]
    figures["signatures"] = signature_figure(drawn, base.system)
    if diagnosis.proposal is not None and diagnosis.proposal.law is not None:
        figures["proposed_law"] = law_figure(diagnosis.proposal)
    if diagnosis.linear is not None:
        figures["linear_dynamics"] = linear_figure(diagnosis)
    for name, figure in figures.items():
        save(figure, folder / name, "" if name == "signatures" else source_label)
    captions = {
        "comparison": f"The {base.name} model with {whole.record.name}, the record it explains least, and what it leaves "
        "of every record.",
        "location": f"Where the {base.name} model fails on {trained.record.name}. {location}",
        "ladder": "Error on training and unseen records, effect by effect, down to the noise floor.",
        "signatures": "Signature of the selected effects and of the runner-up, each in its first form on a standard motion: "
        "force over position, added force at two rates and over time; arbitrary units.",
        "proposed_law": "The missing force over the position at three speeds, the proposed law (lines), and the "
        "errors without and with it.",
        "linear_dynamics": "The linear dynamics of higher order with base and record: gain and phase (Welch's estimate "
        "from the same motion), and the poles.",
    }
    return {captions[name]: folder / f"{name}.svg" for name in figures}
