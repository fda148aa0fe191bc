"""What all scanned scenes promise: shapes, shares, truth of points, normals and noise."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree
from scipy.stats import kstest

from reference import pca_normal
from scenes import SCANNED, scanned
from sklearn_mcmd import datasets
from sklearn_mcmd.datasets._surfaces import Soft
from sklearn_mcmd.datasets._things import Wire
from sklearn_mcmd.metrics import bias_angle

each = pytest.mark.parametrize("name", SCANNED)


@each
def test_every_array_has_a_row_per_point_and_the_documented_type(name):
    scan, _ = scanned(name)
    types = {
        "data": "f8",
        "target": "i8",
        "true_points": "f8",
        "normals": "f8",
        "surface": "i8",
        "classification": "i8",
        "echo": "i1",
        "stretch": "i8",
        "sensor_origins": "f8",
        "noise_scale": "f8",
        "outlier_kind": "i1",
    }
    for array, kind in types.items():
        wide = array in ("data", "true_points", "normals", "sensor_origins")
        assert scan[array].dtype == np.dtype(kind), array
        assert scan[array].shape == ((20_000, 3) if wide else (20_000,)), array
    assert np.isfinite(scan.data).all()


@pytest.mark.parametrize(("name", "n_samples"), [*zip(SCANNED, [40, 6001, 6001, 40], strict=True)])
def test_the_shares_of_outliers_are_those_that_were_asked(name, n_samples):
    make = getattr(datasets, name)
    kinds = ["range_error", "high"]
    scan = make(n_samples, outlier_share=0.1, far_share=0.1, outlier_kinds=kinds, random_state=0)
    counts = dict(
        zip(scan.outlier_kind_names, np.bincount(scan.outlier_kind, minlength=9), strict=True)
    )
    n_each = round(0.1 * n_samples)
    assert counts["range_error"] + counts["high"] == n_each
    assert counts["far_single"] + counts["far_clump"] == n_each
    assert counts["regular"] == n_samples - 2 * n_each == (scan.target == 1).sum()
    assert abs(counts["range_error"] - counts["high"]) <= 1
    assert_array_equal(scan.outlier_kind > 0, scan.target == -1)


@each
def test_outliers_rows_say_that_they_have_no_truth(name):
    scan, _ = scanned(name)
    outlier = scan.target == -1
    for array, nothing in (("surface", -1), ("classification", -1), ("stretch", -1), ("echo", 0)):
        assert_array_equal(scan[array] == nothing, outlier, err_msg=array)
    assert np.isnan(scan.true_points[outlier]).all()
    assert np.isnan(scan.normals[outlier]).all()


@each
def test_a_seed_repeats_true_points_whatever_the_noise(name):
    """That data are repeated as well, `test_seeds.py` says."""
    usual, _ = scanned(name)
    loud = getattr(datasets, name)(20_000, noise=0.03, random_state=0)
    for array in ("true_points", "normals", "outlier_kind"):
        assert_array_equal(usual[array], loud[array])
    origins = (scan.sensor_origins[scan.target == 1] for scan in (usual, loud))
    assert_array_equal(*origins)


@each
def test_true_points_lie_on_their_part_and_in_their_class(name):
    scan, world = scanned(name)
    assert scan.surface_names == [part.name for part in world.parts]
    for number in np.unique(scan.surface[scan.surface >= 0]):
        mine = scan.surface == number
        assert_allclose(world.parts[number].distance(scan.true_points[mine]), 0, atol=1e-6)
        assert (scan.classification[mine] == world.class_of[number]).all()


@each
def test_every_class_has_points(name):
    scan, _ = scanned(name)
    assert np.bincount(scan.classification[scan.target == 1]).min() > 10
    assert scan.classification.max() + 1 == len(scan.class_names)


@each
def test_no_surface_hides_a_point_from_the_sensor(name):
    scan, world = scanned(name)
    regular = scan.target == 1
    sensor_origins, points = scan.sensor_origins[regular], scan.true_points[regular]
    for part in world.parts:
        if not isinstance(part, (Soft, Wire)):  # beams go past these
            before = part.hit(
                sensor_origins, sensor_origins + (1 - 1e-7) * (points - sensor_origins)
            )
            assert np.isinf(before).all(), part.name


@each
def test_normals_are_unit_vectors_toward_the_sensor_where_there_is_a_surface(name):
    scan, world = scanned(name)
    regular = scan.target == 1
    soft = np.array([isinstance(part, (Soft, Wire)) for part in world.parts])
    has = regular & ~soft[scan.surface]
    assert_array_equal(np.isfinite(scan.normals).all(axis=1), has)
    assert_allclose(np.linalg.norm(scan.normals[has], axis=1), 1, rtol=1e-12)
    toward = (scan.sensor_origins - scan.true_points)[has]
    assert (np.einsum("ij,ij->i", scan.normals[has], toward) >= 0).all()


@each
def test_normals_agree_with_planes_fitted_to_true_points_of_one_surface(name):
    made_anyway = {"make_mobile_scan": 60_000, "make_airborne_scan": 60_000}
    scan, _ = scanned(name, made_anyway.get(name, 20_000))
    on_surface = np.isfinite(scan.normals).all(axis=1)
    points, surface = scan.true_points[on_surface], scan.surface[on_surface]
    chosen = np.random.default_rng(0).choice(len(points), 2000, replace=False)
    near = cKDTree(points).query(points[chosen], k=15)[1]
    own = near[(surface[near] == surface[chosen][:, None]).all(axis=1)]
    fitted = np.array([pca_normal(points[row]) for row in own])
    # Where neighbors lie along one line, no plane says what the normal is.
    spread = np.array([np.linalg.svd(points[row] - points[row].mean(axis=0))[1] for row in own])
    flat = spread[:, 1] > 0.1 * spread[:, 0]
    angles = bias_angle(fitted[flat], scan.normals[on_surface][own[flat, 0]])
    assert flat.sum() > 200
    assert np.median(angles) < 0.01
    assert np.quantile(angles, 0.9) < 15  # posts curve within a neighborhood


@pytest.mark.parametrize("name", ["make_mobile_scan", "make_lidar_turn"])
def test_noise_is_gaussian_along_the_ray_and_grows_with_the_range(name):
    scan, _ = scanned(name)
    regular = scan.target == 1
    ray = (scan.true_points - scan.sensor_origins)[regular]
    ranges = np.linalg.norm(ray, axis=1)
    error = (scan.data - scan.true_points)[regular] / scan.noise_scale[regular, None]
    along = np.einsum("ij,ij->i", error, ray) / ranges
    assert kstest(along, "norm").pvalue > 1e-3
    assert_allclose(error - along[:, None] * ray / ranges[:, None], 0, atol=1e-9)
    near, growth, reach = (0.005, 3, 60) if "mobile" in name else (0.01, 4, 100)
    expected = near * (1 + (growth - 1) * ranges / reach)
    assert_allclose(scan.noise_scale[regular], expected, rtol=1e-12)


@pytest.mark.parametrize("name", ["make_mobile_scan", "make_airborne_scan", "make_lidar_turn"])
def test_later_echoes_lie_behind_earlier_ones_on_one_ray(name):
    scan, world = scanned(name)
    regular = scan.target == 1
    ray = (scan.true_points - scan.sensor_origins)[regular]
    ranges = np.linalg.norm(ray, axis=1)
    beam = np.column_stack([scan.sensor_origins[regular], ray / ranges[:, None]])
    _, beam = np.unique(np.round(beam, 9), axis=0, return_inverse=True)
    order = np.lexsort([ranges, beam.ravel()])
    same = np.diff(beam.ravel()[order]) == 0
    echo = scan.echo[regular][order]
    assert same.sum() > 20
    assert (np.diff(echo)[same] > 0).all()
    # A beam goes on only behind what lets it through.
    front = world.through[scan.surface[regular][order][:-1][same]]
    assert front.all()


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"outlier_kinds": ["gaussian"]}, "outlier_kinds="),
        ({"outlier_kinds": ["ghost", "ghost"]}, "once each"),
        ({"outlier_kinds": []}, "one or more"),
        ({"outlier_share": 0.7, "far_share": 0.3}, "leave no regular point"),
        ({"n_samples": 0}, "'n_samples' parameter"),
        ({"outlier_share": 1.0}, "'outlier_share' parameter"),
        ({"far_share": -0.1}, "'far_share' parameter"),
        ({"noise": -1.0}, "'noise' parameter"),
    ],
)
@each
def test_bad_parameters_are_named(name, parameters, message):
    with pytest.raises(ValueError, match=message):
        getattr(datasets, name)(**{"n_samples": 300, **parameters})


@each
def test_one_point_is_a_scan_and_seeds_differ(name):
    scan, other = (
        getattr(datasets, name)(1, outlier_share=0, far_share=0, random_state=seed)
        for seed in (0, 1)
    )
    assert scan.data.shape == (1, 3)
    assert scan.target[0] == 1
    assert not np.isclose(scan.data, other.data).any()


def test_mixed_pixels_need_points_enough_for_an_edge():
    with pytest.raises(ValueError, match="give more points"):
        datasets.make_mobile_scan(
            4, outlier_share=0.5, far_share=0, outlier_kinds=["mixed_pixel"], random_state=0
        )
