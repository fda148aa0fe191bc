"""PLY and PCD: encodings, colors, normals and what is dropped."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.io import PointCloud, PointFileError, read_points, write_points

plyfile = pytest.importorskip("plyfile")
pypcd4 = pytest.importorskip("pypcd4")


@pytest.mark.parametrize(("extension", "encoding"), [(".ply", "ascii"), (".ply", "binary")])
@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.uint32, np.float32, np.float64])
def test_ply_keeps_numbers_and_dtypes_in_both_encodings(tmp_path, extension, encoding, dtype):
    check_encoding(tmp_path / f"a{extension}", encoding, dtype)


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.int64, np.float32, np.float64])
def test_pcd_keeps_numbers_and_dtypes_in_all_encodings(tmp_path, encoding, dtype):
    check_encoding(tmp_path / "a.pcd", encoding, dtype)
    assert f"DATA {encoding}\n".encode() in (tmp_path / "a.pcd").read_bytes()


def check_encoding(path, encoding, dtype):
    # Repeated, because what does not shrink is stored uncompressed.
    values = np.tile(np.linspace(0, 100, 30) / 3, 10).astype(dtype)
    source = PointCloud(np.column_stack([values] * 3) / 7).with_attributes(quality=values)
    write_points(path, source, encoding=encoding)
    back = read_points(path)
    assert back.attributes["quality"].dtype == dtype
    assert_array_equal(back.attributes["quality"], values)
    assert_array_equal(back.xyz, source.xyz)


def test_ply_keeps_comments_and_calls_normals_as_viewers_do(tmp_path, cloud):
    cloud.metadata["ply_comments"] = ["scanned in spring"]
    write_points(tmp_path / "a.ply", cloud)
    ply = plyfile.PlyData.read(tmp_path / "a.ply")
    assert ply.comments == ["scanned in spring"]
    assert {"nx", "ny", "nz"} <= set(ply["vertex"].data.dtype.names)
    assert read_points(tmp_path / "a.ply").metadata["ply_comments"] == ["scanned in spring"]


def test_ply_faces_are_dropped(tmp_path):
    text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    text += "property float z\nproperty uchar quality\nelement face 1\n"
    text += "property list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(text + "0 0 0 1\n1 0 0 2\n0 1 0 3\n3 0 1 2\n")
    cloud = read_points(tmp_path / "a.ply")
    assert_array_equal(cloud.attributes["quality"], [1, 2, 3])
    assert_array_equal(cloud.xyz, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])


@pytest.mark.parametrize("extension", [".ply", ".pcd"])
def test_float32_coordinates_stay_float32_in_files_for_viewers(tmp_path, extension):
    xyz = np.random.default_rng(0).random((5, 3)).astype(np.float32)
    write_points(tmp_path / f"a{extension}", xyz)
    head = (tmp_path / f"a{extension}").read_bytes()[:200]
    assert b"property float x" in head or b"SIZE 4 4 4" in head
    assert_array_equal(read_points(tmp_path / f"a{extension}").xyz, xyz)


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
    for encoding in ("binary", "ascii"):
        write_points(tmp_path / "b.pcd", cloud, encoding=encoding)
        back = read_points(tmp_path / "b.pcd")
        assert list(back.attributes) == ["red", "green", "blue"]
        assert_array_equal(back.attributes["green"], [2, 50])


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_truncated_pcd_is_recognized_in_every_encoding(tmp_path, encoding):
    path = tmp_path / "a.pcd"
    write_points(path, np.tile(np.eye(3), (50, 1)), encoding=encoding)
    path.write_bytes(path.read_bytes()[:-12])
    with pytest.raises(PointFileError, match=r"truncated or damaged|promises 150 points"):
        read_points(path)


@pytest.mark.parametrize("extension", [".ply", ".pcd"])
def test_ply_and_pcd_keep_colors_of_sixteen_bits(tmp_path, extension):
    values = np.arange(40) * 186
    colors = dict.fromkeys(("red", "green", "blue"), np.uint16(values))
    write_points(tmp_path / "a.las", PointCloud(np.eye(3)[values % 3], colors))
    write_points(tmp_path / f"b{extension}", read_points(tmp_path / "a.las"))
    assert_array_equal(read_points(tmp_path / f"b{extension}").attributes["red"], values)


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_points_behind_a_long_header_are_read_or_refused_for_it(tmp_path, encoding):
    path = tmp_path / "a.pcd"
    write_points(path, np.eye(3), encoding=encoding)
    path.write_bytes(path.read_bytes().replace(b"DATA", b"SCANNER mine\nDATA"))
    if encoding == "ascii":
        assert_array_equal(read_points(path).xyz, np.eye(3))
    else:
        with pytest.raises(PointFileError, match="header has more than 10 lines"):
            read_points(path)
