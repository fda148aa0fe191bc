"""E57: poses, colors, and what is dropped."""

import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd.io import PointCloud, PointFileError, read_points, write_points

pye57 = pytest.importorskip("pye57")


def test_e57_scans_are_merged_with_their_poses(tmp_path):
    zeros, ones = np.zeros(2), np.ones(2)
    points = {"cartesianX": ones, "cartesianY": zeros, "cartesianZ": np.array([0.0, 3.0])}
    with pye57.E57(str(tmp_path / "a.e57"), mode="w") as file:
        file.write_scan_raw(points, translation=np.array([10.0, 0, 0]))
        half = np.sqrt(0.5)  # a quarter turn about z takes the x axis to the y axis
        file.write_scan_raw(points, rotation=np.array([half, 0, 0, half]))
    cloud = read_points(tmp_path / "a.e57")
    assert_allclose(cloud.xyz, [[11, 0, 0], [11, 0, 3], [0, 1, 0], [0, 1, 3]], atol=1e-12)
    assert_array_equal(cloud.attributes["scan_index"], [0, 0, 1, 1])


def test_points_that_e57_marks_invalid_are_dropped_and_counted(tmp_path):
    points = {f"cartesian{axis}": np.array([0.0, 1, 2]) for axis in "XYZ"}
    points["cartesianInvalidState"] = np.array([0, 2, 0], dtype=np.int8)
    with pye57.E57(str(tmp_path / "a.e57"), mode="w") as file:
        file.write_scan_raw(points)
    cloud = read_points(tmp_path / "a.e57")
    assert_array_equal(cloud.xyz[:, 0], [0, 2])
    assert cloud.n_dropped == 1


def test_e57_keeps_intensity_and_colors_and_says_what_it_loses(tmp_path, cloud):
    value = np.arange(40)
    colors = {c: (value * 256).astype(np.uint16) for c in ("red", "green", "blue")}
    full = PointCloud(cloud.xyz, {"intensity": value, **colors, "score": value})
    with pytest.warns(UserWarning, match="not written: score"):
        write_points(tmp_path / "a.e57", full)
    back = read_points(tmp_path / "a.e57")
    assert sorted(back.attributes) == ["blue", "green", "intensity", "red"]
    assert_array_equal(back.attributes["red"], value)
    assert_array_equal(back.attributes["intensity"], value)
    assert_allclose(back.xyz, cloud.xyz, rtol=1e-15)


EXACT, COLORS = np.arange(40), ("red", "green", "blue")
MISSING = np.where(EXACT == 3, np.nan, EXACT)


@pytest.mark.parametrize(
    ("attributes", "told"),
    [
        (dict.fromkeys(COLORS, np.uint16(EXACT * 257)), None),
        (dict.fromkeys(COLORS, np.uint16(EXACT)), None),
        (dict.fromkeys(COLORS, np.uint16(EXACT * 186)), "; rounded: red, green, blue"),
        (dict.fromkeys(COLORS, EXACT / 40), "; not written: red, green, blue"),
        ({"intensity": EXACT / 4}, None),
        ({"intensity": EXACT / 3}, "; rounded: intensity"),
        ({"intensity": np.uint32(EXACT + 2**24)}, "; rounded: intensity"),
        ({"intensity": MISSING}, "; not written: intensity"),
        ({"intensity": np.float32(MISSING)}, "; not written: intensity"),
        ({"intensity": EXACT * 1e300}, "; not written: intensity"),
        ({"intensity": EXACT / 3, "n": EXACT}, "; not written: n; rounded: intensity"),
    ],
)
def test_e57_names_what_it_cannot_hold(tmp_path, cloud, attributes, told):
    with warnings.catch_warnings(record=True, action="always") as shown:
        write_points(tmp_path / "a.e57", PointCloud(cloud.xyz, attributes))
    limits = "E57 holds coordinates, finite intensity of single precision and colors of 8 bits only"
    assert [str(one.message) for one in shown] == ([limits + told] if told else [])
    back = read_points(tmp_path / "a.e57").attributes
    lost = (told or "").partition("not written: ")[2].partition(";")[0]
    assert set(back) == set(attributes) - set(lost.split(", "))
    if "intensity" in back:
        assert_array_equal(back["intensity"], np.float32(attributes["intensity"]))


def test_e57_refuses_to_lose_the_outlier_mark(tmp_path, cloud):
    with pytest.raises(PointFileError, match="no place to mark outliers"):
        write_points(tmp_path / "a.e57", cloud.xyz, noise=np.ones(40, dtype=bool))
