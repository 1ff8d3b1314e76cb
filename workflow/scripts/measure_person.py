"""Measures of every lift of one person."""

from job import run


def main(input, output, params):
    """Analyse the lifts one after the other; a lift without a result has its reason in the table."""
    from lumbar.files import write_csv
    from lumbar.interface.measured_person import measure_person
    from lumbar.settings.lifting import LiftingSettings
    from lumbar.settings.plain import typed
    from lumbar.settings.stability import StabilitySettings
    from lumbar.settings.subject import SubjectSettings, TrialSettings

    trials = {name: typed(TrialSettings, trial) for name, trial in params.trials.items()}
    table = measure_person(
        dict(zip(trials, input.markers, strict=True)),
        trials,
        typed(SubjectSettings, {"experience": "not said", **params.subject}),
        typed(LiftingSettings, params.lifting),
        typed(StabilitySettings, params.stability),
        static=next(iter(input.static), None),
        data=params.data,
    )
    write_csv(output.measures, table)


run(main, snakemake)
