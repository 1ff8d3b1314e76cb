"""Points that models and scripts compute are not used as markers, unless the file has no markers next to them."""

import numpy as np
import pytest

from lumbar.records.marker_file import MarkerFile, split_points

FOOT = "LFOF0 LFOF1 LHDF0 LHLX3 LTIB0 LTIB1 LANK1 LHE1 LHJC RAJCHarrington LArchHeight"


@pytest.mark.parametrize(
    ("labels", "computed"),
    [
        (f"LASI RASI LKNE LHEE LANK LTIB LHLX {FOOT}", FOOT),
        ("Ann:RKNE Ann:RHJC_study Ann:LHJC_study Ann:r_knee", "Ann:RHJC_study Ann:LHJC_study"),
        ("LASI PELVIS_Y L_Foot.X THORAX_ORIGIN", "PELVIS_Y L_Foot.X THORAX_ORIGIN"),
        ("LTIB LTIB2 LTIB3 LANK1 LKNE PEL0", ""),
        ("LHJC RHJC LKJC RKJC LAJC RAJC", ""),
        ("pelvis_4X4 l_thigh_4X4 l_shank_4X4", ""),
    ],
)
def test_computed_points_are_not_markers(labels, computed):
    file = MarkerFile("trial.c3d", np.arange(2.0), 1.0, "m")
    names = labels.split()
    split = split_points(file, names, np.ones((2, len(names), 3)))
    assert " ".join(split.model_points) == computed == " ".join(split.dropped)
    assert split.positions.keys() == set(names) - set(computed.split())
