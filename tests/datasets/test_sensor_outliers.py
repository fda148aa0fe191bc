"""The kinds of outliers of scanned scenes: where they lie."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.spatial import cKDTree

from scenes import SCANNED, scanned, with_outliers
from sklearn_mcmd.datasets._sensor_outliers import MAKERS


def with_kind(name, kind):
    """A scan with outliers of all kinds, and which are of one; every scene takes every kind."""
    scan, _ = with_outliers(name)
    return scan, scan.outlier_kind == scan.outlier_kind_names.index(kind)


@pytest.mark.parametrize("name", SCANNED)
def test_outliers_of_all_kinds_keep_clear_of_everything(name):
    scan, world = with_outliers(name)
    places = [scan.outlier_kind_names.index(kind) for kind in MAKERS]
    mine = np.isin(scan.outlier_kind, places)
    assert mine.sum() == 2000
    counts = np.bincount(scan.outlier_kind[mine], minlength=len(scan.outlier_kind_names))
    assert (np.abs(counts[places] - 2000 / len(MAKERS)) <= 1).all()
    assert (world.distance(scan.data[mine]) > 3.99 * scan.noise_scale[mine]).all()


def angular_neighbors(scan, mine, k):
    """Ranges of the regular points nearest in direction to some outliers; and of these."""
    ray = scan.data - scan.sensor_origins
    ranges = np.linalg.norm(ray, axis=1)
    direction = ray / np.fmax(ranges, 1e-9)[:, None]  # some have no return
    regular = np.flatnonzero(scan.target == 1)
    near = cKDTree(direction[regular]).query(direction[mine], k=k)[1]
    return ranges[regular[near]], ranges[mine]


@pytest.mark.parametrize("name", ["make_lidar_turn", "make_depth_frame"])
def test_mixed_pixels_lie_between_what_neighboring_beams_meet(name):
    scan, mine = with_kind(name, "mixed_pixel")
    near, ranges = angular_neighbors(scan, mine, 12)
    between = (near.min(axis=1) < ranges) & (ranges < near.max(axis=1))
    # A few edges are seen by beams whose echoes were lost at random.
    assert between.mean() > 0.97


@pytest.mark.parametrize("name", ["make_lidar_turn", "make_depth_frame"])
def test_range_errors_are_5_to_20_spacings_before_or_behind_what_their_beam_meets(name):
    scan, mine = with_kind(name, "range_error")
    regular = scan.data[scan.target == 1]
    spacing = cKDTree(regular).query(regular, k=9)[0][:, 1:].mean(axis=1)
    ray = scan.data - scan.sensor_origins
    ranges = np.linalg.norm(ray, axis=1)
    direction = ray / np.fmax(ranges, 1e-9)[:, None]
    true = scan.target == 1
    angle, near = cKDTree(direction[true]).query(direction[mine])
    own = angle < 1e-6  # depths are rounded along the beam
    off = np.abs(ranges[mine] - ranges[true][near])[own] / spacing[near[own]]
    assert own.mean() > 0.9
    assert 4 < np.quantile(off, 0.05) < np.quantile(off, 0.95) < 21


@pytest.mark.parametrize("kind", ["ghost", "low"])
@pytest.mark.parametrize("name", ["make_mobile_scan", "make_airborne_scan"])
def test_balls_hold_at_least_ten_points(name, kind):
    scan, mine = with_kind(name, kind)
    regular = scan.data[scan.target == 1]
    unit = np.median(cKDTree(regular).query(regular, k=9)[0][:, 1:].mean(axis=1))
    points = scan.data[mine]
    company = cKDTree(points).query_ball_point(points, 6.5 * unit, return_length=True)
    assert company.min() >= 10


def test_low_points_lie_below_the_ground_and_high_ones_above_it():
    scan, low = with_kind("make_airborne_scan", "low")
    assert np.median(scan.data[low, 2]) < -2
    scan, high = with_kind("make_airborne_scan", "high")
    assert 5 < np.quantile(scan.data[high, 2], 0.05) < scan.data[high, 2].max() < 60


def test_half_the_particles_are_within_four_meters_of_a_spinning_lidar():
    scan, mine = with_kind("make_lidar_turn", "particle")
    ranges = np.linalg.norm((scan.data - scan.sensor_origins)[mine], axis=1)
    assert 2.8 < np.median(ranges) < 4
    assert ranges.max() > 8


@pytest.mark.parametrize("name", SCANNED)
def test_far_outliers_are_alone_or_in_clumps_off_everything(name):
    scan, _ = with_outliers(name)
    regular = scan.data[scan.target == 1]
    kinds = np.array(scan.outlier_kind_names)[scan.outlier_kind]
    single, clump = (scan.data[kinds == kind] for kind in ("far_single", "far_clump"))
    assert len(single) == len(clump) == 500
    diagonal = np.linalg.norm(np.ptp(regular, axis=0))
    far = cKDTree(regular).query(np.concatenate([single, clump]))[0]
    assert far.min() > 0.095 * diagonal  # noise moves the regular points somewhat
    unit = np.median(cKDTree(regular).query(regular, k=9)[0][:, 1:].mean(axis=1))
    company = cKDTree(clump).query_ball_point(clump, 21 * unit, return_length=True)
    assert company.min() >= 10
    assert np.median(cKDTree(single).query(single, k=2)[0][:, 1]) > 0.02 * diagonal


def test_far_outliers_leave_the_regular_points_as_they_are():
    one, other = (
        scanned("make_depth_frame", 4_000 + n, far_share=n / (4_000 + n), outlier_share=0.0)[0]
        for n in (0, 20)
    )
    rows = [np.sort(s.data[s.target == 1, 0]) for s in (one, other)]
    assert_array_equal(*rows)
