"""Synthetic lifting recordings: marker files and hip moments."""

from job import run


def main(input, output, params):
    """Make every lift of the study that the twin moves."""
    import zlib

    from lumbar.settings.plain import typed
    from lumbar.settings.twin import SyntheticLiftingSettings
    from lumbar.twin.lifting_recordings import write_lift

    settings = typed(SyntheticLiftingSettings, params.settings)
    moments = dict(zip(params.with_moment, output.hip_moment, strict=True))
    for lift, markers in zip(params.lifts, output.markers, strict=True):
        # Each lift has noise of its own, whatever other lifts the study has.
        seed = [params.seed, zlib.crc32(lift.encode())]
        write_lift(settings, lift, seed, markers, moments.get(lift), params.gravity)


run(main, snakemake)
