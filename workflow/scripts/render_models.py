"""Models in a person's hand: the table model × device, the Z-width, loops side by side, what running and passivity cost."""

from job import run, stem

from lumbar.settings.perception import PerceptionSettings
from lumbar.settings.runtime import RuntimeSettings
from lumbar.settings.tissue import TissueSettings


def main(
    input,
    output,
    settings: RuntimeSettings,
    tissue: TissueSettings,
    perception: PerceptionSettings,
    data: str,
):
    """Judge the exported models on the study's device, fit passive ones, write tables, figures and the passive models."""
    from lumbar.base.files import write_json
    from lumbar.interface.device import load_models, rendering_of
    from lumbar.interface.reading import read_listed
    from lumbar.publishing.figures.runtime_figures import nothing_to_show, rates_figure
    from lumbar.publishing.figures.style import save
    from lumbar.tissue.fmu.build.export_model import find_models
    from lumbar.tissue.haptics.passive_models import fit_passive_models
    from lumbar.tissue.haptics.rates import rates, rates_table
    from lumbar.tissue.haptics.runtime_error import runtime_error_table
    from lumbar.tissue.models.fitted_model import models_document
    from lumbar.tissue.perception.thresholds import Hands

    models = load_models(input.models, input.effects)
    exported = find_models(models, settings)
    hands = Hands.of(perception)
    found = rendering_of(exported, settings, data, hands)
    found.table.write(stem(output.rendering))
    loops = found.loop_figure() if len(found) else nothing_to_show(found.refused)
    save(loops, stem(output.closed_loop), data)
    width = found.z_width_figure() if found.linear else nothing_to_show(found.refused)
    save(width, stem(output.z_width), data)
    records = read_listed(input.recordings, tissue.records, tissue.layout, tissue.rate_Hz)
    training = records[settings.trained_on]
    cost = runtime_error_table(exported, training, settings, tissue.settling_s, hands, data)
    cost.write(stem(output.runtime_error))
    tests = [record for record in records if record.name != settings.trained_on]
    played, untrained = rates(training, tests, tissue, settings, hands)
    rates_table(played, untrained, training, data).write(stem(output.rates))
    drawn = rates_figure(played) if played else nothing_to_show(untrained)
    save(drawn, stem(output.rates_figure), data)
    fits = fit_passive_models(models, training, tests, settings, tissue.settling_s)
    fits.table(data).write(stem(output.passive_fits))
    write_json(output.models, models_document(fits.passive, data))


run(main, snakemake)
