"""LAS is as precise as the coordinates ask for, or the points that are too far are named."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd.io import PointFileError, read_points, write_points

laspy = pytest.importorskip("laspy")


def survey(decimals=3, size=2.0, n=3000):
    xyz = np.random.default_rng(0).uniform(0, size, (n, 3)) + np.array([500_000, 5_400_000, 100])
    return xyz if decimals is None else np.round(xyz, decimals)


@pytest.mark.filterwarnings("ignore:.*no returns")
@pytest.mark.parametrize("decimals", [3, None])
@pytest.mark.parametrize(
    ("far", "named"),
    [
        ([[0, 0, 0]], r"point 3001 at \(0, 0, 0\)"),
        ([[0, 0, 0]] * 200, r"point 3001 at .*point 3003 at \(0, 0, 0\) and 197 more"),
        ([[0, 0, 0]] * 9000, r"point 3001 at .*point 3003 at \(0, 0, 0\) and 8,997 more"),
        ([[1e9, 5_400_000, 100]], r"point 3001 at \(1000000000, 5400000, 100\)"),
        ([[1e300, -1e300, 0]], r"point 3001 at \(1e\+300"),
    ],
)
def test_points_that_would_make_the_others_coarse_are_named(tmp_path, decimals, far, named):
    xyz = np.r_[survey(decimals), far]
    with pytest.raises(PointFileError, match=named) as caught:
        write_points(tmp_path / "a.laz", xyz)
    assert "remove them, or write a format without steps, such as .ply or .csv" in str(caught.value)
    assert not list(tmp_path.iterdir())
    write_points(tmp_path / "a.ply", xyz)
    kept = xyz[:3000] if len(far) > 1 else xyz  # many zeros are rays without a return
    assert_array_equal(read_points(tmp_path / "a.ply").xyz, kept)


# 31 bits hold 2,147 km in millimeters, and 32 bits twice as much.
@pytest.mark.parametrize("far", [3e5, 2e6, 4e6])
def test_far_points_do_not_coarsen_what_has_room(tmp_path, far):
    xyz = np.r_[survey(), [[500_000 + far, 5_400_000, 100]]]
    write_points(tmp_path / "a.las", xyz)
    assert_array_equal(laspy.read(tmp_path / "a.las").header.scales, 0.001)
    assert_allclose(read_points(tmp_path / "a.las").xyz, xyz, rtol=1e-15)


def test_printed_digits_without_room_are_rounded_to_the_finest_step_with_room(tmp_path):
    xyz = survey(decimals=6, size=10_000.0, n=10_000)
    write_points(tmp_path / "a.las", xyz)
    assert np.abs(read_points(tmp_path / "a.las").xyz - xyz).max() <= 0.5e-5 * 1.001


@pytest.mark.parametrize("place", [0.0, 1e7, 1e14])
@pytest.mark.parametrize("extent", [0.0, 1e-6])
def test_no_step_is_finer_than_double_precision_about_the_points(tmp_path, place, extent):
    xyz = place + extent * np.random.default_rng(0).random((9, 3))
    write_points(tmp_path / "a.las", xyz)
    back = read_points(tmp_path / "a.las").xyz
    assert_allclose(back, xyz, rtol=0, atol=1e-8 * extent + 4 * np.spacing(place))
    assert laspy.open(tmp_path / "a.las").header.scales[0] >= np.spacing(place) / 10
