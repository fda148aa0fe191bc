"""Full waveforms: their samples are found where the header says, or it says that there are none."""

import struct

import numpy as np
import pytest

from sklearn_mcmd.io import read_points, write_points

laspy = pytest.importorskip("laspy")
pytest.importorskip("lazrs")

SAMPLES = bytes(range(200))
RECORD = struct.pack("<2x16sHQ32x", b"LASF_Spec", 65535, len(SAMPLES)) + SAMPLES


def las_with_waveforms(path, version, point_format):
    """Three points whose samples are behind them, as the specification has it."""
    header = laspy.LasHeader(version=version, point_format=point_format)
    las = laspy.LasData(header)
    las.X = las.Y = las.Z = np.arange(3)
    las.points.array["wavepacket_offset"] = 60 + 50 * np.arange(3)
    las.points.array["wavepacket_size"] = 50
    las.write(path)
    content = bytearray(path.read_bytes())
    start = len(content)
    struct.pack_into("<Q", content, 227, start)
    if version == "1.4":
        other = struct.pack("<2x16sHQ32x", b"someone", 3, 5) + b"hello"
        struct.pack_into("<QI", content, 235, start, 2)
        struct.pack_into("<Q", content, 227, start + len(other))
        content += other
    path.write_bytes(content + RECORD)
    return path


@pytest.mark.parametrize("target", ["b.las", "b.laz"])
@pytest.mark.parametrize("point_format", [4, 9, 10])
def test_the_header_says_where_the_samples_are_after_points_were_removed(
    tmp_path, point_format, target
):
    cloud = read_points(las_with_waveforms(tmp_path / "a.las", "1.4", point_format))
    write_points(tmp_path / target, cloud.subset(slice(2)))
    content = (tmp_path / target).read_bytes()
    (start,) = struct.unpack_from("<Q", content, 227)
    assert content[start : start + len(RECORD)] == RECORD
    points = laspy.read(tmp_path / target).points.array
    assert (points["wavepacket_offset"] == [60, 110]).all()


@pytest.mark.parametrize("target", ["b.las", "b.laz"])
def test_samples_that_cannot_be_copied_are_not_promised(tmp_path, target):
    cloud = read_points(las_with_waveforms(tmp_path / "a.las", "1.3", 4))
    with pytest.warns(UserWarning, match="samples of waveforms .* are not copied"):
        write_points(tmp_path / target, cloud)
    assert struct.unpack_from("<Q", (tmp_path / target).read_bytes(), 227) == (0,)
