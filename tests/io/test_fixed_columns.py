"""PTS, XYZN and XYZRGB hold a few columns, each at its place."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd.io import PointCloud, read_points, write_points

COLORS = ("red", "green", "blue")
NORMALS = ("normal_x", "normal_y", "normal_z")
BYTES = np.arange(256).reshape(-1, 1) * [1, 3, 5] % 256  # each of 256 in each color


def colored(colors, xyz=None):
    xyz = np.random.default_rng(0).uniform(0, 9, (len(colors), 3)) if xyz is None else xyz
    return PointCloud(xyz, dict(zip(COLORS, np.asarray(colors).T, strict=True)))


def read(path, text):
    path.write_text(text)
    return read_points(path)


@pytest.mark.parametrize(
    ("extension", "row", "names"),
    [
        (".pts", "1 2 3", []),
        (".pts", "1 2 3 -2048", ["intensity"]),
        (".pts", "1 2 3 10 20 30", COLORS),
        (".pts", "1 2 3 2047 10 20 30", ["intensity", *COLORS]),
        (".pts", "1 2 3 4 5", ["column_4", "column_5"]),
        (".xyzn", "1 2 3 0 0.6 0.8", NORMALS),
        (".xyzrgb", "1 2 3 10 20 30", COLORS),
        (".asc", "1 2 3 4 5 6", ["column_4", "column_5", "column_6"]),
    ],
)
@pytest.mark.parametrize("count", ["", "1\n"])
def test_columns_have_the_names_of_their_places(tmp_path, extension, row, names, count):
    cloud = read(tmp_path / f"a{extension}", f"{count}{row}\n")
    assert_array_equal(cloud.xyz, [[1, 2, 3]])
    assert list(cloud.attributes) == list(names)
    values = [cloud.attributes[name][0] for name in names]
    assert_array_equal(values, [float(cell) for cell in row.split()[3:]])


def test_names_in_the_file_count_more_than_places(tmp_path):
    cloud = read(tmp_path / "a.pts", "//X Y Z red green blue intensity\n1\n1 2 3 4 5 6 700\n")
    assert cloud.attributes["intensity"] == [700]


@pytest.mark.parametrize(("form", "scale"), [("%d", 1), ("%.3f", 255), ("%.17g", 255)])
def test_colors_of_xyzrgb_are_of_8_bits_from_0_to_255_or_to_1(tmp_path, form, scale):
    rows = [[*(1, 2, 3), *(color / scale)] for color in BYTES]
    text = "\n".join(" ".join(form % value for value in row) for row in rows)
    cloud = read(tmp_path / "a.xyzrgb", text)
    assert_array_equal(np.transpose([cloud.attributes[color] for color in COLORS]), BYTES)
    assert cloud.attributes["red"].dtype == np.uint8


def test_colors_between_those_of_8_bits_are_rounded_with_a_warning(tmp_path):
    with pytest.warns(UserWarning, match=r"a\.xyzrgb: colors are rounded to 8 bits"):
        cloud = read(tmp_path / "a.xyzrgb", "1 2 3 0.5 0.501 1\n")
    assert [cloud.attributes[color][0] for color in COLORS] == [128, 128, 255]


@pytest.mark.parametrize("cells", ["0 10 256", "-1 0 3", "0.5 2 3", "nan 2 3"])
def test_colors_of_another_scale_stay_as_they_are(tmp_path, cells):
    cloud = read(tmp_path / "a.xyzrgb", f"1 2 3 {cells}\n")
    colors = [cloud.attributes[color][0] for color in COLORS]
    assert_array_equal(colors, [float(cell) for cell in cells.split()])


# ---- writing ---------------------------------------------------------------------------


INTENSITY = {"intensity": np.linspace(-2048, 2047, 256).astype(int)}
VECTORS = np.random.default_rng(1).normal(size=(256, 3))


@pytest.mark.parametrize(
    ("extension", "attributes"),
    [
        (".pts", INTENSITY),
        (".pts", INTENSITY | colored(BYTES.astype(np.uint8)).attributes),
        (".xyzn", dict(zip(NORMALS, VECTORS.T, strict=True))),
    ],
)
def test_files_come_back_as_they_were(tmp_path, extension, attributes):
    cloud, path = PointCloud(VECTORS * 9, attributes), tmp_path / f"a{extension}"
    write_points(path, cloud)
    assert path.read_text().startswith("256\n") == (extension == ".pts")
    back = read_points(path)
    assert_array_equal(back.xyz, cloud.xyz)
    assert back.attributes.keys() == cloud.attributes.keys()
    for name, values in cloud.attributes.items():
        assert_array_equal(back.attributes[name], values, err_msg=name)


@pytest.mark.parametrize("extension", [".pts", ".xyzrgb"])
@pytest.mark.parametrize("factor", [1, 256, 257])
def test_colors_of_16_bits_that_were_8_come_back_as_8(tmp_path, extension, factor):
    write_points(tmp_path / f"a{extension}", colored((BYTES * factor).astype(np.uint16)))
    back = read_points(tmp_path / f"a{extension}")
    assert_array_equal(np.transpose([back.attributes[color] for color in COLORS]), BYTES)


def test_xyzrgb_has_colors_from_0_to_1_as_its_readers_expect(tmp_path):
    write_points(tmp_path / "a.xyzrgb", colored(BYTES.astype(np.uint8)))
    assert_allclose(np.loadtxt(tmp_path / "a.xyzrgb")[:, 3:], BYTES / 255, rtol=1e-15)


@pytest.mark.parametrize(
    ("extension", "message"),
    [
        (".pts", "red, green, blue only; not written: normal_x, normal_y, normal_z, gps_time$"),
        (".xyzn", "normal_z only; not written: red, green, blue, gps_time$"),
    ],
)
def test_attributes_that_have_no_place_are_warned_of(tmp_path, extension, message):
    cloud = colored(BYTES.astype(np.uint8)).with_attributes(normals=BYTES, gps_time=BYTES[:, 0])
    with pytest.warns(UserWarning, match=message):
        write_points(tmp_path / f"a{extension}", cloud)
    kept = read_points(tmp_path / f"a{extension}").attributes
    assert list(kept) == list(NORMALS if extension == ".xyzn" else COLORS)
    assert_array_equal(np.transpose([*kept.values()]), BYTES)


@pytest.mark.parametrize(
    ("extension", "colors", "message"),
    [
        (".pts", BYTES.astype(np.uint16) * 250, "only; rounded: red, green, blue"),
        (".pts", BYTES / 255, "not written: red, green, blue"),
        (".pts", BYTES + 1, "not written: red, green, blue"),
        (".xyzrgb", BYTES - 1, "not written: red, green, blue"),
    ],
)
def test_colors_that_do_not_fit_are_warned_of(tmp_path, extension, colors, message):
    with pytest.warns(UserWarning, match=message):
        write_points(tmp_path / f"a{extension}", colored(colors))
