"""PLY and PCD: encodings, colors, normals and what is dropped."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from benchmarks._fuzz_seeds import ENCODINGS, save_as
from sklearn_mcmd.io import PointCloud, read_points, write_points

plyfile = pytest.importorskip("plyfile")
pypcd4 = pytest.importorskip("pypcd4")


DTYPES = [np.uint8, np.int16, np.uint32, np.float32, np.float64]


@pytest.mark.parametrize("extension", ENCODINGS)
def test_numbers_and_dtypes_come_back_in_all_encodings(tmp_path, extension):
    path = tmp_path / f"a{extension}"
    for dtype in [*DTYPES, *[np.int64] * (extension == ".pcd")]:
        # Repeated, because what does not shrink is stored uncompressed.
        values = np.tile(np.linspace(3, 100, 30) / 3, 10).astype(dtype)
        xyz = np.column_stack([values] * 3) / 7
        write_points(path, PointCloud(xyz, {"quality": values}))
        for encoding in (None, *ENCODINGS[extension][::-1]):  # text, of ten decimals, comes last
            if encoding:
                save_as(path, encoding)
            back, decimals = read_points(path), 1e-9 if encoding == "ascii" else 0
            assert back.attributes["quality"].dtype == dtype
            assert_allclose(back.attributes["quality"], values, rtol=0, atol=decimals)
            assert_allclose(back.xyz, xyz, rtol=0, atol=decimals)
    write_points(path, xyz.astype(np.float32))  # as viewers expect
    head = path.read_bytes()[:200]
    assert b"property float x" in head or b"SIZE 4 4 4" in head
    assert_array_equal(read_points(path).xyz, xyz.astype(np.float32))


def test_ply_keeps_comments_and_calls_normals_as_viewers_do(tmp_path, cloud):
    cloud.metadata["ply_comments"] = ["scanned in spring"]
    write_points(tmp_path / "a.ply", cloud)
    ply = plyfile.PlyData.read(tmp_path / "a.ply")
    assert ply.comments == ["scanned in spring"]
    assert {"nx", "ny", "nz"} <= set(ply["vertex"].data.dtype.names)
    assert read_points(tmp_path / "a.ply").metadata["ply_comments"] == ["scanned in spring"]


@pytest.mark.parametrize("extension", [".ply", ".pcd"])
def test_names_are_spelled_in_ascii_with_a_warning_and_stay_apart(tmp_path, extension):
    names = ["a b", "Höhe", "Hohe", "a_b", "a  b", "a-b.c", "强度", "ÿ"]
    cloud = PointCloud(np.eye(3), {name: np.full(3, i) for i, name in enumerate(names)})
    written = "'a b' as a_b_, 'Höhe' as Hohe_, 'a  b' as a_b__, '强度' as attribute, 'ÿ' as y_"
    with pytest.warns(UserWarning, match=f"ASCII without blanks; written: {written}$"):
        write_points(tmp_path / f"a{extension}", cloud)
    back = read_points(tmp_path / f"a{extension}").attributes
    assert list(back) == ["a_b_", "Hohe_", "Hohe", "a_b", "a_b__", "a-b.c", "attribute", "y_"]
    assert [values[0] for values in back.values()] == [*range(8)]


def test_ply_faces_are_dropped(tmp_path):
    text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    text += "property float z\nproperty uchar quality\nelement face 1\n"
    text += "property list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(text + "0 0 0 1\n1 0 0 2\n0 1 0 3\n3 0 1 2\n")
    cloud = read_points(tmp_path / "a.ply")
    assert_array_equal(cloud.attributes["quality"], [1, 2, 3])
    assert_array_equal(cloud.xyz, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])


def test_pcd_rows_without_coordinates_are_dropped_and_counted(tmp_path):
    text = "VERSION .7\nFIELDS x y z label\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 2\n"
    text += "HEIGHT 2\nVIEWPOINT 1 2 3 1 0 0 0\nPOINTS 4\nDATA ascii\n"
    (tmp_path / "a.pcd").write_text(text + "0 0  0 1\nnan nan nan 2\n1 1 1 3\n1 inf 1 4\n")
    cloud = read_points(tmp_path / "a.pcd")
    assert cloud.n_dropped == 2
    assert_array_equal(cloud.attributes["label"], [1, 3])
    write_points(tmp_path / "b.pcd", cloud)
    assert pypcd4.PointCloud.from_path(tmp_path / "b.pcd").metadata.viewpoint[:3] == (1, 2, 3)


def test_packed_colors_of_pcd_become_red_green_blue_and_are_packed_again(tmp_path):
    rgb = pypcd4.PointCloud.encode_rgb(np.array([[255, 2, 3], [4, 50, 6]], dtype=np.uint8))
    arrays = [np.zeros(2, np.float32)] * 3 + [rgb]
    pypcd4.PointCloud.from_points(arrays, ("x", "y", "z", "rgb"), [np.float32] * 4).save(
        tmp_path / "a.pcd"
    )
    cloud = read_points(tmp_path / "a.pcd")
    assert_array_equal(cloud.attributes["red"], [255, 4])
    assert_array_equal(cloud.attributes["blue"], [3, 6])
    write_points(tmp_path / "b.pcd", cloud)
    assert pypcd4.PointCloud.from_path(tmp_path / "b.pcd").fields[3:] == ("rgb",)
    back = read_points(tmp_path / "b.pcd")
    assert list(back.attributes) == ["red", "green", "blue"]
    assert_array_equal(back.attributes["green"], [2, 50])


ODD = {
    "long": (b"DATA", b"SCANNER mine\nSERIAL 7\nDATA"),
    "CRLF": (b"\n", b"\r\n"),
    "no COUNT": (b"COUNT 1 1 1 1 1\n", b""),
    "v.5": (b"VERSION 0.7", b"# .PCD v.5\n\nVERSION .5"),
    "no VERSION": (b"VERSION 0.7\n", b""),
    "no VIEWPOINT": (b"VIEWPOINT 0.0 0.0 0.0 1.0 0.0 0.0 0.0\n", b""),
    "other case": (b"POINTS 3\nDATA", b"Points 3\ndata"),
    "7 x 9": (b"WIDTH 3\nHEIGHT 1", b"WIDTH 7\nHEIGHT 9"),
}


@pytest.mark.parametrize("encoding", ENCODINGS[".pcd"])
@pytest.mark.parametrize("odd", ODD)
def test_headers_as_programs_and_people_write_them_are_read(tmp_path, encoding, odd):
    path, cloud = tmp_path / "a.pcd", PointCloud(np.eye(3), {"ring": np.arange(3, dtype=np.uint8)})
    write_points(path, cloud.with_attributes(label=np.arange(3)))
    save_as(path, encoding)
    head, data, points = path.read_bytes().partition(f"DATA {encoding}\n".encode())
    changed = (head + data).replace(*ODD[odd])
    assert changed != head + data
    path.write_bytes(changed + points)
    back = read_points(path)
    assert_array_equal(back.xyz, np.eye(3))
    assert_array_equal(back.attributes["ring"], range(3))
    assert "grid_shape" not in back.metadata


HEAD = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA ascii\n"


@pytest.mark.parametrize("rows", ["1,2,3\n4,5,nan\n", "1, 2, 3\n4 ,5 ,nan", "1  2 3 \n 4 5 NaN\n"])
def test_rows_with_commas_or_padding_are_read(tmp_path, rows):
    (tmp_path / "a.pcd").write_text(HEAD + rows)
    cloud = read_points(tmp_path / "a.pcd")
    assert_array_equal(cloud.xyz, [[1, 2, 3]])
    assert cloud.n_dropped == 1


# ---- organized clouds ------------------------------------------------------------------


def organized(tmp_path):
    """A file of 4 rows and 5 columns, of which two cells are empty."""
    xyz = np.random.default_rng(0).random((20, 3)).astype(np.float32)
    xyz[[3, 11]] = np.nan
    arrays = [*xyz.T, np.arange(20, dtype=np.int32)]
    dtypes = [np.float32] * 3 + [np.int32]
    pcd = pypcd4.PointCloud.from_points(arrays, ("x", "y", "z", "label"), dtypes)
    pcd.metadata.height, pcd.metadata.width = 4, 5
    pcd.save(tmp_path / "a.pcd")
    return tmp_path / "a.pcd"


@pytest.mark.parametrize("extension", [".las", ".ply", ".pcd", ".e57"])
def test_all_formats_hold_rows_and_columns(tmp_path, extension):
    cloud = read_points(organized(tmp_path))
    row, column = cloud.attributes["row_index"], cloud.attributes["column_index"]
    assert_array_equal(5 * row + column, cloud.attributes.pop("label"))
    write_points(tmp_path / f"b{extension}", cloud)
    back = read_points(tmp_path / f"b{extension}").attributes
    for name in ("row_index", "column_index"):
        assert_array_equal(back[name], cloud.attributes[name])


def test_a_row_of_points_and_a_file_with_own_rows_are_not_organized(tmp_path):
    write_points(tmp_path / "a.pcd", np.eye(3))
    assert read_points(tmp_path / "a.pcd").attributes == {}
    numbered = PointCloud(np.random.default_rng(0).random((4, 3)), {"row_index": np.arange(4)})
    write_points(tmp_path / "a.pcd", numbered)
    data = (tmp_path / "a.pcd").read_bytes()
    (tmp_path / "a.pcd").write_bytes(data.replace(b"WIDTH 4\nHEIGHT 1", b"WIDTH 2\nHEIGHT 2"))
    cloud = read_points(tmp_path / "a.pcd")
    assert_array_equal(cloud.attributes["row_index"], range(4))
    assert "grid_shape" not in cloud.metadata
