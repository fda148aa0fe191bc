"""E57: poses, colors, and what is dropped."""

import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from e57_files import pye57, with_xml, write_scans
from sklearn_mcmd.io import PointCloud, PointFileError, read_points, write_points


def test_points_that_e57_marks_invalid_are_dropped_and_counted(tmp_path):
    invalid = {"cartesianInvalidState": np.array([0, 2, 0], dtype=np.int8)}
    write_scans(tmp_path / "a.e57", (np.outer([0, 1, 2], [1, 1, 1]), invalid, {}))
    cloud = read_points(tmp_path / "a.e57")
    assert_array_equal(cloud.xyz[:, 0], [0, 2])
    assert cloud.n_dropped == 1


def test_fields_that_pye57_cannot_read_are_named(tmp_path):
    scan = np.eye(3), {"intensity": np.ones(3, np.float32)}, {}
    path = write_scans(tmp_path / "a.e57", scan)
    with_xml(path, path, ("intensity", "timeStamp"))
    with pytest.warns(UserWarning, match=r"a\.e57: pye57 cannot read fields timeStamp"):
        assert len(read_points(path)) == 3


EXACT, COLORS = np.arange(40), ("red", "green", "blue")
MISSING = np.where(EXACT == 3, np.nan, EXACT)


@pytest.mark.parametrize(
    ("attributes", "told"),
    [
        (dict.fromkeys(COLORS, np.uint16(EXACT * 257)), None),
        (dict.fromkeys(COLORS, np.uint16(EXACT)), None),
        (dict.fromkeys(COLORS, np.uint16(EXACT * 186)), "; rounded: red, green, blue"),
        (dict.fromkeys(COLORS, EXACT / 40), "; not written: red, green, blue"),
        ({"red": np.uint8(EXACT)}, "; not written: red"),
        ({"intensity": EXACT / 4}, None),
        ({"intensity": np.uint32(EXACT + 2**24)}, "; rounded: intensity"),
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
    if "red" in back:
        red = attributes["red"]
        assert_array_equal(back["red"], red >> 8 if red.max() > 255 else red)


def posed(place, **fields):
    """A scan that stood at a place."""
    xyz = np.linspace(1, 9, 40)[:, None] ** [1, 2, 3]
    return xyz, fields, {"translation": np.array(place, float)}


@pytest.mark.parametrize("place", [(500_000.25, 5_400_000, 101.5), (0, 0, 0)])
def test_the_pose_of_one_scan_is_written_again(tmp_path, place):
    grid = {"rowIndex": np.arange(40), "columnIndex": np.arange(40)}
    cloud = read_points(write_scans(tmp_path / "a.e57", posed(place, **grid)))
    write_points(tmp_path / "b.e57", cloud)
    again = read_points(tmp_path / "b.e57")
    assert_array_equal(again.metadata["sensor_origins"], [place])
    assert_allclose(again.xyz, cloud.xyz, rtol=1e-15)


def test_poses_that_one_scan_cannot_hold_are_named(tmp_path):
    cloud = read_points(write_scans(tmp_path / "a.e57", posed((5, 6, 7)), posed((8, 9, 10))))
    with pytest.warns(UserWarning, match="not written: scan_index, poses of the scans"):
        write_points(tmp_path / "b.e57", cloud)
    assert np.isnan(read_points(tmp_path / "b.e57").metadata["sensor_origins"]).all()
    # Zeros are no pose without a grid.
    cloud = read_points(write_scans(tmp_path / "a.e57", posed((0, 0, 0))))
    write_points(tmp_path / "b.e57", cloud)


# ---- files that other programs write, and damaged ones ----------------------------------------

N = 50
NUMBERS = np.arange(N)


@pytest.fixture
def plain(tmp_path):
    """A scan that is turned about z by a quarter and moved by 10, 20, 30."""
    xyz, turn = NUMBERS[:, None] + 0.5 * np.arange(3), np.sqrt([0.5, 0, 0, 0.5])
    pose = {"rotation": turn, "translation": np.array([10.0, 20, 30])}
    return write_scans(tmp_path / "plain.e57", (xyz, {}, pose))


def with_colors(path, *scans):
    """Scans whose colors have types of our own; pye57 itself writes bytes only."""
    libe57 = pye57.libe57
    with pye57.E57(str(path), mode="w") as file:
        image = file.image_file
        for (kind, *range_of), limits, colors in scans:
            buffers = libe57.VectorSourceDestBuffer()
            scan, prototype = libe57.StructureNode(image), libe57.StructureNode(image)
            columns = {f"cartesian{axis}": NUMBERS.astype(float) for axis in "XYZ"}
            columns |= {f"color{c.title()}": colors.astype(float) for c in COLORS}
            for name, values in columns.items():
                node = ("FloatNode",) if "cart" in name else (kind, *range_of)
                prototype.set(name, getattr(libe57, node[0])(image, *node[1:]))
                buffers.append(libe57.SourceDestBuffer(image, name, values, N, True, True))
            if limits is not None:
                scan.set("colorLimits", libe57.StructureNode(image))
                for color in COLORS:
                    most = libe57.FloatNode(image, limits)
                    scan["colorLimits"].set(f"color{color.title()}Maximum", most)
            points = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
            scan.set("points", points)
            file.data3d.append(scan)
            writer = points.writer(buffers)
            writer.write(N)
            writer.close()
    return read_points(path)


BYTE, WORD = ("IntegerNode", 0, 0, 255), ("IntegerNode", 0, 0, 65535)


@pytest.mark.parametrize(
    ("node", "limits", "colors", "expected"),
    [
        (BYTE, None, NUMBERS, np.uint8(NUMBERS)),
        (WORD, None, NUMBERS * 1000, np.uint16(NUMBERS * 1000)),
        (("IntegerNode", 0, 0, 4095), None, NUMBERS * 80, NUMBERS * 80 * 65535 / 4095),
        (WORD, 255.0, NUMBERS, np.uint8(NUMBERS)),
        (("ScaledIntegerNode", 0, 0, 1000, 0.001, 0.0), None, NUMBERS / 50, NUMBERS * 65535 / 50),
        (("FloatNode",), 1.0, NUMBERS / 64, NUMBERS * 65535 / 64),
        (("FloatNode",), None, NUMBERS / 49, NUMBERS * 65535 / 49),
        (("FloatNode",), None, NUMBERS * 0, NUMBERS * 0.0),
    ],
)
def test_colors_of_all_types_and_limits_are_read(tmp_path, node, limits, colors, expected):
    cloud = with_colors(tmp_path / "a.e57", (node, limits, colors))
    if expected.dtype == float:
        expected = np.uint16(np.rint(expected))
    for color in COLORS:
        assert cloud.attributes[color].dtype == expected.dtype
        assert_array_equal(cloud.attributes[color], expected)


def test_scans_with_colors_of_8_and_16_bits_have_one_scale_together(tmp_path):
    scans = (BYTE, None, NUMBERS), (WORD, None, NUMBERS * 1000)
    red = with_colors(tmp_path / "a.e57", *scans).attributes["red"]
    assert_array_equal(red, np.r_[NUMBERS * 257, NUMBERS * 1000])


ROTATION = r"<rotation.*</rotation>"


def rotation(w, x, y, z, order="wxyz"):
    told = {"w": w, "x": x, "y": y, "z": z}
    parts = "".join(f'<{axis} type="Float">{told[axis]}</{axis}>' for axis in order)
    return ROTATION, f'<rotation type="Structure">{parts}</rotation>'


def test_a_rotation_is_read_by_its_names_in_any_order(plain, tmp_path):
    xyz = read_points(plain).xyz
    turned = [9.5 - NUMBERS, 20 + NUMBERS, 31 + NUMBERS]
    assert_allclose(xyz, np.transpose(turned))
    half = np.sqrt(0.5)
    for order in ("xyzw", "zwyx"):
        with_xml(plain, tmp_path / "a.e57", rotation(half, 0, 0, half, order))
        assert_allclose(read_points(tmp_path / "a.e57").xyz, xyz, rtol=1e-12)


@pytest.mark.parametrize(
    ("factor", "told"),
    [(2.0, "its direction"), (0.1, "its direction"), (1 + 1e-6, None), (0, "no rotation")],
)
def test_a_rotation_of_another_length_turns_as_one_of_length_1_and_zeros_do_not(
    plain, tmp_path, factor, told
):
    half = factor * np.sqrt(0.5)
    with_xml(plain, tmp_path / "a.e57", rotation(half, 0, 0, half))
    with warnings.catch_warnings(record=True, action="always") as shown:
        cloud = read_points(tmp_path / "a.e57")
    expected = [f"scan 1: rotation has length {factor:.3g}; {told} is taken"] * (told is not None)
    assert [str(warning.message).split(": ", 1)[1] for warning in shown] == expected
    moved = np.transpose([NUMBERS + 10, NUMBERS + 20.5, NUMBERS + 31])
    assert_allclose(cloud.xyz, read_points(plain).xyz if factor else moved, rtol=1e-12)
    assert_array_equal(cloud.metadata["sensor_origins"], [[10, 20, 30]])


TRANSLATION = r'(<translation.*?<x type="Float">)1e\+01'


@pytest.mark.parametrize(
    "change",
    [
        *(rotation(w, x, 0, 0) for w, x in [("nan", 0), (1, "inf"), ("half", 0)]),
        *((TRANSLATION, rf"\g<1>{x}") for x in ("nan", "-1e999", "1e12", "ten")),
    ],
)
def test_a_pose_that_cannot_be_is_refused(plain, tmp_path, change):
    with pytest.raises(
        PointFileError, match=r"e57: scan 1: broken pose: rotation .*get the file anew"
    ):
        read_points(with_xml(plain, tmp_path / "a.e57", change))


def test_spherical_coordinates_are_range_azimuth_and_elevation(plain, tmp_path):
    names = zip("XYZ", ("Range", "Azimuth", "Elevation"), strict=True)
    changes = [(f"cartesian{axis}", f"spherical{name}") for axis, name in names]
    changes += [(r"(?s)<pose.*</pose>", "")]
    cloud = read_points(with_xml(plain, tmp_path / "a.e57", *changes))
    away, turn, up = (NUMBERS[:, None] + 0.5 * np.arange(3)).T
    level = away * np.cos(up)
    expected = [level * np.cos(turn), level * np.sin(turn), away * np.sin(up)]
    assert_allclose(cloud.xyz, np.transpose(expected), atol=1e-9)


def test_a_wrong_count_is_refused(plain, tmp_path):
    change = 'recordCount="50"', 'recordCount="60"'
    with pytest.raises(PointFileError, match="promises 60 points and holds 50"):
        read_points(with_xml(plain, tmp_path / "a.e57", change))


@pytest.mark.parametrize("scale", [0.0, 1e-300, 1e300])
def test_scaled_integers_that_all_mean_one_number_are_refused(plain, tmp_path, scale):
    node = f'<cartesianX type="ScaledInteger" minimum="0" maximum="4294967295" scale="{scale}"/>'
    with pytest.raises(PointFileError, match="give no coordinates"):
        read_points(with_xml(plain, tmp_path / "a.e57", (r"<cartesianX.*?</cartesianX>", node)))
