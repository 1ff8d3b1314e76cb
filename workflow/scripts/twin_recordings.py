"""Recordings of the synthetic twin that depend on no other result: the surgeons' tool, a tissue with two effects, the survey."""

from job import run

from lumbar.settings.twin import SyntheticSurgeonSettings, TwoHiddenEffectsSettings


def main(
    input,
    output,
    records: list[dict],
    surgeon: SyntheticSurgeonSettings,
    two_hidden: TwoHiddenEffectsSettings,
    seed: int,
):
    """Make every trial and test that the study reads; copy the survey answers of the project."""
    from pathlib import Path

    from lumbar.base.files import write_csv, write_text
    from lumbar.twin.surgeon_recordings import surgeon_trial
    from lumbar.twin.two_hidden_effects import two_hidden_effects, write_records

    for record, path in zip(records, output.surgeon, strict=True):
        write_csv(path, surgeon_trial(record["name"], record["surgeon"], surgeon, seed))
    write_records(Path(output.two_hidden_effects[0]).parent, two_hidden_effects(two_hidden, seed))
    write_text(output.answers, Path(input.answers).read_text(encoding="utf-8"))


run(main, snakemake)
