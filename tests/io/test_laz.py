"""Compressed LAS: damage is refused before lazrs sees it, and what is whole is read."""

import io
import os
import struct
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from las_files import las_of, laspy
from sklearn_mcmd.io import PointFileError, read_points, write_points
from sklearn_mcmd.io._las_parts import read_parts
from sklearn_mcmd.tiling import Catalog

lazrs = pytest.importorskip("lazrs")

N, ROOT = 3000, Path(__file__).parents[2]
POINTS_AT, CHUNK_SIZE, VARIABLE = 96, 12, 2**32 - 1


def made(point_format, n=N, **options):
    """Points of LAS 1.4. Of several scanner channels lazrs 0.8 would change the wave packets."""
    las = las_of(point_format, n=n, version="1.4", **options)
    if point_format > 8:
        las.scanner_channel[:] = 0
    return las


def laz_of(las, chunk_size=50_000, cuts=(), record=None):
    """The bytes of a LAZ file with chunks of a size, or (cuts) of several, or of a record."""
    buffer = io.BytesIO()
    las.write(buffer, do_compress=True)
    content = bytearray(buffer.getvalue())
    if record is None:
        extra = las.point_format.num_extra_bytes
        vlr = lazrs.LazVlr.new_for_compression(las.point_format.id, extra, bool(cuts))
        record = bytearray(vlr.record_data())
        if not cuts:
            struct.pack_into("<I", record, CHUNK_SIZE, chunk_size)
    at = record_at(content)
    content[at : at + len(record)] = record
    out = io.BytesIO(content[: first_chunk_at(content) - 8])
    out.seek(0, os.SEEK_END)
    compressor, points = lazrs.LasZipCompressor(out, lazrs.LazVlr(bytes(record))), las.points.array
    for start, stop in pairwise([0, *cuts, len(points)]):
        compressor.compress_many(np.frombuffer(points[start:stop].tobytes(), np.uint8))
        if cuts:
            compressor.finish_current_chunk()
    compressor.done()
    return bytearray(out.getvalue())


def record_at(content):
    """Where the data of the LASzip record begins."""
    return content.index(b"laszip encoded") - 2 + 54


def table_at(content):
    (points_at,) = struct.unpack_from("<I", content, POINTS_AT)
    return struct.unpack_from("<q", content, points_at)[0]


def first_chunk_at(content):
    return struct.unpack_from("<I", content, POINTS_AT)[0] + 8


# ---- whole files -------------------------------------------------------------------------


QUALITY = [("quality", "f4")]
CHUNKS = [{}, {"chunk_size": 40}, {"cuts": [7, 8, 1500]}]  # of a usual, a small, and their own size


def assert_read(path, las):
    points = read_points(path).metadata["las_points"]
    assert points.tobytes() == las.points.array.tobytes()


@pytest.mark.parametrize(
    ("point_format", "extra", "chunks"),
    [(n, QUALITY * (n % 2 == swap), CHUNKS[(n + swap) % 3]) for n in range(11) for swap in (0, 1)],
)
def test_whole_files_are_read_bit_for_bit(tmp_path, point_format, extra, chunks):
    las = made(point_format, extra=extra)
    path = tmp_path / ("a.las" if extra else "a.laz")  # whose extension counts for nothing
    path.write_bytes(laz_of(las, **chunks))
    assert_read(path, las)


def test_files_of_a_stream_or_of_one_chunk_have_no_table_in_front(tmp_path):
    las = made(1)
    content = laz_of(las)
    start = first_chunk_at(content)
    position = struct.pack("<q", table_at(content))  # at the end of what is written to a stream
    stream = content[: start - 8] + struct.pack("<q", -1) + content[start:] + position
    struct.pack_into("<H", content, record_at(content), 1)  # LASzip's first compressor
    chunk = content[: start - 8] + content[start : table_at(content)]
    for name, data in {"stream.laz": stream, "chunk.laz": chunk}.items():
        (tmp_path / name).write_bytes(data)
        assert_read(tmp_path / name, las)
    struct.pack_into("<Q", chunk, 247, 2**32)
    (tmp_path / "a.laz").write_bytes(chunk)
    with pytest.raises(PointFileError, match="damaged: 4,294,967,296 points need 1,481,"):
        read_points(tmp_path / "a.laz")


@pytest.mark.parametrize("point_format", [1, 6])
def test_a_chunk_of_many_equal_points_is_read(tmp_path, point_format):
    las = made(point_format, n=1)
    las.points = laspy.ScaleAwarePointRecord.zeros(300_000, header=las.header)
    content = laz_of(las, chunk_size=300_000)
    assert len(content) < 5_000
    (tmp_path / "a.laz").write_bytes(content)
    assert len(read_points(tmp_path / "a.laz")) == 300_000


# ---- damaged files -----------------------------------------------------------------------


def points_at(content):
    return first_chunk_at(content) - 8


# What is changed, to which number, and what the error says of it.
DAMAGES = [
    (table_at, 4, "<I", 0x7FFFFFFF, "not in 2147483647 chunks"),
    (table_at, 4, "<I", 0, "not in 0 chunks"),
    (record_at, CHUNK_SIZE, "<I", 10, "chunk 1 holds 500 points, not 10"),
    (record_at, CHUNK_SIZE, "<I", 0, "its chunk table cannot be read"),
    (record_at, CHUNK_SIZE, "<I", VARIABLE, "chunk"),
    (points_at, 0, "<q", 2**40, "truncated: its chunk table begins"),
    (points_at, 0, "<q", -1, "has no chunk table"),
    (record_at, 0, "<H", 9, "compressed in a way unknown"),
    (record_at, 32, "<H", 500, "too short"),
    (record_at, 36, "<H", 29, "item 10 of 29 bytes"),
    (record_at, 38, "<H", 2, "version 2"),
    (first_chunk_at, 34, "<I", 0x70000000, "chunk 1 would need"),  # of the first layer
    (first_chunk_at, 30, "<I", 3, "chunk 1 holds 3 points"),
    (lambda _: 247, 0, "<Q", 2**60, "points need .* bytes, there are"),
]


@pytest.mark.filterwarnings("ignore:.*holds 60 of the 3,000 points")
@pytest.mark.parametrize(("where", "offset", "form", "value", "message"), DAMAGES)
def test_damage_is_named(tmp_path, where, offset, form, value, message):
    content = laz_of(made(6), chunk_size=500)
    struct.pack_into(form, content, where(content) + offset, value)
    if value == -1:
        content[-8:] = bytes(8)
    (tmp_path / "a.laz").write_bytes(content)
    with pytest.raises(PointFileError, match=message) as error:
        read_points(tmp_path / "a.laz")
    assert "\n" not in str(error.value)


@pytest.mark.skipif(sys.platform != "linux", reason="limits memory as Linux does")
def test_no_damage_ends_the_process_or_takes_its_time_or_memory(tmp_path):
    """lazrs ends the process (SIGABRT) when it gets less memory than it asks for."""
    command = [sys.executable, "benchmarks/fuzz_files.py", "--reader", "laz"]
    command += ["--executions", "150", "--folder", tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, cwd=ROOT)
    assert done.stdout == "laz                150 executions without a failure\n", done.stderr


def test_thousands_of_chunks_of_a_point_are_refused_as_each_takes_a_millisecond(tmp_path):
    (tmp_path / "a.laz").write_bytes(laz_of(made(1), chunk_size=1))
    with pytest.raises(PointFileError, match="3000 points are not in 3000 chunks"):
        read_points(tmp_path / "a.laz")
    few = made(1, n=900)
    (tmp_path / "a.laz").write_bytes(laz_of(few, chunk_size=1))
    assert_read(tmp_path / "a.laz", few)


# ---- more points promised than there are -------------------------------------------------


def promising(path, point_format, n_more, by_return, **chunks):
    """A LAZ whose header counts more points than there are, in its versions' place."""
    las = las_of(point_format, n=N)
    las.return_number = np.full(N, by_return)
    content = laz_of(las, **chunks)
    position, form = (247, "<Q") if content[25] >= 4 else (107, "<I")
    struct.pack_into(form, content, position, N + n_more)
    path.write_bytes(content)
    return las


@pytest.mark.parametrize("point_format", [0, 3, 4, 6])
@pytest.mark.parametrize("n_more", [1, 40_000])
@pytest.mark.parametrize("chunks", CHUNKS)
def test_what_is_there_of_more_that_are_promised_is_read(tmp_path, point_format, n_more, chunks):
    las = promising(tmp_path / "a.laz", point_format, n_more, 1, **chunks)
    with pytest.warns(UserWarning, match=f"a.laz: holds 3,000 of the {N + n_more:,} points that"):
        assert_read(tmp_path / "a.laz", las)


def test_a_catalog_counts_what_is_there_and_parts_hold_as_many(tmp_path):
    for point_format in (1, 6):
        promising(tmp_path / "a.laz", point_format, 11, 0, chunk_size=1000)
        with pytest.warns(UserWarning, match="a.laz: holds 3,000 of the 3,011 points"):
            assert Catalog(tmp_path / "a.laz").counts == [3000]
        with pytest.warns(UserWarning, match="a.laz: holds 3,000 of the 3,011 points"):
            assert sum(map(len, read_parts(tmp_path / "a.laz", 500))) == 3000


# ---- old versions of LASzip --------------------------------------------------------------


@pytest.mark.parametrize("point_format", range(6))
def test_one_chunk_by_laszip_1_2_of_chunks_of_0_points_is_read(tmp_path, point_format):
    las = las_of(point_format, n=N)
    record = bytearray(lazrs.LazVlr.new_for_compression(point_format, 0, False).record_data())
    for at in range(38, len(record), 6):
        struct.pack_into("<H", record, at, 1)  # the first versions of all items
    content = laz_of(las, record=record)
    start, end = first_chunk_at(content), table_at(content)
    content = content[: start - 8] + content[start:end]  # no table tells of one chunk
    struct.pack_into("<H10xI", content, record_at(content), 1, 0)
    (tmp_path / "a.laz").write_bytes(content)
    assert_read(tmp_path / "a.laz", las)


def test_chunks_of_0_points_are_of_any_number(tmp_path):
    las = las_of(1, n=N)
    content = laz_of(las, cuts=[7, 8, 1500])
    struct.pack_into("<I", content, record_at(content) + CHUNK_SIZE, 0)
    (tmp_path / "a.laz").write_bytes(content)
    assert_read(tmp_path / "a.laz", las)


# ---- writing -----------------------------------------------------------------------------


def test_laz_in_any_parts_is_written_as_laspy_writes_it(tmp_path, monkeypatch):
    made(7, n=120_000).write(tmp_path / "a.laz")
    for at_once in (2_000_000, 7_001):
        monkeypatch.setattr("sklearn_mcmd.io._las.WRITTEN_AT_ONCE", at_once)
        write_points(tmp_path / "b.laz", read_points(tmp_path / "a.laz"))
        assert (tmp_path / "b.laz").read_bytes() == (tmp_path / "a.laz").read_bytes()


@pytest.mark.parametrize("point_format", [4, 5, 9, 10])
def test_wave_packets_in_any_order_survive_laz(tmp_path, point_format):
    las = made(point_format)
    las.points.array["wavepacket_offset"] = np.random.default_rng(0).integers(0, 2**40, N)
    las.write(tmp_path / "a.las")
    write_points(tmp_path / "b.laz", read_points(tmp_path / "a.las"))
    assert_array_equal(laspy.read(tmp_path / "b.laz").points.array, las.points.array)


def test_wave_packets_of_two_channels_are_refused_as_lazrs_would_change_them(tmp_path):
    las = made(9)
    las.scanner_channel = np.arange(N) % 2
    las.write(tmp_path / "a.las")
    with pytest.raises(PointFileError, match=r"of several channels; write \.las"):
        write_points(tmp_path / "b.laz", read_points(tmp_path / "a.las"))
    assert os.listdir(tmp_path) == ["a.las"]
