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
    """Simulate and write every lift of the person."""
    from lumbar.twin.cohort import cohort_lifts, write_person

    files = dict(zip(cohort_lifts(cohort), output.markers, strict=True))
    write_person(settings, cohort, person, group, seed, files)


run(main, snakemake)
