"""The run as one archive to be cited: code, inputs, environment and outputs, described as a Workflow Run RO-Crate."""

from job import run


def main(
    input,
    output,
    study: str,
    title: str,
    data: str,
    source: dict,
    results: dict[str, str],
    project: list[str],
    epoch: str | None,
):
    """Collect what is told of the run, write the archive."""
    from pathlib import Path

    from lumbar.base.environment import THREADS
    from lumbar.base.files import read_json
    from lumbar.publishing.run_crate import Run, end_of_run, write_crate

    folder = f"results/{study}"
    configuration, environment = f"{folder}/run_config.yaml", f"{folder}/run_environment.json"
    labels = {f"{folder}/{name}": label for name, label in results.items()}
    made = {name: Path(path) for name, path in zip(labels, input.results, strict=True)}
    made |= {configuration: Path(input.config), environment: Path(input.environment)}
    checked = [item for path in input.checked for item in read_json(path)["recordings"]]
    run = Run(
        study=study,
        title=title,
        data=data,
        ended=end_of_run(made, epoch),
        outputs={**labels, environment: "Versions and subjects of this run"},
        configuration=configuration,
        versions=read_json(input.environment)["versions"],
        environment=dict.fromkeys(THREADS, "1") | {"SOURCE_DATE_EPOCH": "0"},
        # A recording that several chapters read is told once.
        recordings=tuple(sorted({item["sha256"]: item["file"] for item in checked}.items()))
        if source
        else (),
        source=source,
    )
    write_crate(output.crate, run, made, dict(zip(project, map(Path, input.project), strict=True)))


run(main, snakemake)
