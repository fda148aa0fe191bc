"""Creases: against the literal oracle, and each step against planes that meet in a known line."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from reference_edges import LiteralCreases
from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.edges._creases import (
    FAR,
    CreaseModel,
    _arc_residuals,
    _faces_or_smooth,
    _join,
    _median,
    _rounded,
    _roundness,
    _smooth_residuals,
    _solve,
    _to_line,
    told_distances,
)
from sklearn_mcmd.edges._faces import Faces
from sklearn_mcmd.planes._columns import split_columns


def fold(n, angle, noise, seed=0):
    x, y = np.random.default_rng(seed).uniform(-1, 1, (2, n))
    return np.column_stack([x, y, np.tan(np.radians(angle / 2)) * np.abs(x)]), noise


def corner(n, noise):
    rng = np.random.default_rng(1)
    points = rng.uniform(0, 1, (n, 3))
    points[np.arange(n), rng.integers(0, 3, n)] = 0
    return points, noise


def half_pole(n, noise):
    turn, z = np.random.default_rng(2).uniform(0, [[np.pi], [2]], (2, n))
    return np.column_stack([0.3 * np.cos(turn), 0.3 * np.sin(turn), z]), noise


def rounded_fold(n, noise):
    """A right angle rounded by a radius of a quarter."""
    s, y = np.random.default_rng(3).uniform([[-1], [0]], [[1], [2]], (2, n))
    r, length = 0.25, 0.25 * np.pi / 4
    turn = np.clip(s / r, -np.pi / 4, np.pi / 4)
    rest = np.sign(s) * np.maximum(np.abs(s) - length, 0)
    x = r * np.sin(turn) + rest * np.cos(turn)
    return np.column_stack([x, y, r * np.cos(turn) - rest * np.sin(turn)]), noise


def bend(n, noise):
    t = np.random.default_rng(4).uniform(-1, 1, n)
    return np.column_stack([t, np.maximum(t, 0)]), noise


CLOUDS = {
    "fold": (fold(200, 60, 0.01), 20),
    "blunt fold": (fold(200, 35, 0.03), 24),
    "corner": (corner(300, 0.01), 24),
    "half pole": (half_pole(200, 0.02), 20),
    "rounded fold": (rounded_fold(300, 0.002), 24),
    "bend": (bend(80, 0.005), 12),
    "too few for a quadric": (fold(80, 60, 0.01), 7),
}


def fitted(points, noise, k):
    points = points + np.random.default_rng(9).normal(0, noise, points.shape)
    columns = split_columns(RobustNormalEstimator(
        k, tangents=False, random_state=0
    ).fit_transform(points), points.shape[1])  # fmt: skip
    model = CreaseModel(k, 20.0).fit(columns)
    return points, columns, model


@pytest.mark.parametrize("name", CLOUDS)
def test_distances_and_evidence_are_those_of_the_oracle(name):
    cloud, k = CLOUDS[name]
    points, columns, model = fitted(*cloud, k)
    oracle = LiteralCreases(points, columns.planes(np.arange(len(points))), k, 20.0)
    evidence = np.empty(len(points))
    evidence[model.index.rows] = model.evidence
    assert np.isfinite(evidence).mean() > 0.05
    assert_allclose(evidence, oracle.evidence, rtol=1e-5, atol=1e-5)
    assert_allclose(model.distances, oracle.scores, rtol=1e-5)


def test_a_sharp_fold_is_an_edge_and_a_rounded_one_and_a_pole_are_not():
    def share(cloud):
        return np.mean(fitted(*cloud, 40)[2].distances < 2)

    # A band of four spacings, of 2 * 2 * 1.15 units for 2,000 points: 8 %.
    assert 0.06 < share(fold(2_000, 60, 0.005)) < 0.11
    assert share(rounded_fold(2_000, 0.002)) < 0.01
    assert share(half_pole(2_000, 0.002)) < 0.02


@pytest.mark.parametrize("angle", [30, 60, 90, 150])
def test_distances_are_those_to_the_line_of_two_planes(angle):
    points, _ = fold(1_500, angle, 0)
    model = fitted(points, 1e-4, 30)[2]
    found = model.distances * model.faces.spacing[model.index.places]
    near = (model.distances < 1.5) & (np.abs(points[:, 1]) < 0.8)
    assert near.sum() > 25
    truth = np.abs(points[near, 0]) / np.cos(np.radians(angle / 2))
    assert np.quantile(np.abs(found[near] - truth), 0.9) < 0.002  # spacings are .02 to .05


def test_noise_does_not_hide_a_blunt_fold():
    points, _ = fold(3_000, 40, 0)
    spacing = np.sqrt(4 / 3_000)
    found = fitted(points, 0.25 * spacing, 40)[2].distances < 2
    edge = np.abs(points[:, 0]) < spacing
    assert found[edge].mean() > 0.85
    assert found[np.abs(points[:, 0]) > 4 * spacing].mean() < 0.01


def test_the_spacing_is_the_mean_of_the_means_around():
    model = fitted(*fold(200, 60, 0.01), 20)[2]
    gaps = np.sort(np.linalg.norm(model.points[:, None] - model.points, axis=2), axis=1)
    spacing = gaps[:, 8] * np.sqrt(np.pi / 8)
    near = np.argsort(np.linalg.norm(model.points[:, None] - model.points, axis=2))[:, :20]
    for _ in range(2):
        spacing = spacing[near].mean(axis=1)
    assert_allclose(model.planes.spacing, spacing, rtol=1e-12)
    assert_allclose(model.faces.spacing, spacing[near].mean(axis=1), rtol=1e-12)


def two_planes(angle):
    """Points (1, k, 3) of two half planes that meet in the y axis, and unit normals."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-1, 1, (2, 30))
    half = np.radians(angle / 2)
    normals = np.array([[-np.sin(half), 0, np.cos(half)], [np.sin(half), 0, np.cos(half)]])
    return np.column_stack([x, y, np.tan(half) * np.abs(x)])[None], normals


@pytest.mark.parametrize("sharp", [True, False])
def test_evidence_is_negative_on_a_crease_and_positive_on_a_surface_of_second_order(sharp):
    points, normals = two_planes(60)
    right = points[..., 0] > 0
    given = np.where(right[..., None], normals[0], normals[1])
    if not sharp:
        points[..., 2] = 0.3 * points[..., 0] ** 2
    points[..., 2] += np.random.default_rng(1).normal(0, 0.01, right.shape)
    query = np.array([[0.2, 0.0, 0.2 * np.tan(np.pi / 6)]])
    own = Faces(normals[:1], np.zeros(1), np.zeros(1), np.full(1, 0.01), np.full(1, 0.4),
                np.ones(1, bool), np.ones(1, bool))  # fmt: skip
    cosines = np.abs(given @ normals[0])
    distance, evidence = _faces_or_smooth(query, own, points, given, np.zeros_like(cosines),
                                          cosines, ~right, np.cos(np.radians(20)))  # fmt: skip
    # From .2 right of the line, up the plane, in spacings of .4.
    assert_allclose(distance, 0.2 / np.cos(np.pi / 6) / 0.4)
    assert evidence[0] < -3 if sharp else evidence[0] > 20


@pytest.mark.parametrize(("side", "choose"), [(1, np.maximum), (-1, np.maximum),
                                              (1, np.minimum), (-1, np.minimum)])  # fmt: skip
def test_each_of_the_four_creases_of_two_planes_is_told(side, choose):
    rng = np.random.default_rng(0)
    xy = rng.uniform(-1, 1, (30, 2))
    first, second = xy[:, 0], xy[:, 1]
    # Points of the joined surface have heights (first, second) with choose(...) = 0.
    level = choose(first, side * second)
    first, second = first - level, second - side * level
    heights = np.stack([np.full(30, 5.0), second], axis=1)[None]
    heights = np.concatenate([heights, np.full((1, 30, 28), 9.0)], axis=2)
    allowed = np.ones((1, 30), bool)
    best, squares, joined = _join(first[None], heights, allowed, np.array([[3.0]]))
    assert best[0] == 1
    assert_allclose(squares, 0, atol=1e-20)
    assert_allclose(joined, 0, atol=1e-12)
    allowed[0, 1] = False
    best, squares, _ = _join(first[None], heights, allowed, np.array([[3.0]]))
    assert best[0] != 1
    assert squares[0] > 1
    assert_array_equal(_join(first[None], heights, allowed & False, np.array([[3.0]]))[1], np.inf)


@pytest.mark.parametrize(("up", "side"), [(1, 1), (1, -1), (-1, 1), (-1, -1)])
@pytest.mark.parametrize("radius", [1.0, 2.0])
def test_a_rounded_edge_leaves_no_residuals_in_one_of_its_ways(up, side, radius):
    half, spacing = np.radians(35), 0.1
    first = np.array([[np.sin(half), np.cos(half)]])
    second = np.array([[-np.sin(half), np.cos(half)]])
    # The arc's center is a radius below both lines, which meet in the origin.
    r = radius * spacing
    center = np.array([0, -r / np.cos(half)])
    turn = np.linspace(-half, half, 9)
    arc = center + r * np.column_stack([np.sin(turn), np.cos(turn)])
    along = np.linspace(0, 1, 6)[:, None]
    right = arc[-1] + along * [np.cos(half), -np.sin(half)]
    left = arc[0] + along * [-np.cos(half), -np.sin(half)]
    points = np.vstack([left, arc, right])
    one, two = (up * points @ first.T).T, (up * side * points @ second.T).T
    every = list(_rounded(one, up * first, two, up * side * second, np.full((1, 1), spacing)))
    least = [np.abs(residuals).max() for residuals in every]
    assert min(least) < 1e-12
    assert np.sort(least)[1] > 0.01


def test_a_cylinder_leaves_no_residuals_to_an_arc_and_a_fold_does():
    rng = np.random.default_rng(0)
    turn, z = rng.uniform(0, np.pi, 60), rng.uniform(-1, 1, 60)
    normals = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    pole = 0.7 * normals + np.outer(z, [0, 0, 1]) + 5
    pole[7] += 0.4 * normals[7]  # one that is off must not move the circle
    folded, two = two_planes(90)
    given = np.where(folded[0, :, :1] > 0, two[0], two[1])
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turned = (pole @ rotation)[None], (normals @ rotation)[None]
    residuals = _arc_residuals(*turned, np.full(1, 0.01))
    assert_allclose(residuals[0, 7], 0.4, atol=0.01)
    assert np.median(np.abs(residuals)) < 0.002
    assert np.std(_arc_residuals(folded, given[None], np.full(1, 0.01))) > 0.05


def test_a_surface_of_second_order_leaves_no_residuals_and_a_crease_does():
    rng = np.random.default_rng(0)
    u, v = rng.uniform(-1, 1, (2, 60))
    curved = np.column_stack([u, v, 0.3 * u * u - 0.2 * u * v + 0.1 * v])
    folded = np.column_stack([u, v, np.abs(u)])
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    both = np.stack([curved, folded]) @ rotation
    residuals = _smooth_residuals(both, np.full(2, 0.01))
    # Not exact for the curved one: the axes of the fit are tilted, so third orders remain.
    assert np.sqrt(np.mean(residuals[0] ** 2)) < 0.02
    assert np.sqrt(np.mean(residuals[1] ** 2)) > 0.05


def test_too_few_neighbors_for_a_curved_surface_are_told():
    assert _smooth_residuals(np.zeros((1, 7, 3)), np.ones(1)) is None


def test_deviations_weigh_as_hubers():
    rng = np.random.default_rng(0)
    terms, values = rng.normal(size=(1, 20, 3)), rng.normal(size=(1, 20))
    deviations = np.r_[np.zeros(5), 1.4 * np.ones(5), -6 * np.ones(10)][None]
    root = np.sqrt(np.r_[np.ones(10), 0.25 * np.ones(10)])
    expected = np.linalg.lstsq(terms[0] * root[:, None], values[0] * root, rcond=None)[0]
    assert_allclose(_solve(terms, values, deviations)[0], expected, rtol=1e-6)


def test_the_line_of_two_planes_is_as_far_as_trigonometry_says():
    # A plane 60 degrees steeper, .3 below the point: the line is .3 / sin 60 away.
    assert_allclose(_to_line(np.array([-0.3]), np.array([0.5])), 0.3 / np.sin(np.pi / 3))


def test_roundness_is_nothing_on_a_plane_and_one_in_a_ball():
    axes = np.vstack([np.eye(3), -np.eye(3)])
    assert_allclose(_roundness(np.stack([axes, axes * [1, 1, 0], axes * [1, 1, 0.5]])),
                    [1, 0, 3 * 0.25 / 2.25], atol=1e-12)  # fmt: skip


def test_distances_are_told_as_they_are_on_edges_and_as_more_elsewhere():
    pooled = np.array([-5.0, 0.0, np.log(3), 1e9, np.nan, -5.0, -5.0])
    distance = np.array([1.5, 1.5, 1.5, 1.5, 1.5, np.inf, 1.5])
    height = np.array([0, 0.1, 0, 0, 0, 0, 0.6])
    faces = Faces(*[None] * 2, height, np.full(7, 0.1), *[None] * 3)
    told = told_distances(faces, distance, pooled, np.full(7, 1.2 * FAR))
    # The last is 6 standard deviations off its plane: twice as many as count.
    assert_allclose(told, [1.5, 1.5, 4.5, 12, 12, 12, 3])


def test_medians_of_rows_leave_out_what_is_missing():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(50, 7))
    values[rng.random((50, 7)) < 0.4] = np.nan
    values[0] = np.nan
    expected = [np.median(row[~np.isnan(row)]) if not np.isnan(row).all() else np.nan
                for row in values]  # fmt: skip
    assert_allclose(_median(values), expected)
