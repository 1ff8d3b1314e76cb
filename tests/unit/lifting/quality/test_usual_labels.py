"""Axes that labels without an alias contradict."""

import pytest

from lumbar.base.errors import InputError
from lumbar.lifting.quality.body import read_upright
from lumbar.lifting.quality.screening import read_screened
from lumbar.settings.lifting import LiftingSettings
from refusing import refusal


def test_up_is_told_by_usual_labels_where_no_alias_names_them(shared, run):
    path = shared / "real" / "lifting" / "sts_trunk_flexion_trc" / "sts_unperturbed_1.trc"
    layout = LiftingSettings().markers
    for read in (read_upright, read_screened):
        with pytest.raises(InputError, match=r'stands along \+y by its usual labels.*set up: "\+y"'):
            read(path, layout)
        read(path, layout.model_copy(update={"up": "+y", "forward": "+x"}))
        read(path, layout.model_copy(update={"check_axes": False}))
    assert 'set up: "+y"' in run.refused("check", path)


FACING = (
    ("s2m_box_transfer/Vicon.c3d", "+z", "-x", "the front of the pelvis is ahead of its back"),
    ("sts_trunk_flexion_trc/sts_unperturbed_1.trc", "+y", "+x", "the toes are ahead of the heels"),
)


@pytest.mark.parametrize(("name", "up", "forward", "message"), FACING)
def test_forward_is_told_by_usual_labels_where_no_alias_names_them(shared, run, name, up, forward, message):
    layout = LiftingSettings().markers.model_copy(update={"up": up})
    path = shared / "real" / "lifting" / name
    assert not read_upright(path, layout.model_copy(update={"forward": forward})).notes
    for wrong in {"+x", "-x", "+y", "-y", "+z", "-z"} - {forward, up, up.replace("+", "-")}:
        for read in (read_upright, read_screened):
            words = refusal(read, path, layout.model_copy(update={"forward": wrong}))
            assert f"{message} along {forward} by its usual labels, which no alias names" in words
            assert f'set forward: "{forward}"' in words
