"""Moving, turning, scaling, reordering or copying a cloud does to results what the table says.

The tolerance is argued: coordinates of a moved cloud are rounded by eps of the largest of them. As
a share of the noise, which is the least length that results depend on, that is the relative error
of what is computed, but for its condition, which CONDITION bounds.
"""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from public import (
    CLOUDS,
    ESTIMATORS,
    NOISE,
    ROW_NUMBERS,
    Motion,
    assert_same,
    cloud_for,
    expected_results,
    fitted,
    results,
    row_order,
)
from sklearn_mcmd.adjustment import BaardaPlaneDetector, compare_planes, flatness
from sklearn_mcmd.baselines._methods import COMPARATORS
from sklearn_mcmd.metrics import bias_angle

CONDITION = 1_000
EPS = np.finfo(float).eps
UTM, GEOCENTRIC = (5e5, 5e6, 100.0), (4e6, -3e6, 4e6)
FEET = 3.280839895013123

motions = st.builds(
    lambda angles, shift, scale, seed: (angles, shift, scale, seed),
    st.tuples(*[st.floats(-3.14, 3.14)] * 3),
    st.tuples(*[st.floats(-1e6, 1e6)] * 3),
    st.sampled_from([1.0, FEET, 1e3, 1e-3, 1e-9, 1e9]) | st.floats(1e-3, 1e3),
    st.integers(0, 2**32 - 1),
)


def motion_of(parts, n, surface=None):
    """Where vertical residuals are adjusted only turns about the vertical change nothing."""
    angles, shift, scale, seed = parts
    if surface == "vertical":
        angles = (0.0, 0.0, angles[2])
    order = np.random.default_rng(seed).permutation(n)
    turn = Rotation.from_euler("xyz", angles).as_matrix()
    return Motion(turn, np.array(shift), scale, order)


def tolerance_of(motion, X):
    return CONDITION * EPS * np.abs(motion.of(X)).max() / (motion.scale * NOISE)


def check(name, size, motion):
    X = cloud_for(name, size)
    moved = motion.of(X)
    found = results(fitted(ESTIMATORS[name], moved, motion.scale), moved)
    assert_same(found, expected_results(name, size), motion, tolerance_of(motion, X))


@pytest.mark.parametrize("name", ESTIMATORS)
@settings(max_examples=2)
@given(parts=motions)
@example(parts=((0.0, 0.0, 0.0), UTM, 1.0, 0))
@example(parts=((0.0, 0.0, 0.0), GEOCENTRIC, 1.0, 1))
def test_results_follow_the_cloud(name, parts):
    surface = getattr(ESTIMATORS[name], "surface", None)
    check(name, "small", motion_of(parts, CLOUDS["small"], surface))


@pytest.mark.slow
@pytest.mark.parametrize("size", CLOUDS)
@pytest.mark.parametrize("name", ESTIMATORS)
@settings(max_examples=15)  # a nightly job draws others
@given(parts=motions)
def test_results_follow_the_cloud_wherever_it_goes(name, size, parts):
    surface = getattr(ESTIMATORS[name], "surface", None)
    check(name, size, motion_of(parts, CLOUDS[size], surface))


@pytest.mark.parametrize("name", ESTIMATORS)
def test_results_of_compiled_code_follow_the_cloud(name):
    surface = getattr(ESTIMATORS[name], "surface", None)
    parts = ((0.3, 1.1, -2.0), GEOCENTRIC, FEET, 2)
    check(name, "compiled", motion_of(parts, CLOUDS["compiled"], surface))


@pytest.mark.parametrize("name", ESTIMATORS)
def test_labels_follow_the_order_of_rows_exactly(name):
    X = cloud_for(name)
    motion = row_order(len(X), np.random.default_rng(5).permutation(len(X)))
    found = results(fitted(ESTIMATORS[name], X[motion.order]), X[motion.order])
    for label in ("labels_", "predicted", "on_surface_", "inlier_mask_"):
        if label in found:
            expected = motion.expected(label, expected_results(name, "small")[label])
            np.testing.assert_array_equal(found[label], expected)


@pytest.mark.parametrize("name", [n for n, e in ESTIMATORS.items() if not hasattr(e, "sigma0")])
def test_copies_have_the_results_of_the_point(name):
    """Not in tests of one plane, where each observation counts, as with one plane for all."""
    if "n_neighbors=None" in name:
        pytest.skip("one plane of all points")
    X = cloud_for(name)
    rows = np.concatenate([np.arange(len(X)), np.arange(0, len(X), 3)])
    found = results(fitted(ESTIMATORS[name], X[rows]), X[rows])
    for attribute, value in found.items():
        if value.ndim and len(value) == len(rows) and attribute not in ROW_NUMBERS:
            np.testing.assert_array_equal(value, value[rows], err_msg=attribute)


# ---- Functions -------------------------------------------------------------------------------


def planes(motion):
    rng = np.random.default_rng(6)
    X = rng.uniform(-1, 1, (150, 3)) * [1, 1, 0] + rng.normal(0, NOISE, (150, 3))
    tilted = X + [0, 0, 5 * NOISE] + X[:, :1] * [0, 0, 0.01]
    clouds = motion.of(X), motion.of(tilted)
    sigma0 = motion.scale * NOISE
    return [(BaardaPlaneDetector(sigma0=sigma0, surface="orthogonal").fit(Y), Y) for Y in clouds]


@settings(max_examples=4)
@given(parts=motions)
def test_comparisons_and_flatness_follow_the_planes(parts):
    motion = motion_of(parts, 150)
    (a, X), (b, _) = planes(motion)
    (c, Y), (d, _) = planes(row_order(150, np.arange(150)))
    found, expected = compare_planes(a, b), compare_planes(c, d)
    rtol = 100 * tolerance_of(motion, Y)
    assert found.verdict == expected.verdict == "tilted and moved"
    for one, other, unit in zip(found[1:3], expected[1:3], (1, motion.scale), strict=True):
        np.testing.assert_allclose(np.abs(one[:3]), unit * np.abs(other[:3]), rtol=rtol)
    place = motion.expected("region_centroids_", expected.place)
    np.testing.assert_allclose(found.place, place, atol=motion.scale * 1e-6)
    ours, theirs = flatness(a, X, 6 * motion.scale * NOISE), flatness(c, Y, 6 * NOISE)
    assert ours.verdict == theirs.verdict
    assert (ours.n_outside, ours.n_significant) == (theirs.n_outside, theirs.n_significant)
    lengths = [[one.zone, one.minimum_zone, one.uncertainty] for one in (ours, theirs)]
    np.testing.assert_allclose(lengths[0], motion.scale * np.array(lengths[1]), rtol=rtol)


@settings(max_examples=3)
@given(parts=motions)
@pytest.mark.parametrize("method", ["pca", "ransac", "msac", "robpca"])
def test_neighborhoods_follow_their_points(method, parts):
    rng = np.random.default_rng(7)
    points = rng.normal(size=(5, 30, 3)) * [1, 1, NOISE]
    motion = motion_of(parts, 30)
    moved = motion.scale * (points @ motion.rotation.T + motion.shift)
    fit, after = (COMPARATORS[method]().fit(p, random_state=0) for p in (points, moved))
    tolerance = tolerance_of(motion, points.reshape(-1, 3)[:30])
    np.testing.assert_allclose(after.scores, fit.scores, rtol=tolerance, atol=10 * tolerance)
    tilt = bias_angle(after.normals, fit.normals @ motion.rotation.T)
    assert tilt.max() < 1e-6 + np.degrees(tolerance)
