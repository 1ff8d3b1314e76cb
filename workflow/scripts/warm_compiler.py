"""The C compiler's cache: its libraries for each platform, built a single time."""

from job import run


def main(input, output, targets: list[str], compiler_cache: str | None):
    """Compile a few lines for every target; write which targets are ready."""
    from lumbar.base.files import write_json
    from lumbar.tissue.fmu.build.compiler import cache_folder, resolve_targets, warm_cache

    warm_cache(targets, cache_folder(compiler_cache))
    write_json(output.targets, {"targets": resolve_targets(targets)})


run(main, snakemake)
