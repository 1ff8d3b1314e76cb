"""Models in a user's hand: table of models and devices, Z-width, compared loops, increase of the error by passivity."""

from job import run, stem

from lumbar.settings.runtime import RuntimeSettings
from lumbar.settings.tissue import TissueSettings


def main(input, output, settings: RuntimeSettings, tissue: TissueSettings, source_label: str):
    """Judge the exported models on the study's device, fit passive models, write tables, figures and these models."""
    from lumbar.base.files import write_json
    from lumbar.interface.device import judge_rendering, load_models
    from lumbar.interface.reading import read_listed
    from lumbar.publishing.figures.runtime_figures import placeholder_figure
    from lumbar.publishing.figures.style import save
    from lumbar.tissue.fmu.build.export_model import find_models
    from lumbar.tissue.haptics.passive_models import fit_passive_models
    from lumbar.tissue.models.fitted_model import models_document

    models = load_models(input.models, input.effects)
    found = judge_rendering(find_models(models, settings), settings, source_label)
    found.table.write(stem(output.rendering))
    loops = found.loop_figure() if len(found) else placeholder_figure(found.refused)
    save(loops, stem(output.closed_loop), source_label)
    width = found.z_width_figure() if found.linear else placeholder_figure(found.refused)
    save(width, stem(output.z_width), source_label)
    records = read_listed(input.recordings, tissue.records, tissue.layout, tissue.rate_Hz)
    fits = fit_passive_models(models, records, settings.trained_on, settings, tissue.settling_s)
    fits.table(source_label).write(stem(output.passive_fits))
    write_json(output.models, models_document(fits.passive, source_label))


run(main, snakemake)
