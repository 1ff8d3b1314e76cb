"""One batch of experiments with a hidden effect."""

from job import run


def main(input, output, params):
    """Make the recordings and, apart from them, the truth."""
    from lumbar.synthetic.hidden_effects.experiment import plan_batch
    from lumbar.synthetic.hidden_effects.experiment_folder import write_experiments

    plans = plan_batch(params.kind, params.part, params.settings)
    write_experiments(output.recordings, output.labels, plans, params.settings)


run(main, snakemake)
