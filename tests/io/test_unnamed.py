"""Tables without names: numbers, rows and times of points are not taken for x."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.io import PointFileError, read_points

R = np.random.default_rng(0)
N = 200
FLOOR = np.c_[R.random((N, 2)) * 4, 0.003 * R.normal(size=N)]
PLACE = np.array([412_000, 5_280_000, 430])
UTM = FLOOR + PLACE
ROW, COLUMN = np.divmod(np.arange(N), 20)
NUMBERS = np.arange(1001, 1001 + N)
GAPS = np.cumsum(R.choice([1, 1, 1, 2, 7], N))
RETURNS = np.sort(R.integers(0, 300, N)) * 1e-5  # several of one pulse
JITTER = np.cumsum(R.normal(0.01, 0.0005, N))
DEM = np.c_[412_000 + 10 * COLUMN, 5_280_000 + 10 * ROW, R.normal(430, 9, N)]

# What stands first, the points behind it, decimals of each, and where the coordinates are.
FIRST = {
    "numbers": (NUMBERS, UTM, 2),
    "numbers of local points": (NUMBERS, FLOOR, 2),
    "numbers with gaps": (GAPS, FLOOR, 2),
    "numbers in any order": (R.permutation(NUMBERS), FLOOR, 2),
    "numbers that fall": (NUMBERS[::-1], FLOOR, 2),
    "numbers and whole millimeters": (NUMBERS, np.rint(1000 * FLOOR), 2),
    "few numbers": (NUMBERS[:6], FLOOR[:6], 2),
    "numbers twice": (np.tile(NUMBERS[: N // 2], 2), UTM, 2),
    "a class": (np.full(N, 2), UTM, 2),
    "Unix time": (1.69e9 + 0.01 * np.arange(N), FLOOR, 2),
    "GPS time": (3.9e8 + RETURNS, FLOOR, 2),
    "seconds of the week of returns": (42504 + RETURNS, UTM, 2),
    "seconds from the start": (0.1 * np.arange(N), FLOOR, 2),
    "seconds with jitter": (JITTER, FLOOR, 2),
    "nanoseconds": (1_690_000_000_000_000_000 + 10_000_000 * np.arange(N), FLOOR, 2),
    "rows and columns of a scanner": (np.c_[ROW, COLUMN], FLOOR - [2, 2, 1], 3),
    "a setup and numbers": (np.c_[np.full(N, 7), NUMBERS], FLOOR, 3),
}
FORMS = [(".txt", "%.3f", " "), (".csv", "%.6f", ","), (".asc", "%.3f", ";")]


def write(path, columns, decimals="%.3f", separator=" ", tail=""):
    whole = (columns == np.rint(columns)).all(axis=0)
    forms = ["%d" if one else decimals for one in whole]
    np.savetxt(path, columns, fmt=separator.join(forms) + tail)
    return path


@pytest.mark.parametrize("tail", ["", " 50", " TREE", " 0.5 128 7 9"])
@pytest.mark.parametrize("kind", FIRST)
def test_numbers_rows_and_times_of_points_are_no_x(tmp_path, kind, tail):
    first, points, at = FIRST[kind]
    path = write(tmp_path / "a.txt", np.c_[first, points], "%.6f", tail=tail)
    remedy = rf"a.txt: line 1: column 1 .* columns={{'x': {at}, 'y': {at + 1}, 'z': {at + 2}}}"
    with pytest.raises(PointFileError, match=remedy):
        read_points(path)


SPACING = 0.01 * np.arange(N)
SORTED = np.unique(np.round(R.random((N, 3)) * [4, 4, 0.1], 3), axis=0)
VOXELS = np.unique(R.integers(0, 40, (N, 3)), axis=0)
NORMALS = R.normal(size=(N, 3)) / 9
NORMALS[:, 2] = np.sqrt(1 - (NORMALS[:, :2] ** 2).sum(axis=1))
RGB = R.integers(0, 256, (N, 3))
READ = {
    "points": FLOOR,
    "national points": UTM,
    "points sorted along x": SORTED,
    "voxels": VOXELS,
    "a raster of heights": DEM,
    "a small raster of heights": np.c_[COLUMN, ROW, DEM[:, 2]],
    "one row of a raster": np.c_[412_000 + np.arange(N), np.full(N, 5_280_000.5), DEM[:, 2]],
    "a profile": np.c_[SPACING, 2 * SPACING, DEM[:, 2]],
    "a wall of one x": np.c_[np.full(N, 2), FLOOR[:, :2]],
    "millimeters": np.rint(1000 * FLOOR),
    "records of LAS": np.rint(1000 * (UTM - [411_990, 5_279_000, 0])),
    "geocentric": np.array([4_120_000, 615_000, 4_806_000]) + SORTED,
    "four points": np.c_[np.arange(4), FLOOR[:4, :2]],
}
BEHIND = {
    "nothing": np.empty((N, 0)),
    "intensity": RGB[:, :1],
    "intensity and colors": np.c_[R.integers(0, 65536, N), RGB],
    "normals": NORMALS,
    "normals and curvature": np.c_[NORMALS, R.random(N)],
    "time": np.c_[RGB[:, 0], 3.9e8 + RETURNS],
    "numbers": np.c_[NUMBERS],
}


@pytest.mark.parametrize("kind", READ)
def test_coordinates_are_taken_for_coordinates(tmp_path, kind):
    points = READ[kind]
    for i, behind in enumerate(BEHIND.values()):
        extension, *form = FORMS[i % len(FORMS)]
        path = write(tmp_path / f"a{extension}", np.c_[points, behind[: len(points)]], *form)
        assert_array_equal(read_points(path).xyz, np.round(points, int(form[0][2])))


@pytest.mark.parametrize("names", ["a b c d", "x y z d"])
@pytest.mark.parametrize("comment", ["", "# "])
def test_who_says_which_columns_are_coordinates_is_believed(tmp_path, names, comment):
    path = tmp_path / "a.txt"
    columns = None if "x" in names else {"x": 1, "y": 2, "z": 3}
    np.savetxt(path, np.c_[NUMBERS, FLOOR], header=names, comments=comment)
    assert_array_equal(read_points(path, columns=columns).xyz, np.c_[NUMBERS, FLOOR][:, :3])


def test_a_text_with_a_row_of_each_coordinate_is_refused(tmp_path):
    np.savetxt(tmp_path / "a.txt", R.random((3, 14)))
    with pytest.raises(PointFileError, match="holds 3 points of 14 columns: transpose it"):
        read_points(tmp_path / "a.txt")


def test_a_plain_array_of_numbers_and_points_is_refused_too(tmp_path):
    np.save(tmp_path / "a.npy", np.c_[NUMBERS, UTM])
    with pytest.raises(PointFileError, match=r"row 0: column 1 .* columns={'x': 2, 'y': 3, 'z'"):
        read_points(tmp_path / "a.npy")


@pytest.mark.parametrize(
    ("row", "remedy"),
    [
        ("P17,412000.1,5280000.2,430.1", "'x': 2, 'y': 3, 'z': 4"),
        ("2026-05-01 12:00:01.5 1 2 3", "'x': 3, 'y': 4, 'z': 5"),
        ("P17;412000,1;5280000,2;430,1", "'x': 2, 'y': 3, 'z': 4"),
    ],
)
def test_words_before_the_coordinates_are_no_numbers(tmp_path, row, remedy):
    (tmp_path / "a.txt").write_text(f"{row}\n{row}\n")
    with pytest.raises(PointFileError, match=rf"line 1: '.*' is not a number: .*{{{remedy}}}"):
        read_points(tmp_path / "a.txt")
