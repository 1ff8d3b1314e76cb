"""``lumbar.identify_device``: mass, damping, dry friction and delay of a haptic device from its stylus in the air."""

import os
from dataclasses import replace

from lumbar.base.errors import InputError
from lumbar.interface.reading import read
from lumbar.interface.verb import settings_or_default
from lumbar.records.record import Record, require_one_axis
from lumbar.settings.study_settings import StudySettings
from lumbar.tissue.haptics.device_identification.identification import IdentifiedDevice, identify


def identify_device(
    recording: str | os.PathLike | Record, *, settings: StudySettings | None = None
) -> IdentifiedDevice:
    """Identify the haptic device from the force that its program commands and the position that its encoder reads.

    Nobody holds the stylus. Each row has the position that was read at a tick, and the force that was commanded upon it and
    held until the next one; a positive force pushes towards growing positions. The equation is
    m ẍ + b ẋ + F sign(ẋ) = f(t − τ); a constant force and a weak spring may act besides.
    A file has columns ``time_s``, ``force_N`` and ``position_mm``, or those of the ``tissue.layout`` of `settings`.

    Raises
    ------
    InputError
        A file that cannot be read; a recording that does not tell one of the numbers, with what to record instead; a motion
        that is not that of the equation.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.twin.device_recordings import write_example
    >>> write_example("device.csv")
    >>> found = lumbar.identify_device("device.csv")
    >>> round(found.device.mass_kg, 3), round(found.device.delay_ms, 1)
    (0.25, 1.3)
    >>> found.save("device.yaml")
    """
    if not isinstance(recording, Record):
        # The flat tops of a held force are no converter's.
        layout = replace(settings_or_default(settings).tissue.layout, clipped="accept")
        found = read(recording, "tissue", layout=layout)
        if len(found) > 1:
            raise InputError(f"{recording}: {len(found)} recordings; give the file of one")
        recording = found[0]
    require_one_axis([recording], "device")
    return identify(recording)
