"""The data of a lift's page agree with the files of the lift."""

import numpy as np
import pandas as pd
import pytest

import lumbar
from lumbar.interface.lift_page import saved_lifts
from lumbar.lifting.measures.balance import BaseOfSupport
from lumbar.publishing.lift_page.lift_data import balance_columns, body_columns

EVERY = slice(None, None, 50)


@pytest.fixture(scope="module")
def folder(saved_lift):
    return saved_lift[0]


@pytest.fixture(scope="module")
def page(folder):
    return lumbar.lift_page(folder)


def test_pendulums_end_at_the_centres_of_mass(folder, page):
    """Independent of the states: com.csv has the centres themselves."""
    drawn = body_columns(page.lift, EVERY)
    centres = pd.read_csv(folder / "com.csv")
    for com in ("thorax", "pelvis"):
        rows = centres[centres["com"] == com].iloc[EVERY]
        deposit = (rows["phase"] == "deposit").to_numpy()
        assert deposit.sum() > 1
        for plane, axis in (("flexion_extension", "y"), ("lateral_bending", "x")):
            assert np.isfinite(drawn[f"{com}/{plane}/up"]).tolist() == deposit.tolist()
            for name, wanted in (("across", axis), ("up", "z")):
                result = drawn[f"{com}/{plane}/{name}"][deposit]
                assert result == pytest.approx(rows[f"{wanted}_m"][deposit].to_numpy(), abs=1e-4)


def test_outlines_of_base_are_inside_by_margin(page):
    """The margin that is printed is the distance to the outline that is drawn."""
    share = page.settings.measures.functional_share
    drawn = balance_columns(page.course.frame, share, EVERY)
    corners = np.stack([drawn["used_x"], drawn["used_y"]], axis=-1)
    base = BaseOfSupport(corners, np.isfinite(corners).all(axis=-1))
    result, _ = base.margin(np.stack([drawn["xcom_x_m"], drawn["xcom_y_m"]], axis=-1))
    known = np.isfinite(result)
    assert known.sum() > 10
    assert result[known] == pytest.approx(drawn["margin_of_stability_m"][known], abs=1e-9)


def test_saved_lifts_of_a_folder_and_of_a_study_are_listed(folder, tmp_path):
    assert saved_lifts(folder) == [folder]
    assert saved_lifts(tmp_path) == []
    (tmp_path / "lifting").mkdir()
    (tmp_path / "lifting" / "one").symlink_to(folder)
    assert saved_lifts(tmp_path) == [tmp_path / "lifting" / "one"]
