"""A synthetic lift: its marker file and its hip moment."""

from job import run

from lumbar.settings.twin import SyntheticLiftingSettings


def main(input, output, settings: SyntheticLiftingSettings, lift: str, gravity: float, seed: int):
    """Simulate the lift and write its marker file and hip moment."""
    import zlib

    from lumbar.twin.lifting_recordings import write_lift

    # Each lift has noise of its own, whatever other lifts the study has.
    own_seed = [seed, zlib.crc32(lift.encode())]
    write_lift(settings, lift, own_seed, output.markers, output.hip_moment, gravity)


run(main, snakemake)
