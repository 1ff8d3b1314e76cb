"""Axes that labels without an alias contradict."""

import pytest

from lumbar.base.errors import InputError
from lumbar.lifting.quality.body import read_upright
from lumbar.lifting.quality.screening import read_screened
from lumbar.settings.lifting import LiftingSettings
from refusing import has_tokens, refusal


def test_usual_labels_without_alias_give_the_vertical_axis(shared, run):
    path = shared / "real" / "lifting" / "sts_trunk_flexion_trc" / "sts_unperturbed_1.trc"
    layout = LiftingSettings().markers
    for read in (read_upright, read_screened):
        with pytest.raises(InputError, match=r'unperturbed_1\.trc: markers\.up: \+z.*\+y.*"\+y"'):
            read(path, layout)
        read(path, layout.model_copy(update={"up": "+y", "forward": "+x"}))
        read(path, layout.model_copy(update={"check_axes": False}))
    assert has_tokens(run.refused("check", path), 'markers.up: +z…"+y"')


FACING = (
    ("s2m_box_transfer/Vicon.c3d", "+z", "-x"),
    ("sts_trunk_flexion_trc/sts_unperturbed_1.trc", "+y", "+x"),
)


@pytest.mark.parametrize(("name", "up", "forward"), FACING)
def test_usual_labels_without_alias_give_the_forward_axis(shared, run, name, up, forward):
    layout = LiftingSettings().markers.model_copy(update={"up": up})
    path = shared / "real" / "lifting" / name
    assert not read_upright(path, layout.model_copy(update={"forward": forward})).notes
    sideways = next(axis for axis in "xyz" if axis not in forward + up)
    for wrong in ("-+"[forward[0] == "-"] + forward[1], f"+{sideways}"):
        for read in (read_upright, read_screened):
            message = refusal(read, path, layout.model_copy(update={"forward": wrong}))
            assert has_tokens(message, f'markers.forward: {wrong}…along {forward}…forward: "{forward}"')
