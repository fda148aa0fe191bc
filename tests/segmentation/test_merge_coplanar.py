"""Which regions are parts of one plane, and which are not."""

import tracemalloc
from itertools import permutations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation
from sklearn.metrics import adjusted_rand_score

from growth import fitted_without
from sklearn_mcmd import RegionGrowing
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.segmentation import _merge_coplanar
from sklearn_mcmd.segmentation._merge_coplanar import _near, join_coplanar
from sklearn_mcmd.segmentation._region_sums import Moments


def walls(rng, *boxes, noise=0.003, density=3000):
    """Vertical walls: each of x from, to, y and slope of y; and which one points are of."""
    parts = []
    for low, high, y, slope in boxes:
        n = int(density * (high - low))
        x = rng.uniform(low, high, n)
        parts.append(np.column_stack([x, y + slope * (x - low), rng.uniform(0, 1, n)]))
    X = np.vstack(parts)
    return X + rng.normal(0, noise, X.shape), np.repeat(
        np.arange(len(parts)), list(map(len, parts))
    )


def planes_of(noise, radius=0.0):
    """Planes of which only the noise, and the radius of neighborhoods, are known."""
    return Planes.unknown(len(noise), 3)._replace(scale=noise, radius=np.full(len(noise), radius))


@pytest.mark.parametrize(
    ("second", "n_regions"),
    [
        ((1.3, 2.3, 0.0, 0.0), 1),
        ((1.3, 2.3, 0.05, 0.0), 2),
        ((1.3, 2.3, 0.0, 0.1), 2),
        ((4.0, 5.0, 0.0, 0.0), 2),
    ],
    ids=["a shadow cuts one wall", "a recess", "a bend", "far apart"],
)
def test_parts_of_one_plane_are_joined_across_short_gaps_only(second, n_regions):
    X, part = walls(np.random.default_rng(0), (0.0, 1.0, 0.0, 0.0), second)
    apart = fitted_without(X, "join_coplanar")
    assert apart.n_regions_ == 2
    assert adjusted_rand_score(part, apart.labels_) > 0.99
    assert RegionGrowing(random_state=0).fit(X).n_regions_ == n_regions


@pytest.mark.parametrize("seed", range(5))
def test_pairs_in_a_plane_are_found_wherever_regions_are_and_however_long(seed, monkeypatch):
    rng = np.random.default_rng(seed)
    n = 150
    monkeypatch.setattr(_merge_coplanar, "CHUNK", 7)
    monkeypatch.setattr(_merge_coplanar, "PAIRS", 11)
    centroids = rng.uniform(-40, 40, (n, 3)) * [1, 1, 5e-4] + [4e5, 5e6, 0]
    axes = Rotation.from_euler("z", rng.uniform(0, 360, (n, 1)), degrees=True).as_matrix()
    axes = axes[:, :, [2, 0, 1]]  # all are level
    values = np.column_stack([np.full(n, 1e-6), 10 ** rng.uniform(-2, 1, (2, n)).T])
    covariances = np.einsum("nij,nj,nkj->nik", axes, values, axes)
    sizes = rng.integers(10, 200, n).astype(float)
    noise = np.column_stack([rng.uniform(1e-3, 0.02, n), rng.choice([0, 0.02], n)])
    pairs, gap = _merge_coplanar._pairs_in_a_plane(Moments(sizes, centroids, covariances), noise)
    eigenvalues, vectors = np.linalg.eigh(covariances)
    length, expected = np.sqrt(12 * eigenvalues[:, 2]), []
    assert_allclose(gap, 0.5 * length)
    flat = eigenvalues[:, 0] <= (1.5 * noise.max(axis=1)) ** 2
    for r, s in permutations(np.flatnonzero(flat).tolist(), 2):
        apart, normal = centroids[s] - centroids[r], vectors[r, :, 0]
        thin = max(noise[r, 1], noise[s, 1]) if min(noise[r, 1], noise[s, 1]) > 0 else 0
        square = (apart @ normal) ** 2 + normal @ covariances[s] @ normal
        may_be = np.linalg.norm(apart) <= length[r] + 1.5 * length[s]
        may_be &= square <= (1.5 * max(noise[[r, s], 0].min(), thin)) ** 2
        if may_be and (sizes[s], s) < (sizes[r], r):
            expected.append((s, r))
    assert len(expected) > 20
    assert sorted(map(tuple, pairs.tolist())) == sorted(expected)


@pytest.mark.parametrize("seed", range(4))
def test_parts_of_a_plane_without_noise_are_joined_in_any_attitude(seed):
    # The least eigenvalue of a region is rounded by a share of its largest one, far above
    # what rounding of the coordinates amounts to.
    X = np.random.default_rng(0).uniform(0, 1, (4000, 3)) * [10, 1, 0]
    part = (X[:, 0] // 2).astype(int)
    X[:, 0] += 0.3 * part
    X = X @ Rotation.random(random_state=seed).as_matrix().T + [3, 7, 1]
    rounding = 8 * np.finfo(np.float64).eps * np.abs(X).max(axis=1)
    assert len(np.unique(join_coplanar(X, part, planes_of(rounding)))) == 1


def test_regions_that_are_not_flat_are_compared_with_none():
    # A table of 200 flat regions by all is 27 MB; a cloud of noise has far more that are not flat.
    points = np.random.default_rng(0).uniform(size=(21_000, 3))
    labels = np.arange(21_000) % 4200
    points[labels < 200, 2] = 10.0 + labels[labels < 200]
    tracemalloc.start()
    joined = join_coplanar(points, labels, planes_of(np.full(21_000, 1e-6)))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(np.unique(joined)) == 4200
    assert peak < 15e6


def test_parts_whose_neighborhoods_hide_the_noise_are_joined_by_the_noise_that_they_show():
    # A depth camera rounds depths to steps: neighborhoods on one step are flat, parts are not.
    rng = np.random.default_rng(0)
    X = rng.uniform(0, 1, (6000, 3)) * [2, 1, 0]
    X[:, 2] = np.round(rng.normal(0, 0.003, 6000) / 0.004) * 0.004
    part, quiet = (X[:, 0] > 1.0).astype(int), np.full(6000, 1e-5)
    assert len(np.unique(join_coplanar(X, part.copy(), planes_of(quiet)))) == 2
    assert len(np.unique(join_coplanar(X, part.copy(), planes_of(quiet, radius=0.04)))) == 1
    X[part == 1, 2] += 0.01  # three times the noise
    assert len(np.unique(join_coplanar(X, part.copy(), planes_of(quiet, radius=0.04)))) == 2


def test_a_small_part_in_two_planes_is_no_bridge_between_them():
    rng = np.random.default_rng(0)
    first, second = rng.uniform(0, 1, (2, 800, 3)) * [[[1, 0, 1]], [[0, 1, 1]]]
    corner = np.column_stack([np.zeros((12, 2)), np.linspace(0, 1, 12)])
    X = np.vstack([first, second, corner]) + rng.normal(0, 0.01, (1612, 3))
    labels = np.repeat([0, 1, 2], [800, 800, 12])
    joined = join_coplanar(X, labels, planes_of(np.full(len(X), 0.01)))
    assert joined[0] != joined[800]
    assert joined[-1] in (joined[0], joined[800])


@pytest.mark.parametrize("few", [1, 7, 10_000])
def test_gaps_are_those_of_the_nearest_points(few, monkeypatch):
    monkeypatch.setattr(_merge_coplanar, "FEW", few)
    rng = np.random.default_rng(few)
    corners, most = rng.uniform(0, 2.5, (12, 1, 3)), rng.uniform(0.1, 1.0, 12)
    points = corners + rng.uniform(0, 1, (12, 30, 3))
    pairs = np.column_stack(np.triu_indices(12, 1))
    gaps = [cdist(points[a], points[b]).min() for a, b in pairs]
    expected = gaps <= most[pairs[:, 0]]
    assert 5 < expected.sum() < 60
    parts = [[own[:10], own[10:]] for own in points]
    assert_array_equal(_near(parts, pairs, most), expected)
