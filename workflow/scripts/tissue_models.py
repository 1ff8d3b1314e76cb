"""Table 3.1, physical parameters, models.json, search grid and Figures 3.4 and 3.5."""

from job import run, stem

from lumbar.settings.perception import PerceptionSettings
from lumbar.settings.tissue import TissueSettings


def main(input, output, tissue: TissueSettings, perception: PerceptionSettings, data: str):
    """Collect the identifications and publish them."""
    import pandas as pd

    from lumbar.base.files import write_csv, write_json
    from lumbar.interface.device import load_models
    from lumbar.interface.identification import Identification
    from lumbar.interface.reading import read_listed
    from lumbar.publishing.figures.style import save
    from lumbar.publishing.figures.tissue_figures import excitation_figure
    from lumbar.tissue.identification.identify_tissue import distinct
    from lumbar.tissue.models.fitted_model import models_document
    from lumbar.tissue.perception.thresholds import Hands

    records = read_listed(input.recordings, tissue.records, tissue.layout, tissue.rate_Hz)
    models = [model for path in input.fits for model in load_models(path, input.effects)]
    grid = pd.concat([pd.read_csv(path) for path in input.grids])
    found = Identification(models, grid, tissue, data, records, Hands.of(perception))
    write_json(output.models, models_document(distinct(models), data))
    write_csv(output.search, found.search)
    found.table_3_1.write(stem(output.table_3_1))
    found.physical_parameters.write(stem(output.physical_parameters))
    found.static_or_dynamic.write(stem(output.static_or_dynamic))
    trained = sorted((records[name] for name in tissue.training), key=lambda item: (item.duration, item.name))
    save(excitation_figure(trained, tissue.segment_s), stem(output.figure_3_4), data)
    save(found.comparison_figure(records[tissue.training[0]]), stem(output.figure_3_5), data)


run(main, snakemake)
