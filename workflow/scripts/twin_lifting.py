"""Synthetic lifting recordings: marker files and hip moments."""

from job import run

from lumbar.settings.twin import SyntheticLiftingSettings


def main(
    input,
    output,
    settings: SyntheticLiftingSettings,
    lifts: list[str],
    with_moment: list[str],
    gravity: float,
    seed: int,
):
    """Make every lift of the study that the twin moves."""
    import zlib

    from lumbar.twin.lifting_recordings import write_lift

    moments = dict(zip(with_moment, output.hip_moment, strict=True))
    for lift, markers in zip(lifts, output.markers, strict=True):
        # Each lift has noise of its own, whatever other lifts the study has.
        own_seed = [seed, zlib.crc32(lift.encode())]
        write_lift(settings, lift, own_seed, markers, moments.get(lift), gravity)


run(main, snakemake)
