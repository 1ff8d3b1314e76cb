"""Synthetic lifts of one person of a cohort."""

from job import run

from lumbar.settings.twin import CohortSettings, SyntheticLiftingSettings


def main(
    input,
    output,
    person: str,
    group: str,
    cohort: CohortSettings,
    settings: SyntheticLiftingSettings,
    seed: int,
):
    """Move the person through every lift."""
    from lumbar.twin.cohort import lifts_of, write_person

    files = dict(zip(lifts_of(cohort), output.markers, strict=True))
    write_person(settings, cohort, person, group, seed, files)


run(main, snakemake)
