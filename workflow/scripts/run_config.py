"""Merged configuration of a run, and the versions of Python and packages."""

from job import run


def main(input, output, config: dict, subjects: dict, source_label: str):
    """Write the configuration, in a form that the workflow reads again, and the versions."""
    import yaml

    from lumbar.base.environment import describe_environment
    from lumbar.base.files import write_json, write_text

    header = f"# Configuration of this run, defaults included. Data: {source_label}.\n"
    write_text(output.config, header + yaml.safe_dump(config, sort_keys=False, allow_unicode=True))
    write_json(output.environment, {"data": source_label, "subjects": subjects, **describe_environment()})


run(main, snakemake)
