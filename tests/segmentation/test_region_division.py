"""Which regions are divided at creases; and votes against literal forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree
from sklearn.metrics import adjusted_rand_score

from growth import fitted_without
from reference_creases import fit_crease, off_plane, off_quadric
from sklearn_mcmd import RegionGrowing
from sklearn_mcmd.datasets import make_crown_roof
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._quadrics import work_arrays
from sklearn_mcmd.segmentation._cylinder_parts import FitLimits
from sklearn_mcmd.segmentation._merge_coplanar import JoinLimits
from sklearn_mcmd.segmentation._region_division import _joined, _settled, join_blunt
from sklearn_mcmd.segmentation._regions_numba import vote

FIT, MOST_NOISE = FitLimits(), JoinLimits().most_noise


def roof(n, crease, noise, seed=0):
    """A gable of 2 by 2 whose planes' normals differ by an angle; noise in spacings."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-1, 1, n), rng.uniform(0, 2, n)
    z = -np.tan(np.radians(crease / 2)) * np.abs(x) + rng.normal(0, noise * 2 / np.sqrt(n), n)
    return np.column_stack([x, y, z]), x > 0


def barrel(n, noise, seed=0, turn=50.0):
    """A vault of 2 by 2 that turns by an angle from one side to the other; noise in spacings."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-1, 1, n), rng.uniform(0, 2, n)
    z = np.sqrt(1 / np.sin(np.radians(turn / 2)) ** 2 - x * x)
    return np.column_stack([x, y, z + rng.normal(0, noise * 2 / np.sqrt(n), n)])


@pytest.mark.parametrize(
    ("n", "crease", "noise"), [(400, 35, 0.2), (1000, 20, 0.2), (5000, 10, 0.2), (20_000, 35, 0.3)]
)
def test_blunt_creases_divide_a_roof_that_growth_alone_leaves_whole(n, crease, noise):
    X, side = roof(n, crease, noise)
    whole = fitted_without(X, "divide_at_creases").labels_
    assert adjusted_rand_score(side, whole) < 0.1
    # Cells at the ridge have points of both sides: 15 of 400 are some .1.
    assert adjusted_rand_score(side, RegionGrowing(random_state=0).fit_predict(X)) > 0.75


@pytest.mark.parametrize("n", [400, 3000, 20_000])
@pytest.mark.parametrize("noise", [0.1, 0.3])
def test_vaults_stay_whole(n, noise):
    assert RegionGrowing(random_state=0).fit(barrel(n, noise)).n_regions_ == 1


@pytest.mark.parametrize("noise", [0.1, 1.0])
def test_drains_saddles_and_waving_walls_stay_whole(noise):
    """Planes of 2 degrees fall to a drain and meet by 2.8; the wall turns by 6 degrees and back."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-50, 50, (2, 10_000))
    drained = np.tan(np.radians(2)) * np.maximum(np.abs(x), np.abs(y))
    saddle = np.tan(np.radians(5)) * (x * x - y * y) / 100
    waving = np.tan(np.radians(3)) * 100 / (2 * np.pi) * np.sin(2 * np.pi * x / 100)
    for heights in (drained, saddle, waving):
        X = np.column_stack([x, y, heights + rng.normal(0, noise, 10_000)])
        assert RegionGrowing(random_state=0).fit(X).region_sizes_[0] > 9500


def bent_faces(crease, bend, seed):
    """Two faces of 1 by 2 that meet in a crease and are bent along it."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-1, 1, (2, 5000))
    z = bend * y * y - np.tan(np.radians(crease / 2)) * np.abs(x) + rng.normal(0, 0.004, 5000)
    return np.column_stack([x, y, z]), x > 0


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("crease", [25, 40, 60])
def test_a_crease_steeper_than_the_angle_parts_bent_faces(crease, seed):
    X, side = bent_faces(crease, 0.1, seed)
    assert adjusted_rand_score(side, RegionGrowing(random_state=0).fit_predict(X)) > 0.96


def test_a_crease_blunter_than_the_angle_parts_planes_alone():
    """Growth alone leaves both whole; the bent faces came as two regions."""
    for bend, n_regions in ((0.0, 2), (0.1, 1)):
        X, _ = bent_faces(8, bend, seed=0)
        assert RegionGrowing(random_state=0).fit(X).n_regions_ == n_regions


def join_blunt_literally(X, labels, regions, normals, noise, min_cosine, k):
    """Part by part, border by border, point by point."""
    near, flat = cKDTree(X).query(X, k)[1], {}
    for part in np.unique(labels[labels >= 0]):
        own = labels == part
        centered = X[own] - X[own].mean(axis=0)
        rms = np.linalg.svd(centered, compute_uv=False)[-1] / np.sqrt(own.sum())
        usual = np.sort(noise[own])[own.sum() // 2]
        flat[part] = own.sum() > 3 and rms <= MOST_NOISE * usual
    cosines, joined = {}, np.array(labels)
    for i, row in enumerate(near):
        a = labels[i]
        beyond = [
            j for j in row
            if min(a, labels[j]) >= 0 and labels[j] != a and regions[labels[j]] == regions[a]
            and not (flat[a] and flat[labels[j]])
        ]  # fmt: skip
        if beyond:
            end, here = beyond[-1], row[labels[row] == a]
            start = max(here, key=lambda j: np.linalg.norm(X[j] - X[end]))
            border = cosines.setdefault(tuple(sorted((a, labels[end]))), [])
            border.append(abs(normals[start] @ normals[end]))
    for (a, b), border in cosines.items():
        if sorted(border)[len(border) // 2] >= min_cosine:
            joined[joined == joined[labels == b][0]] = joined[labels == a][0]
    return joined


@pytest.mark.parametrize("seed", range(5))
def test_parts_are_joined_as_by_the_literal_form(seed):
    rng = np.random.default_rng(seed)
    X = rng.uniform(0, 1, (600, 3)) * [1, 1, 0.02]
    labels = (np.floor(4 * X[:, 0]) + 4 * np.floor(3 * X[:, 1])).astype(int)
    turn = rng.uniform(0, 0.4, 12)[labels] + rng.normal(0, 0.05, 600)
    normals = np.column_stack([np.sin(turn), np.zeros(600), np.cos(turn)])
    labels[rng.random(600) < 0.1] = -1
    regions, noise = rng.integers(0, 2, 12), rng.uniform(0.002, 0.006, 12)[labels]
    index = NeighborIndex(X, 20)
    rows = index.rows
    of_planes = index, normals[rows], noise[rows]
    found = join_blunt(labels[rows], regions, *of_planes, np.cos(np.radians(10)))
    of_rows = X[rows], labels[rows], regions, normals[rows], noise[rows]
    expected = join_blunt_literally(*of_rows, np.cos(np.radians(10)), 20)
    assert_array_equal(found == -1, expected == -1)
    inside = found >= 0
    assert adjusted_rand_score(expected[inside], found[inside]) == 1.0
    assert 1 < len(np.unique(expected[inside])) < 12


def test_a_road_stays_whole_and_its_kerb_a_step(shared_data):
    """Of its region 6 % are of another class: ground that meets the road by 2 to 7 degrees."""
    with np.load(shared_data / "mobile_street_labelled" / "cloud.npz") as arrays:
        X, road = arrays["xyz"], arrays["label"] == 1203
    labels = RegionGrowing(random_state=0, n_jobs=2).fit_predict(X)
    largest = labels == np.bincount(labels[road & (labels >= 0)]).argmax()
    assert (largest & road).sum() > 0.95 * road.sum()
    assert (largest & road).sum() > 0.93 * largest.sum()


@pytest.mark.parametrize("turn", [20, 25])
@pytest.mark.parametrize(("width", "own"), [(3, False), (6, True), (12, True)])
def test_a_wide_side_is_a_face_and_a_narrow_one_an_edge(width, own, turn):
    """Eaves of a roof that are bent down; widths are in spacings."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-40, width, 40 * (40 + width)), rng.uniform(0, 40, 40 * (40 + width))
    z = -np.tan(np.radians(turn)) * np.maximum(x, 0) + rng.normal(0, 0.1, len(x))
    labels = RegionGrowing(random_state=0).fit_predict(np.column_stack([x, y, z]))
    of_roof = labels == np.bincount(labels[x < 0] + 1).argmax() - 1
    assert np.mean(of_roof[x > 0]) < 0.1 if own else of_roof.mean() > 0.95


def test_faces_that_are_bent_themselves_part_where_the_noise_hides_the_creases():
    scene = make_crown_roof(30_000, random_state=0)
    labels = RegionGrowing(random_state=0).fit_predict(scene.data)
    assert adjusted_rand_score(scene.surface, labels) > 0.95


def test_rings_that_a_given_gap_joins_are_not_torn_without_a_vote():
    """Rings of a scanned tunnel are farther apart than the nearer half of the neighbors reaches."""
    rng = np.random.default_rng(0)
    angle, along = (
        np.tile(np.linspace(0, 2 * np.pi, 600, endpoint=False), 12),
        np.repeat(range(12), 600),
    )
    X = np.column_stack([3 * np.cos(angle), 0.3 * along, 3 * np.sin(angle)])
    X += rng.normal(0, 0.003, X.shape)
    whole = fitted_without(X, "divide_at_creases", max_gap=0.5)
    divided = RegionGrowing(max_gap=0.5, random_state=0).fit(X)
    assert divided.region_sizes_[0] >= 0.96 * whole.region_sizes_[0] > 0.7 * len(X)


def vote_by_numpy(points, weights, cells, first, blunt):
    """A vote over the plane z = 0, and the second of its two sides, by general least squares."""
    flat, z = points[:, :2], points[:, 2]
    smooth = off_quadric(flat, z, weights)
    one, other = (off_plane(points, weights * side) for side in (first, ~first))
    step = MOST_NOISE**2 * (weights @ np.where(first, one, other) ** 2)
    left, side, crease, _ = fit_crease(flat, z, weights, first)
    rest = crease if left < np.inf else smooth
    if blunt and left < weights @ smooth**2:
        smooth = crease
    if blunt or step < left:
        left, side = step, first
    rest = smooth if weights @ smooth**2 <= left else rest
    rest = rest * np.sqrt(weights)
    effect = max(np.square(np.bincount(cells, rest)).sum() / (rest @ rest), 1.0)
    n = len(z) / effect
    return (n * np.log(left / (weights @ smooth**2)) + 3 * np.log(n)) / 2, side


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("blunt", [False, True])
@pytest.mark.parametrize("make", ["gable", "barrel", "step", "ledge", "plane"])
def test_votes_are_those_of_general_least_squares(make, blunt, seed):
    X, first = roof(300, 25 if make in ("gable", "ledge") else 0, 0.2, seed)
    if make == "barrel":
        X = barrel(300, 0.2, seed)
        first = X[:, 0] > 0
    X[:, 2] += (make in ("step", "ledge")) * 0.3 * first
    order = np.lexsort((np.floor(4 * X[:, 1]), np.floor(4 * X[:, 0])))
    X, first = X[order] - X.mean(axis=0), X[order, 0] > 0
    cells, weights = np.arange(300) // 15, np.random.default_rng(seed).uniform(20, 60, 300) ** 2
    normals = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    # The ridge of the normal equations is a millionth of a millionth.
    expected, expected_sides = vote_by_numpy(X, weights, cells, first, blunt)
    sides, (room, equations) = np.stack([first] * 3), work_arrays(6, 300)
    members = X.T.copy(), weights, cells, normals
    found = vote(*members, FIT, MOST_NOISE, blunt, room, equations, sides)
    assert_allclose(found, expected, rtol=1e-6)
    assert_array_equal(sides[2], expected_sides)
    assert blunt or (found > 0) == (make in ("barrel", "plane"))


def test_groups_are_joined_by_the_highest_sum_of_votes():
    """What parts two groups of a region is surer than by the logarithm of its borders."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        region = np.arange(12) // 9
        borders = np.array([(a, b) for b in range(12) for a in range(b) if rng.uniform() < 0.4])
        borders = borders[region[borders[:, 0]] == region[borders[:, 1]]]
        votes = rng.normal(-1.0, 2.0, size=len(borders))
        group = np.arange(12)
        while True:  # the literal form: all sums anew for each
            sums = {}
            for (a, b), value in zip(group[borders], votes, strict=True):
                if a != b:
                    key = min(a, b), max(a, b)
                    sums[key] = sums.get(key, 0.0) + value
            chances = np.bincount(region[borders[:, 0]], minlength=2)[region]
            joined = {key: value for key, value in sums.items() if value > -np.log(chances[key[0]])}
            if not joined:
                break
            best = max(joined, key=joined.get)
            group[group == best[1]] = best[0]
        assert_array_equal(_joined(borders, votes, region), group)


def test_narrow_patches_join_no_groups_that_wide_ones_part():
    """0 and 1 are parted, as are 1 and 2; 3 is beside 0 and 1, 4 and 5 are bridges of 0 and 2."""
    wide, region = np.array([True, True, True, False, False, False]), np.zeros(6, int)
    borders = np.array([(0, 1), (1, 2), (0, 3), (1, 3), (0, 4), (2, 5), (4, 5)])
    group, mixed = _settled(np.arange(6), borders, wide, region)
    assert mixed.tolist() == [False, False, False, True, False, False]
    # Nothing speaks against two parts that no border of wide patches parts.
    assert group[0] == group[2] == group[4] == group[5] != group[1]
    # What wide patches part stays apart.
    borders = np.array([(0, 1), (0, 2), (1, 3), (2, 3)])
    wide, region = wide[[0, 1, 3, 4]], region[:4]
    group, mixed = _settled(np.arange(4), borders, wide, region)
    assert group[0] != group[1]
    assert not mixed.any()
