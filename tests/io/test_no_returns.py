"""Rows of zeros are named wherever files are read, and left out where they are many."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from e57_files import write_scans
from sklearn_mcmd.io import read_points, write_points
from sklearn_mcmd.io._formats import supported_extensions
from sklearn_mcmd.io._las_parts import read_parts
from sklearn_mcmd.tiling import Catalog

for library in ("laspy", "lazrs", "plyfile", "pypcd4", "pye57"):
    pytest.importorskip(library)

CORNER = np.array([500_000, 200_000, 100])
SURVEY = CORNER + np.round(np.random.default_rng(0).uniform(0, 20, (30, 3)), 2)
HOLED = np.insert(SURVEY, [7, 7, 20], 0, axis=0)
OWN_FRAME = np.random.default_rng(1).normal(size=(300, 3))
SPINNING = np.insert(OWN_FRAME, np.repeat([0, 40, 200], 30), 0, axis=0)


@pytest.mark.parametrize("extension", supported_extensions(written=True))
def test_zeros_of_every_format_are_named_and_many_in_the_scanners_frame_left_out(
    tmp_path, extension
):
    path = tmp_path / f"a{extension}"
    write_points(path, HOLED)
    with pytest.warns(UserWarning, match="3 of 33 points are 0, 0, 0 .* is point 8: ") as shown:
        assert len(read_points(path)) == 33
    assert shown[0].filename == __file__
    write_points(path, np.round(SPINNING, 3))
    with pytest.warns(UserWarning, match="90 of 390 points are 0, 0, 0, the first is point 1: no"):
        cloud = read_points(path)
    assert_allclose(cloud.xyz, np.round(OWN_FRAME, 3), rtol=0, atol=1e-12)
    assert cloud.n_dropped == cloud.metadata["n_no_returns"] == 90


def test_zeros_of_e57_are_left_out_wherever_the_pose_moves_them(tmp_path):
    pose = {"translation": np.array([5e5, 5.4e6, 100]), "rotation": np.array([0.6, 0, 0, 0.8])}
    write_scans(tmp_path / "a.e57", (SPINNING, {}, pose))
    with pytest.warns(UserWarning, match=r"a.e57, scan 1: 90 of 390 points are 0, 0, 0"):
        cloud = read_points(tmp_path / "a.e57")
    assert (len(cloud), cloud.n_dropped, cloud.metadata["n_no_returns"]) == (300, 90, 90)


@pytest.mark.parametrize(
    "xyz",
    [
        np.r_[SURVEY - CORNER, [[0, 0, 0]]],  # an origin among smaller coordinates
        np.vstack([OWN_FRAME, np.zeros((8, 3))]),  # a target at the origin
        np.round(np.vstack([OWN_FRAME * [1, 1, 0.01], np.zeros((20, 3))])),  # coarse steps
        np.vstack([OWN_FRAME * [1, 0, 0], np.zeros((200, 3))]),  # along an axis
    ],
    ids=["origin", "few", "rounded", "axis"],
)
def test_zeros_that_may_be_points_are_kept(tmp_path, xyz):
    np.save(tmp_path / "a.npy", xyz)
    assert len(read_points(tmp_path / "a.npy")) == len(xyz)


TURN = np.linspace(0.1, 6.2, 50)
RINGS = [np.c_[np.cos(TURN), np.sin(TURN), np.full(50, np.tan(e))] for e in np.arange(-8, 9) / 60]
FLOOR = np.c_[np.random.default_rng(2).integers(1, 5_000, (3_000, 2)), np.zeros(3_000)]


@pytest.mark.parametrize(
    ("points", "n_zeros"),
    [
        (OWN_FRAME * [1, 1, 0], 200),  # a lidar of one plane, or a plan
        (np.vstack(RINGS), 30),  # the middle one is level
        (np.vstack([OWN_FRAME * 1_000, FLOOR]), 100),  # a floor at height 0
    ],
    ids=["plan", "rings", "floor"],
)
def test_zeros_are_no_returns_where_more_points_have_one_coordinate_0(tmp_path, points, n_zeros):
    np.save(tmp_path / "a.npy", np.vstack([points, np.zeros((n_zeros, 3))]))
    with pytest.warns(UserWarning, match=f"a.npy: {n_zeros} of .* no returns.*they are left out$"):
        assert_array_equal(read_points(tmp_path / "a.npy").xyz, points)


def test_only_zeros_that_are_left_out_are_counted(tmp_path):
    """Points nearer to the origin than a micrometer are none of them."""
    points = np.vstack([OWN_FRAME, np.full((3, 3), 1e-7)])
    np.save(tmp_path / "a.npy", np.vstack([points, np.zeros((20, 3))]))
    with pytest.warns(UserWarning, match=f"20 of .* point {len(points) + 1}: .* left out$"):
        assert_array_equal(read_points(tmp_path / "a.npy").xyz, points)


PARTED = [(SPINNING, 300), (-np.abs(SPINNING), 300), (HOLED, 33)]


@pytest.mark.parametrize(("xyz", "n_left"), PARTED)
@pytest.mark.parametrize("n_part", [7, 20, 1000])
@pytest.mark.filterwarnings("ignore:.*points are 0, 0, 0")
def test_parts_of_las_leave_out_what_the_whole_file_does(
    tmp_path, monkeypatch, xyz, n_left, n_part
):
    monkeypatch.setattr("sklearn_mcmd.io._las_parts.POINTS_A_TIME", n_part)
    write_points(tmp_path / f"{n_part}.las", np.round(xyz, 3))
    whole = read_points(tmp_path / f"{n_part}.las").xyz
    parts = [part.xyz for part in read_parts(tmp_path / f"{n_part}.las", 20)]
    assert_array_equal(np.vstack(parts), whole)
    assert Catalog(tmp_path / f"{n_part}.las").counts == [len(whole)] == [n_left]
