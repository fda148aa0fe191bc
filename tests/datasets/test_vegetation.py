"""Crowns and grass stop beams by the laws that they state."""

import numpy as np
from numpy.testing import assert_allclose
from scipy.stats import kstest

from sklearn_mcmd.datasets._surfaces import Foliage, Patch, Reach, first_hits
from sklearn_mcmd.datasets._vegetation import Crown, Grass, hedge, leaves, tree


def test_leaves_of_balls_that_overlap_stop_beams_at_the_sum_of_their_rates():
    crown = Crown("crown", [Foliage("a", (0, 0, 0), 1.0), Foliage("b", (0, 0, 0), 0.5)])
    n = 200_000
    stops = crown.scatter(np.array([0.0, 0, 5]), np.tile([0.0, 0, -5], (n, 1)),
                          np.random.default_rng(0))  # fmt: skip
    # 2 m in a ball of free paths of .7 m and 1 m in one of .35 m.
    assert_allclose(np.isinf(stops).mean(), np.exp(-2 / 0.7 - 1 / 0.35), atol=4e-4)
    heights = 5 - 10 * stops[np.isfinite(stops)]
    assert_allclose((heights > 0.5).mean(), 1 - np.exp(-0.5 / 0.7), atol=5e-3)


def test_blades_of_grass_have_heights_of_a_rayleigh_law():
    grass = Grass("grass", (-1, -1, 0.5), (2, 0, 0), (0, 2, 0), 0.1)
    n = 20_000
    # On this line the waves of the height are nought.
    ends = np.column_stack([np.full(n, -1.0), np.random.default_rng(0).uniform(-1, 1, n),
                            np.zeros(n)])  # fmt: skip
    stops = grass.scatter(ends + np.array([0, 0, 2.0]), ends, np.random.default_rng(1))
    height = 2.0 * (1 - stops) - 0.5
    assert kstest(height[height < 0.29], "rayleigh", args=(0, 0.1 / np.sqrt(2))).pvalue > 1e-3
    assert (height <= 0.3 + 1e-12).all()
    assert (height > 0).all()


def test_beams_end_on_grass_over_its_ground_only():
    grass = Grass("grass", (0, 0, 0), (1, 0, 0), (0, 1, 0), 0.05)
    rng = np.random.default_rng(0)
    origins = rng.uniform((-3, -3, 2), (4, 4, 9), (5000, 3))
    ends = np.column_stack([rng.uniform(-0.5, 1.5, (5000, 2)), np.full(5000, -1.0)])
    stops = grass.scatter(origins, ends, rng)
    met = np.isfinite(stops)
    place = origins[met] + stops[met, None] * (ends - origins)[met]
    assert 500 < met.sum() < 4500
    assert ((place[:, :2] > -1e-9) & (place[:, :2] < 1 + 1e-9)).all()
    assert_allclose(grass.distance(place), 0, atol=1e-9)
    assert_allclose(grass.distance(np.array([[0.5, 0.5, 0.35], [2.0, 0.5, 0.1]])), [0.2, 1.0])


def test_crowns_and_hedges_keep_within_their_size():
    rng = np.random.default_rng(0)
    crown = leaves("leaves", (1, 2, 3), (1.0, 1.5, 2.0), 30, 0.3, rng)
    assert (crown.bounds[0] >= np.subtract((1, 2, 3), (1, 1.5, 2)) - 1e-9).all()
    assert (crown.bounds[1] <= np.add((1, 2, 3), (1, 1.5, 2)) + 1e-9).all()
    *trunk, top = tree("tree", (0, 0, 1), 8.0, 4.0, rng)
    assert trunk[0].bounds[0, 2] == 1.0
    assert top.bounds[1, 2] <= 9 + 1e-9
    row = hedge("hedge", (0, 0, 0), (6, 1, 1.2), rng)
    assert row.bounds[1, 2] <= 1.2 + 1e-9


def test_only_segments_that_cannot_hit_a_part_are_left_out():
    rng = np.random.default_rng(0)
    origins, ends = rng.uniform(-4, 4, (2, 20_000, 3))
    part = Patch("patch", (0, 0, 0), (1, 0, 0), (0, 2, 0))
    near = Reach(origins, ends).near(part.bounds)
    hit = np.flatnonzero(np.isfinite(part.hit(origins, ends)))
    assert len(hit) > 200
    assert np.isin(hit, near).all()
    assert len(near) < 10_000


def test_the_first_of_several_parts_ends_a_segment():
    low, high = (Patch("p", (-1, -1, z), (2, 0, 0), (0, 2, 0)) for z in (0.0, 1.0))
    origin = np.array([0.0, 0, 3])
    fraction, met = first_hits(
        [low, high], origin, np.array([[0.0, 0, -1], [3.0, 0, 0.5]]), np.random.default_rng(0)
    )
    assert_allclose(fraction, [0.5, np.inf])
    assert met.tolist() == [1, -1]
