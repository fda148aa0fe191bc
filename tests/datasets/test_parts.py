"""The parts of a scene: truth against brute force."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial import cKDTree
from scipy.stats import kstest

from benchmarks.simulators._panels import Disc, Polygon
from sklearn_mcmd.datasets._bilinear import Bilinear
from sklearn_mcmd.datasets._surfaces import Cylinder, Foliage, Patch

PARTS = {
    "patch": Patch("patch", (1, 2, 3), (0.6, 0.8, 0), (-1.6, 1.2, 0)),
    "patch with holes": Patch(
        "wall",
        (0, 1, 0),
        (4, 0, 0),
        (0, 0, 2),
        holes=[(0.5, 1.5, 0.5, 1.5), (2.5, 3.2, 0, 1.2)],
        smooth=("u0", "v1"),
    ),
    "cylinder": Cylinder("pole", (1, 1, 0), (0.5, 0, 2), 0.3),
    "arc": Cylinder("arc", (0, 0, 0), (2, 0, 0), 1.5, start=(0, 0, 1), arc=1.0, sharp=("stop",)),
    "polygon": Polygon("kite", [(0, 0, 0), (1, 0, 0.5), (1.2, 1, 0.6), (0.3, 1.4, 0.15)]),
    "disc": Disc("lid", (1, 2, 3), (1, -2, 2), 0.8),
    "bilinear": Bilinear("roof", [(0, 0, 0), (1, 0, 0.8), (1.1, 1.2, 0), (0, 1, 0.9)]),
    "flat bilinear": Bilinear("floor", [(0, 0, 1), (1.5, 0, 1), (1, 1, 1), (0, 0.5, 1)]),
}

#: Hand-written ends of the sharp straight edges of the patch with holes.
WALL_EDGES = [
    ((0, 1, 0), (2.5, 1, 0)),
    ((3.2, 1, 0), (4, 1, 0)),
    ((4, 1, 0), (4, 1, 2)),
    ((0.5, 1, 0.5), (1.5, 1, 0.5)),
    ((0.5, 1, 1.5), (1.5, 1, 1.5)),
    ((0.5, 1, 0.5), (0.5, 1, 1.5)),
    ((1.5, 1, 0.5), (1.5, 1, 1.5)),
    ((2.5, 1, 0), (2.5, 1, 1.2)),
    ((3.2, 1, 0), (3.2, 1, 1.2)),
    ((2.5, 1, 1.2), (3.2, 1, 1.2)),
]

each_part = pytest.mark.parametrize("part", PARTS.values(), ids=PARTS.keys())


def along(edges, n=4001):
    """Dense points on straight edges."""
    share = np.linspace(0, 1, n)[:, None]
    return np.concatenate([np.array(a) + share * (np.array(b) - a) for a, b in edges])


@each_part
def test_samples_lie_on_their_part_and_reach_its_bounds(part):
    points = part.sample(20_000, np.random.default_rng(0))
    assert_allclose(part.distance(points), 0, atol=1e-12)
    assert_allclose(points.min(axis=0), part.bounds[0], atol=0.03)
    assert_allclose(points.max(axis=0), part.bounds[1], atol=0.03)
    assert (points >= part.bounds[0] - 1e-6).all()
    assert (points <= part.bounds[1] + 1e-6).all()


@each_part
def test_the_distance_to_a_part_is_that_to_a_dense_sample_of_it(part):
    rng = np.random.default_rng(1)
    sample = part.sample(200_000, rng)
    queries = rng.uniform(part.bounds[0] - 1, part.bounds[1] + 1, (300, 3))
    brute = cKDTree(sample).query(queries)[0]
    exact = part.distance(queries)
    assert (brute >= exact - 1e-9).all()
    # 200 000 points on 7 m^2 or less leave holes of up to 3 cm (corners are the worst).
    assert_allclose(exact, brute, atol=0.03)


@each_part
def test_a_step_along_the_normal_is_the_distance_from_the_part(part):
    points = part.sample(1000, np.random.default_rng(2))
    normals = part.normals(points)
    assert_allclose(np.linalg.norm(normals, axis=1), 1, rtol=1e-12)
    assert_allclose(part.distance(points + 0.01 * normals), 0.01, rtol=1e-9)


def test_samples_are_uniform_over_the_cells_of_a_patch_with_holes():
    part = PARTS["patch with holes"]
    points = part.sample(100_000, np.random.default_rng(3))
    assert part.area == pytest.approx(8 - 1 - 0.84)
    left = (points[:, 0] < 0.5).mean()
    assert left == pytest.approx(1 / 6.16, abs=5 * np.sqrt(0.16 * 0.84 / 1e5))


def test_edges_of_a_patch_with_holes_are_those_written_by_hand():
    part = PARTS["patch with holes"]
    points = part.sample(2000, np.random.default_rng(4))
    brute = cKDTree(along(WALL_EDGES)).query(points)[0]
    # The dense points are 1 mm apart or less: at most half of it off, and never nearer.
    assert_allclose(part.edge_distance(points), brute, atol=5e-4)
    assert (part.edge_distance(points) <= brute + 1e-12).all()
    assert part.outline_length == pytest.approx(2.5 + 0.8 + 2 + 4 + 2.4 + 0.7)


def test_a_pole_has_its_circles_and_an_arc_its_side_as_edges():
    pole = Cylinder("pole", (0, 0, 1), (0, 0, 2), 0.3)
    points = pole.sample(500, np.random.default_rng(5))
    height = points[:, 2] - 1
    assert_allclose(pole.edge_distance(points), np.minimum(height, 2 - height), atol=1e-12)
    arc = PARTS["arc"]
    points = arc.sample(500, np.random.default_rng(6))
    # The arc runs from z right-handed around x, that is towards -y.
    side = 1.5 * np.array([-np.sin(1.0), np.cos(1.0)])
    assert_allclose(arc.edge_distance(points), np.linalg.norm(points[:, 1:] - side, axis=1))


@pytest.mark.parametrize("part", [p for p in PARTS.values() if not isinstance(p, Bilinear)])
def test_rays_meet_a_part_where_its_distance_is_zero_and_nowhere_before(part):
    rng = np.random.default_rng(8)
    low, high = part.bounds
    origin = (low + high) / 2 + np.array([0.7, -2.5, 1.9])
    ends = origin + 2.5 * (rng.uniform(low - 0.2, high + 0.2, (400, 3)) - origin)
    fraction = part.hit(origin, ends)
    hits = np.isfinite(fraction)
    assert 50 < hits.sum() < 400
    met = origin + fraction[hits, None] * (ends - origin)[hits]
    assert_allclose(part.distance(met), 0, atol=1e-9)
    # Sphere tracing: steps shorter than the distance never jump over a surface.
    travelled = np.zeros(400)
    lengths = np.linalg.norm(ends - origin, axis=1)
    for _ in range(500):
        traced = travelled / lengths
        step = 0.99 * part.distance(origin + traced[:, None] * (ends - origin))
        travelled += np.where(step > 1e-9, step, 0)  # arrived: rounding must not push it through
        np.minimum(travelled, 1.01 * lengths, out=travelled)
    # Rays that graze a border creep, so a few misses have not reached their ends yet.
    assert_allclose(traced[hits], fraction[hits], atol=1e-3)
    assert (traced[~hits] > 1).mean() > 0.98


def test_foliage_fills_its_ball_evenly_and_has_no_normal_or_edge():
    ball = Foliage("foliage", (1, 2, 3), 0.7)
    points = ball.sample(5000, np.random.default_rng(10))
    reach = np.linalg.norm(points - [1, 2, 3], axis=1) / 0.7
    assert kstest(reach**3, "uniform").pvalue > 1e-3
    assert np.isnan(ball.normals(points)).all()
    assert np.isnan(ball.edge_distance(points)).all()
    assert_allclose(ball.distance(np.array([[1, 2, 4.0], [1, 2, 3.1]])), [0.3, 0])


def test_samples_of_a_bilinear_surface_are_uniform_over_its_area():
    part = PARTS["bilinear"]
    points = part.sample(40_000, np.random.default_rng(0))
    # Area of a half by triangles of a fine grid, independent of the parametrization's Jacobian.
    u = np.linspace(0, 1, 201)
    grid = part._surface(*(g.ravel() for g in np.meshgrid(u, u))).reshape(201, 201, 3)
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]
    cells = sum(
        np.linalg.norm(np.cross(y - x, z - x), axis=-1) / 2 for x, y, z in ((a, b, c), (d, c, b))
    )
    assert part.area == pytest.approx(cells.sum(), rel=1e-4)
    in_half = part._foot(points)[0] < 0.5
    share = cells[:, :100].sum() / cells.sum()
    assert in_half.mean() == pytest.approx(share, abs=5 * np.sqrt(0.25 / 40_000))
