"""Several LAS files become one that holds what each held."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd.io import PointFileError, read_points
from sklearn_mcmd.io._las import writing_parts
from sklearn_mcmd.io._las_joined import joined_cloud, joined_header
from sklearn_mcmd.io._las_parts import read_parts

laspy = pytest.importorskip("laspy")
pytest.importorskip("lazrs")

N = 40


def write(path, point_format=6, scale=0.01, offset=0.0, extra=(), seed=0, **fields):
    """A file with random values in all standard dimensions."""
    rng = np.random.default_rng(seed)
    header = laspy.LasHeader(
        version="1.4" if point_format > 5 else "1.2", point_format=point_format
    )
    header.scales, header.offsets = np.full(3, scale), np.full(3, offset)
    header.add_extra_dims([laspy.ExtraBytesParams(name, dtype) for name, dtype in extra])
    las = laspy.LasData(header)
    las.xyz = np.round(rng.uniform(-50, 50, (N, 3)) / scale) * scale + offset
    for name in las.point_format.dimension_names:
        if name not in ("X", "Y", "Z"):
            most = 2.0 if name == "gps_time" else las.point_format.dimension_by_name(name).max
            las[name] = rng.integers(0, min(int(most), 89), N, endpoint=True)
    for name, values in fields.items():
        las[name] = values
    las.write(path)
    return path


def join(paths, target):
    header = joined_header(paths)
    with writing_parts(target) as write_part:
        for path in paths:
            for cloud in read_parts(path, 15):
                write_part(joined_cloud(cloud, header))
    return read_points(target)


@pytest.mark.parametrize("target", ["all.las", "all.laz"])
def test_files_of_one_form_are_appended_bit_for_bit(tmp_path, target):
    extra = [("beam", "u1"), ("range", "f4")]
    paths = [write(tmp_path / f"{i}.laz", extra=extra, seed=i) for i in range(3)]
    joined = join(paths, tmp_path / target).metadata["las_points"]
    single = [read_points(path).metadata["las_points"] for path in paths]
    assert joined.dtype == single[0].dtype
    assert joined.tobytes() == b"".join(points.tobytes() for points in single)


@pytest.mark.parametrize(
    ("formats", "expected"),
    [
        ((0, 0), 0), ((0, 1), 1), ((1, 2), 3), ((0, 2), 2), ((6, 7), 7), ((7, 8), 8), ((6, 8), 8),
        ((0, 6), 6), ((3, 6), 7), ((2, 8), 8), ((8, 1), 8),
    ],
)  # fmt: skip
def test_the_richest_point_format_holds_all_attributes(tmp_path, formats, expected):
    paths = [write(tmp_path / f"{i}.las", f, seed=i) for i, f in enumerate(formats)]
    joined = join(paths, tmp_path / "all.las")
    assert joined.metadata["las_header"].point_format.id == expected
    first = 0
    for path in paths:
        cloud, rows = read_points(path), slice(first, first + N)
        assert_array_equal(joined.xyz[rows], cloud.xyz)
        for name, values in joined.attributes.items():
            if name in cloud.attributes:
                assert_array_equal(values[rows], cloud.attributes[name])
            elif name == "scan_angle":
                degrees = cloud.attributes["scan_angle_rank"]
                assert_allclose(values[rows] * 0.006, degrees, atol=0.003)
            else:
                assert not values[rows].any()
        lost = cloud.attributes.keys() - joined.attributes.keys()
        assert lost <= {"scan_angle_rank"}
        first += N


def test_scales_are_the_finest_and_coordinates_stay(tmp_path):
    paths = [
        write(tmp_path / "a.las", scale=0.01, offset=1000.0),
        write(tmp_path / "b.las", scale=0.001, offset=1000.0, seed=1),
        write(tmp_path / "c.las", scale=0.01, offset=5.0, seed=2),
    ]
    joined = join(paths, tmp_path / "all.laz")
    assert_array_equal(joined.metadata["las_header"].scales, [0.001] * 3)
    expected = np.vstack([read_points(path).xyz for path in paths])
    assert_allclose(joined.xyz, expected, rtol=0, atol=1e-9)


def test_files_far_apart_get_an_offset_between_them(tmp_path):
    paths = [
        write(tmp_path / "a.las", scale=0.001, offset=0.0),
        write(tmp_path / "b.las", scale=0.001, offset=3e6, seed=1),
    ]
    joined = join(paths, tmp_path / "all.las")
    expected = np.vstack([read_points(path).xyz for path in paths])
    assert_allclose(joined.xyz, expected, rtol=0, atol=1e-6)


def test_attributes_that_a_file_has_not_are_0(tmp_path):
    paths = [
        write(tmp_path / "a.las", extra=[("beam", "u1")]),
        write(tmp_path / "b.las", extra=[("range", "f4")], seed=1),
    ]
    joined = join(paths, tmp_path / "all.las").attributes
    assert_array_equal(joined["beam"][:N], read_points(paths[0]).attributes["beam"])
    assert_array_equal(joined["range"][N:], read_points(paths[1]).attributes["range"])
    assert not joined["beam"][N:].any()
    assert not joined["range"][:N].any()


def gps(path):
    content = bytearray(path.read_bytes())
    content[6] |= 1  # standard time, not that of the week
    path.write_bytes(content)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda path: write(path, extra=[("beam", "f4")]), r"b\.las: its attribute 'beam'"),
        (lambda path: write(path, scale=1e-7, offset=9e5), "span too much"),
        (lambda path: write(path, 9), r"b\.las: wave packets"),
        (lambda path: gps(write(path)), r"b\.las: its GPS times"),
    ],
)
def test_what_cannot_be_one_file_is_named(tmp_path, change, message):
    a, b = write(tmp_path / "a.las", extra=[("beam", "u1")]), tmp_path / "b.las"
    change(b)
    with pytest.raises(PointFileError, match=message):
        joined_header([a, b])


def test_points_outside_wrong_bounds_are_refused_if_they_do_not_fit(tmp_path):
    a = write(tmp_path / "a.las", scale=1e-6)
    b = write(tmp_path / "b.las", scale=0.01, offset=1e5)
    with open(b, "rb+") as file:
        file.seek(179)
        file.write(np.array([1.0, 0.0, 1.0, 0.0, 1.0, 0.0]).tobytes())
    with pytest.raises(PointFileError, match="outside the bounds"):
        join([a, b], tmp_path / "all.las")
