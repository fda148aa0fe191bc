"""Bends and folds: which of them a neighborhood holds, and the tangent planes of quadrics."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree

from reference_creases import fit_crease, off_quadric, over_mean_plane
from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.metrics import bias_angle
from sklearn_mcmd.planes._principal_planes import fit_planes, student_factors
from sklearn_mcmd.planes._quadrics import are_folded, quadric_normals, whole_planes
from sklearn_mcmd.planes._record import Neighborhoods, Planes

K = 50


class Cases:
    """Neighborhoods (m, k, d) over a disk of radius 1, of given heights, turned and moved.

    Before, the query of each is at the origin.
    """

    def __init__(self, height, noise, m=400, k=K, d=3, sizes=None, seed=0):
        rng = np.random.default_rng(seed)
        self.sizes = np.full(m, k) if sizes is None else sizes
        flat = rng.normal(size=(m, k, d - 1))
        distance = np.sort(rng.uniform(size=(m, k)) ** (1 / (d - 1)), axis=1)
        flat *= (distance / np.linalg.norm(flat, axis=2))[..., None]
        members = np.dstack([flat, height(flat) + noise * rng.normal(size=(m, k))])
        self.turns = np.linalg.qr(rng.normal(size=(m, d, d)))[0]
        self.members = np.matmul(members, np.swapaxes(self.turns, 1, 2)) + 3.0
        self.normals, self.queries = self.turns[:, :, -1], np.full((m, d), 3.0)
        self.points = self.members.reshape(-1, d)
        indices = np.arange(m * k, dtype=np.int32).reshape(m, k)
        self.around = Neighborhoods(indices, self.sizes)
        self.planes, self.left = whole(self.points, self.around)

    def faces(self, chosen):
        """The planes of some of the members, and the scales that these have."""
        fitted = fit_planes(self.members, chosen & self.around.valid)
        faces = Planes.empty(len(self.sizes), self.points.shape[1])
        faces.centroids[:], faces.eigenvalues[:] = fitted[:2]
        faces.normals[:] = fitted[2][..., 0]
        faces.scale[:] = np.sqrt(faces.eigenvalues[:, 0])
        return faces

    def folded(self, faces):
        return are_folded(self.points, self.around, self.planes, faces)

    def tangents(self):
        return quadric_normals(self.points, self.queries, self.around, self.planes, self.left)


def whole(points, around):
    """Planes of all members, and what quadrics leave of them."""
    planes, _, fit = whole_planes(points, around)
    return planes, fit.left


def crease(flat):
    return 0.5 * np.maximum(flat[..., 0] - 0.2, 0.0)


def bend(flat):
    return 0.3 * flat[..., 0] ** 2


def quadric(flat):
    """The terms of a quadric, and their derivatives by each coordinate."""
    n, d = flat.shape
    pairs = [(i, j) for i in range(d) for j in range(i, d)]
    terms = [np.ones(n), *flat.T, *(flat[:, i] * flat[:, j] for i, j in pairs)]
    slopes = np.zeros((n, d, len(terms)))
    for axis in range(d):
        slopes[:, axis, 1 + axis] = 1.0
        for place, (i, j) in enumerate(pairs, start=1 + d):
            slopes[:, axis, place] = (i == axis) * flat[:, j] + (j == axis) * flat[:, i]
    return np.column_stack(terms), slopes


def in_axes(members):
    """Mean, axes (rows, the normal first), heights and coordinates in the plane."""
    mean = members.mean(axis=0)
    axes = np.linalg.eigh(np.cov(members.T))[1].T
    height, *flat = axes @ (members - mean).T
    return mean, axes, height, np.array(flat).T


def is_folded(members, face):
    """Whether two planes leave less than a quadric does, of the best three quarters."""
    d = members.shape[1]
    others = np.abs((members - face.centroids[0]) @ face.normals[0]) > 1.5 * face.scale[0]
    if others.sum() <= d:
        return False
    *flat, heights = over_mean_plane(members, face.normals[0], in_axes(members[others])[1][0]).T
    flat, weights, best = np.array(flat).T, np.ones(len(heights)), int(0.75 * len(heights))
    left, _, _, above = fit_crease(flat, heights, weights, others)
    rest = off_quadric(flat, heights, weights)
    by_quadric, by_planes = (np.sort(h**2)[:best].sum() for h in (rest, np.abs(above).min(axis=0)))
    return left < np.inf and by_quadric > 0.6 * by_planes


def tangent_plane(members, query, left):
    """Normal, centroid and error of the tangent plane of a quadric."""
    d = members.shape[1]
    mean, axes, height, flat = in_axes(members)
    design, _ = quadric(flat)
    coefficients = np.linalg.lstsq(design, height)[0]
    foot = axes[1:] @ (query - mean)
    foot *= min(1.0, np.linalg.norm(flat, axis=1).max() / np.linalg.norm(foot))
    terms, gradient = quadric(foot[None])
    slopes = gradient[0] @ coefficients
    steep = 1 + slopes @ slopes
    normal = (axes[0] - slopes @ axes[1:]) / np.sqrt(steep)
    centroid = mean + foot @ axes[1:] + (terms @ coefficients) * axes[0]
    covariance = gradient[0] @ np.linalg.inv(design.T @ design) @ gradient[0].T
    across = np.eye(d - 1) - np.outer(slopes, slopes) / steep
    tilt = np.degrees(left * np.sqrt(np.trace(across @ covariance) / steep))
    freedom = np.array([len(members) - design.shape[1]])
    return normal, centroid, min(tilt * student_factors(freedom, d)[0], 90.0)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("height", [crease, bend])
def test_folds_are_those_of_least_squares_by_numpy(height, d):
    sizes = np.random.default_rng(1).integers(12, K + 1, 300)
    cases = Cases(height, 0.02, m=300, sizes=sizes, d=d)
    faces = cases.faces(np.arange(K) < sizes[:, None] // 2)
    folded = cases.folded(faces)
    for i, size in enumerate(sizes):
        assert folded[i] == is_folded(cases.members[i, :size], faces.take([i]))
    assert 0 < folded.sum() < 300


@pytest.mark.parametrize("d", [2, 3])
def test_tangents_are_those_of_least_squares_by_numpy(d):
    sizes = np.random.default_rng(1).integers(8, K + 1, 300)
    cases = Cases(bend, 0.02, m=300, sizes=sizes, d=d)
    cases.queries = cases.queries + np.random.default_rng(2).normal(0, 0.7, (300, d))
    normals, centroids, errors = cases.tangents()
    for i, size in enumerate(sizes):
        members = cases.members[i, :size]
        normal, centroid, error = tangent_plane(members, cases.queries[i], cases.left[i])
        normal *= np.sign(normal @ normals[i])
        assert_allclose(normals[i], normal, rtol=1e-7, atol=1e-9)
        assert_allclose(centroids[i], centroid, rtol=1e-7, atol=1e-9)
        assert_allclose(errors[i], error, rtol=1e-7)


def test_members_that_determine_no_quadric_keep_their_plane():
    cases = Cases(lambda flat: 0.0 * flat[..., 0], 0.0, m=5)
    lines = cases.members.copy()
    lines[:, 1::2] = lines[:, :1]
    lines[:, ::2] = lines[:, :1] + np.linspace(0, 1, 25)[:, None] * [1.0, 2, 3]
    cases.points = lines.reshape(-1, 3)
    normals, centroids, errors = cases.tangents()
    assert_array_equal(normals, cases.planes.normals)
    assert_array_equal(centroids, cases.planes.centroids)
    assert_array_equal(errors, 90.0)


@pytest.mark.parametrize("k", [20, 30, 50])
@pytest.mark.parametrize("bends", [(0.3, 0.0), (0.3, 0.3), (0.3, -0.3)])
def test_standard_errors_of_tangents_hold_95_percent(k, bends):
    def height(flat):
        return np.square(flat) @ bends

    cases = Cases(height, 0.02, m=4000, k=k)
    normals, _, errors = cases.tangents()
    assert 0.93 <= (bias_angle(normals, cases.normals) <= 1.73 * errors).mean() <= 0.97


@pytest.mark.parametrize("radius", [3, 10])
def test_a_fillet_is_measured_as_well_as_by_a_quadric(radius):
    """Two faces at a right angle whose edge is rounded with a radius of so many spacings."""
    rng = np.random.default_rng(0)
    n, spacing = 6000, 0.02
    r = radius * spacing
    arc, face = np.pi / 2 * r, 0.6
    at = rng.uniform(0, 2 * face + arc, n)
    width = n * spacing**2 / (2 * face + arc)
    angle = np.clip((at - face) / r, 0, np.pi / 2)
    normals = np.column_stack([np.sin(angle), np.zeros(n), np.cos(angle)])
    center = np.column_stack([np.minimum(at, face), rng.uniform(0, width, n), np.zeros(n)])
    center[:, 2] = -np.maximum(at - face - arc, 0.0)
    X = center + r * normals
    inside = np.abs(at - face - arc / 2) < arc / 2 + 4 * spacing
    inside &= np.abs(center[:, 1] - width / 2) < width / 2 - 4 * spacing
    for noise in (0.0, 0.2 * spacing):
        noisy = X + rng.normal(0, noise, X.shape)
        estimator = RobustNormalEstimator(random_state=0).fit(noisy)
        error = bias_angle(estimator.normals_, normals)[inside]
        _, near = cKDTree(noisy).query(noisy, K)
        around = Neighborhoods(near.astype(np.int32), np.full(n, K))
        quadrics, _, _ = quadric_normals(noisy, noisy, around, *whole(noisy, around))
        bound = bias_angle(quadrics, normals)[inside]
        assert np.sqrt((error**2).mean()) <= 1.1 * np.sqrt((bound**2).mean())
