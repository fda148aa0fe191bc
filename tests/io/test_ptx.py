"""PTX: scans with a grid and a pose each, written here by an own writer and moved by SciPy."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from sklearn_mcmd.io import PointFileError, read_points, sensor_origins
from sklearn_mcmd.io._sensor import stated_positions
from sklearn_mcmd.io._units import length_unit

TURN = Rotation.from_euler("zyx", [70, 10, -20], degrees=True)
PLACE = np.array([500_000.25, 5_400_000.5, 100])


def header(shape, turn=TURN, place=PLACE, matrix=None):
    """Columns and rows, the pose, and the matrix that rows are multiplied by, of the same pose."""
    axes = turn.as_matrix().T  # one a row
    if matrix is None:
        matrix = np.c_[np.r_[axes, [place]], [0, 0, 0, 1]]
    rows = [[shape[0]], [shape[1]], *np.r_[[place], axes].tolist(), *np.asarray(matrix).tolist()]
    return "".join(" ".join(map(str, row)) + "\n" for row in rows)


def body(table):
    return "".join(" ".join(f"{value:.10g}" for value in row) + "\n" for row in table)


def scan(n_columns=4, n_rows=3, seed=0, n_values=4):
    table = np.random.default_rng(seed).uniform(1, 9, (n_columns * n_rows, n_values))
    table[:, 3] /= 10
    table[:, 4:] = np.rint(25 * table[:, 4:])
    return np.round(table, 6)


def written(tmp_path, *texts):
    (tmp_path / "a.ptx").write_text("".join(texts))
    return tmp_path / "a.ptx"


def test_points_are_moved_by_the_pose_of_their_scan(tmp_path):
    tables, turns = [scan(seed=0), scan(2, 5, seed=1)], [TURN, Rotation.identity()]
    places = [PLACE, PLACE + 10]
    heads = header((4, 3)), header((2, 5), turns[1], places[1])
    cloud = read_points(written(tmp_path, heads[0], body(tables[0]), heads[1], body(tables[1])))
    expected = [t.apply(a[:, :3]) + p for t, a, p in zip(turns, tables, places, strict=True)]
    assert_allclose(cloud.xyz, np.concatenate(expected), rtol=0, atol=1e-8)
    assert_array_equal(cloud.attributes["scan_index"], np.repeat([0, 1], [12, 10]))
    assert_array_equal(cloud.metadata["sensor_origins"], places)
    assert_array_equal(sensor_origins(cloud), np.repeat(places, [12, 10], axis=0))
    assert stated_positions(cloud).words == "poses of the scans"
    assert length_unit(cloud) == "m"


def test_points_have_rows_and_columns_and_rays_without_a_return_are_left_out(tmp_path):
    table = scan()
    table[[2, 7]] = 0, 0, 0, 0.5
    table[4, :2] = 0  # a point on the axis
    cloud = read_points(written(tmp_path, header((4, 3)), body(table)))
    assert cloud.n_dropped == 2
    kept = np.delete(np.arange(12), [2, 7])
    assert_array_equal(cloud.attributes["column_index"], kept // 3)  # columns come first
    assert_array_equal(cloud.attributes["row_index"], kept % 3)
    assert_allclose(cloud.attributes["intensity"], table[kept, 3])
    assert "scan_index" not in cloud.attributes


def test_a_scan_without_a_return_counts_in_no_number(tmp_path):
    empty = body(np.zeros((12, 4)))
    texts = [header((4, 3), place=PLACE + 7), empty, header((4, 3)), body(scan()), header((0, 0))]
    cloud = read_points(written(tmp_path, *texts))
    assert (len(cloud), cloud.n_dropped) == (12, 12)
    assert_array_equal(cloud.metadata["sensor_origins"], [PLACE])
    assert "scan_index" not in cloud.attributes
    with pytest.raises(PointFileError, match=r"holds no points with finite.* \(12 dropped\)"):
        read_points(written(tmp_path, header((4, 3)), empty))


def test_colors_have_eight_bits_and_scans_without_them_take_them_from_all(tmp_path):
    table = scan(n_values=7)
    cloud = read_points(written(tmp_path, header((4, 3)), body(table)))
    assert cloud.attributes["green"].dtype == np.uint8
    assert_array_equal(cloud.attributes["green"], table[:, 5])
    table[0, 4] = 300
    cloud = read_points(written(tmp_path, header((4, 3)), body(table)))
    assert_array_equal(cloud.attributes["red"], table[:, 4])
    with pytest.warns(UserWarning, match="not all scans have are left out: blue, green, red"):
        read_points(written(tmp_path, header((4, 3)), body(table), header((4, 3)), body(scan())))


@pytest.mark.parametrize(
    ("shape", "options", "is_known"),
    [
        ((4, 3), {}, True),
        ((4, 3), {"place": np.zeros(3), "turn": Rotation.identity()}, True),
        ((4, 3), {"turn": Rotation.identity(), "matrix": np.eye(4)}, False),
        ((12, 1), {}, False),
    ],
    ids=["pose", "the scanner's own coordinates", "moved before", "no grid"],
)
def test_where_the_scanner_stood_is_known_where_nothing_speaks_against_it(
    tmp_path, shape, options, is_known
):
    """A merged cloud is written as one row, and moved points beside a matrix that moves nothing."""
    cloud = read_points(written(tmp_path, header(shape, **options), body(scan())))
    assert (stated_positions(cloud).positions is not None) == is_known
    if is_known:
        assert_array_equal(sensor_origins(cloud)[0], options.get("place", PLACE))


def test_blank_lines_other_ends_and_an_open_end_do_no_harm(tmp_path):
    text = header((4, 3)) + body(scan()) + "\n \n" + header((4, 3)) + body(scan())
    cloud = read_points(written(tmp_path, text))
    for other in (text.replace("\n", "\r\n"), text.rstrip("\n"), "\ufeff" + text):
        (tmp_path / "b.ptx").write_bytes(other.encode())
        assert_array_equal(read_points(tmp_path / "b.ptx").xyz, cloud.xyz)


SCALED = np.diag([0.3048, 0.3048, 0.3048, 1])
MIRROR, SHIFTED = np.diag([1, 1, -1, 1]), np.eye(4)
SHIFTED[0, 3] = 5
LINES = body(scan()).splitlines(keepends=True)
SCAN = [header((4, 3)), *LINES]
BAD = {  # what a file has, and what the error says
    "ends in a header": (
        header((4, 3)).splitlines(keepends=True)[:7],
        "truncated: it ends before the row of four of the",
    ),
    "ends in a scan": (SCAN[:8], "truncated: scan of line 1: 7 of 12 points"),
    "too many points": ([header((4, 2)), *LINES], "line 19: needs the number of columns, has"),
    "no counts": (LINES, "line 1: needs the number of columns, has"),
    "a broken count": ([header((4, "x")), *LINES], "line 2: needs the number of rows, has 'x'"),
    "half a row": ([header((4, 2.5)), *LINES], "line 2: needs the number of rows, has '2.5'"),
    "no number": ([*SCAN[:5], "1 2 b 4\n", *SCAN[6:]], "line 15: '1 2 b 4' is no point; points"),
    "a gap": ([*SCAN[:5], "1 2 3\n", *SCAN[6:]], "line 15: '1 2 3' is no point"),
    "three columns": ([SCAN[0], *["1 2 3\n"] * 12], "line 22: a point of 3 numbers; points have 4"),
    "more than bytes": ([header((10**9, 10**9)), *LINES], "1,000,000,000,000,000,000 points need"),
    "no matrix": (
        [header((4, 3), matrix=np.full((4, 4), np.nan)), *LINES],
        "line 7: needs the row",
    ),
}
MATRICES = {"a scale": SCALED, "a mirror": MIRROR, "zeros": SCALED * 0, "a perspective": SHIFTED}
BAD |= {
    kind: ([header((4, 3), matrix=matrix), *LINES], "line 7: the matrix .* is no rigid motion")
    for kind, matrix in MATRICES.items()
}


@pytest.mark.parametrize("kind", BAD)
def test_what_is_wrong_is_named_with_its_line(tmp_path, kind):
    texts, message = BAD[kind]
    with pytest.raises(PointFileError, match=message) as error:
        read_points(written(tmp_path, *texts))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("factor", "is_rigid"), [(1, True), (1.0002, True), (1.003, False)])
def test_a_rotation_of_three_decimals_is_rigid_and_a_scale_is_none(tmp_path, factor, is_rigid):
    """Rounding changes squares and products of axes by sqrt(3) / 1000 at most."""
    decimals = 3 if factor == 1 else 12
    angles = np.random.default_rng(0).uniform(-3, 3, (50, 3))
    for turn in np.round(factor * Rotation.from_euler("zyx", angles).as_matrix(), decimals):
        matrix = np.eye(4)
        matrix[:3, :3] = turn
        path = written(tmp_path, header((1, 1), matrix=matrix), "1 2 3 0.5\n")
        if is_rigid:
            assert_allclose(read_points(path).xyz, [turn.T @ [1, 2, 3]])
        else:
            with pytest.raises(PointFileError, match="is no rigid motion"):
                read_points(path)
