"""Synthetic lifts of one person of a cohort."""

from job import run


def main(input, output, params):
    """Move the person through every lift."""
    from lumbar.settings.plain import typed
    from lumbar.settings.twin import CohortSettings, SyntheticLiftingSettings
    from lumbar.twin.cohort import lifts_of, write_person

    cohort = typed(CohortSettings, params.cohort)
    files = dict(zip(lifts_of(cohort), output.markers, strict=True))
    settings = typed(SyntheticLiftingSettings, params.settings)
    write_person(settings, cohort, params.person, params.group, params.seed, files)


run(main, snakemake)
