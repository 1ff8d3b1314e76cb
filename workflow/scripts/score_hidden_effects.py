"""Scores of the diagnosis: truth and diagnoses meet here and nowhere before."""

from job import run, stem


def main(input, output, params):
    """Compare, count, publish."""
    from lumbar.base.files import read_json, write_csv, write_json
    from lumbar.publishing.figures.scoring_figures import confusion_figure, power_figure
    from lumbar.publishing.figures.style import save
    from lumbar.settings.hidden_effects import HiddenEffectsSettings
    from lumbar.settings.plain import typed
    from lumbar.tables.table import SYNTHETIC_TWIN
    from lumbar.tissue.diagnosis.scoring.scores import (
        accuracy_table,
        confusion,
        forms_table,
        power_curve,
        power_summary,
        scores,
    )
    from lumbar.twin.hidden_effects.hidden_catalogue import MECHANISMS

    settings = typed(HiddenEffectsSettings, params.settings)
    labels, diagnoses = {}, {}
    for path in input.labels:
        labels.update(read_json(path))
    for path in input.diagnoses:
        diagnoses.update(read_json(path))
    frame = scores(labels, diagnoses)
    write_csv(output.scores, frame.assign(data=SYNTHETIC_TWIN))
    matrix = confusion(frame, list(MECHANISMS))
    write_csv(output.confusion, matrix.assign(data=SYNTHETIC_TWIN))
    accuracy_table(frame, settings).write(stem([output.accuracy_csv]))
    forms_table(frame, settings).write(stem([output.forms_csv]))
    power = power_summary(frame, settings, settings.seed)
    write_json(output.power, {**power, "data": SYNTHETIC_TWIN})
    save(confusion_figure(matrix), stem([output.confusion_svg]), SYNTHETIC_TWIN)
    figure = power_figure(power_curve(frame), settings.named_share, settings.confidence)
    save(figure, stem([output.power_svg]), SYNTHETIC_TWIN)


run(main, snakemake)
