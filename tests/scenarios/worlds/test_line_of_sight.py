"""Lines of sight against shapely, which shares no code with them."""

import numpy as np
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cooploc.scenarios.worlds.radio import bodies_between, walls_between

A, B = np.random.default_rng(0).uniform(0, 6, (2, 500, 2))
WALLS = np.random.default_rng(1).uniform(0, 6, (7, 2, 2))
coordinate = st.integers(-3, 3).map(float)  # a small grid, so that points touch and align
point = st.tuples(coordinate, coordinate)


def test_walls_are_counted_as_shapely_counts_them():
    sights = shapely.linestrings(np.stack([A, B], 1))
    expected = sum(shapely.intersects(sights, wall).astype(int) for wall in shapely.linestrings(WALLS))
    np.testing.assert_array_equal(walls_between(A, B, WALLS), expected)
    assert len(np.unique(expected)) > 3


@given(point, point, point, point)
@settings(max_examples=400)
def test_touching_and_collinear_walls_too(a, b, p, q):
    assume(a != b and p != q)  # a LineString has a length
    expected = shapely.intersects(shapely.LineString([a, b]), shapely.LineString([p, q]))
    assert walls_between(np.array(a), np.array(b), np.array([[p, q]])) == expected


def test_bodies_are_those_within_their_radius_of_the_line_of_sight(rng):
    centres = rng.uniform(0, 6, (500, 4, 2))
    sights = shapely.linestrings(np.stack([A, B], 1))
    expected = shapely.distance(sights[:, None], shapely.points(centres)) <= 0.3
    np.testing.assert_array_equal(bodies_between(A, B, centres, 0.3), expected)
    assert 0.01 < expected.mean() < 0.5
