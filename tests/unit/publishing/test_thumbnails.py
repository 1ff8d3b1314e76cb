"""The cards' small pictures against the simulated forces that they show."""

from xml.etree import ElementTree

import numpy as np
import pytest

from lumbar.publishing.explorer.thumbnail import signature_thumbnail
from lumbar.tissue.effects.catalogue import PENDULUM, TISSUE
from lumbar.tissue.effects.signature import pictured_form, signatures

DRAWABLE = [
    (effect, system)
    for system, catalogue in (("tissue", TISSUE), ("pendulum", PENDULUM))
    for effect in catalogue.values()
    if pictured_form(effect) is not None
]


@pytest.mark.parametrize(("effect", "system"), DRAWABLE, ids=lambda value: getattr(value, "name", value))
def test_lines_are_the_forces_to_scale(effect, system):
    _, base, force = ElementTree.fromstring(signature_thumbnail(effect, system)).findall("{*}path")
    drawn = [np.reshape(line.get("d")[1:].split(), (-1, 2)).astype(float) for line in (base, force)]
    slow, _ = signatures(effect, system=system)
    whole = np.concatenate([item[:, 1] for item in drawn])
    assert min(item.min() for item in drawn) >= 0
    assert whole.max() <= 115
    simulated = np.concatenate([values[slow.last_cycle] for values in (slow.base, slow.force)])
    upwards = (whole.max() - whole) / np.ptp(whole)
    np.testing.assert_allclose(upwards, (simulated - simulated.min()) / np.ptp(simulated), atol=1e-3)
