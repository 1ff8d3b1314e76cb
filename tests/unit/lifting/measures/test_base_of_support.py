"""The base of support against squares, a convex-hull library, and feet on their toes or in the air."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from lumbar.lifting.measures.balance import BaseOfSupport, footprint, ground_contact

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.4, 0.6]])  # the last one lies inside


def base(corners, grounded=None):
    corners = np.asarray(corners, dtype=float)
    corners = corners.reshape(-1, *corners.shape[-2:])
    return BaseOfSupport(corners, np.ones(corners.shape[:2], bool) if grounded is None else grounded)


@pytest.mark.parametrize(
    ("point", "margin", "direction"),
    [
        ((0.5, 0.5), 0.5, None),
        ((0.9, 0.5), 0.1, (1, 0)),
        ((0.5, 0.2), 0.2, (0, -1)),
        ((1.0, 0.3), 0.0, (1, 0)),
        ((-0.25, 0.5), -0.25, (-1, 0)),
        ((1.3, 1.4), -0.5, (0.6, 0.8)),  # nearest to a corner
    ],
)
def test_distance_to_the_edge_of_a_square(point, margin, direction):
    actual, towards = base(SQUARE).margin(np.array([point]))
    assert actual == pytest.approx([margin], abs=1e-12)
    if direction is not None:
        assert towards[0] == pytest.approx(direction, abs=1e-12)


def test_margin_inside_a_hull_is_the_distance_to_qhull_s_facet():
    rng = np.random.default_rng(2)
    corners, points = rng.normal(size=(40, 8, 2)), 0.3 * rng.normal(size=(40, 2))
    actual, _ = base(corners).margin(points)
    nearest = [
        -(ConvexHull(hull).equations @ [*point, 1.0]).max()
        for hull, point in zip(corners, points, strict=True)
    ]
    inside = np.array(nearest) > 0
    assert inside.sum() > 20
    assert actual[inside] == pytest.approx(np.array(nearest)[inside], abs=1e-12)
    # Outside, the nearest facet's plane is a lower bound of how far the hull is.
    assert (actual[~inside] <= np.array(nearest)[~inside] + 1e-12).all()


def test_corners_in_the_air_do_not_count():
    on_ground = np.array([[True, True, False, False, False]])
    actual, _ = base(SQUARE, on_ground).margin(np.array([[0.5, 0.3]]))
    assert actual == pytest.approx([-0.3])  # the ground is touched along a line
    nothing = base(SQUARE, np.zeros((1, 5), bool))
    assert np.isnan(nothing.margin(np.array([[0.5, 0.5]]))[0])
    assert np.isnan(nothing.reach(np.array([[0.5, 0.5]]), np.array([[1.0, 0.0]])))


def test_the_functional_part_is_similar_about_the_centre():
    part = base(SQUARE[:4]).functional(0.6)
    assert part.margin(np.array([[0.5, 0.5]]))[0] == pytest.approx([0.3])
    assert part.reach(np.array([[0.5, 0.5]]), np.array([[0.6, 0.8]])) == pytest.approx([0.3 * 1.4])


def test_foot_ends_at_the_farther_of_toe_and_length():
    heel, near, far = np.array([[0.0, 0.1, 0.0]]), np.array([[0.0, 0.28, 0.0]]), np.array([[0.0, 0.4, 0.0]])
    flat, middle, ahead = np.array([True]), np.array([[0.0, 0.2]]), np.array([[0.0, 1.0]])
    assert footprint(heel, near, flat, flat, 0.26, 0.1).reach(middle, ahead) == pytest.approx([0.16])
    foot = footprint(heel, far, flat, flat, 0.26, 0.1)
    assert foot.reach(middle, ahead) == pytest.approx([0.2])
    assert foot.reach(middle, np.array([[1.0, 0.0]])) == pytest.approx([0.05])
    raised = footprint(heel, far, ~flat, flat, 0.26, 0.1)
    assert raised.reach(middle, -ahead) == pytest.approx([-0.2])
    aside = np.array([0.4, 0.0, 0.0])
    other = footprint(heel + aside, far + aside, flat, flat, 0.26, 0.1)
    both = BaseOfSupport(
        *(np.hstack([getattr(one, name) for one in (foot, other)]) for name in ("corners", "grounded"))
    )
    assert both.reach(middle, np.array([[1.0, 0.0]])) == pytest.approx([0.45])


def test_a_foot_is_off_the_ground_where_it_is_high_or_fast():
    time = np.arange(0, 3, 0.01)
    marker = np.zeros((len(time), 3))
    marker[:, 2] = 0.04 + 0.1 * ((time > 1) & (time < 1.5))  # held up, at rest
    marker[:, 1] = np.clip(time - 2, 0, 0.5)  # pushed over the ground at 1 m/s
    actual = ground_contact(marker, 100.0, 0.03, 0.3)
    assert not actual[(time > 1.02) & (time < 1.48)].any()
    assert not actual[(time > 2.02) & (time < 2.48)].any()
    assert actual[(time < 0.98) | ((time > 1.52) & (time < 1.98)) | (time > 2.52)].all()
