"""The compressed points of LAZ: checked first, then passed to lazrs.

A damaged file can make lazrs request more memory than there is, which ends the process (SIGABRT).
So all sizes that it reads are checked before; the compressed bytes remain unchecked. As lazrs turns
every error of Python's code into its own, even a KeyboardInterrupt, it gets bytes in memory.
"""

import io
import os
import struct
from contextlib import suppress

import numpy as np

from sklearn_mcmd._extras import import_extra
from sklearn_mcmd.io._point_cloud import PointFileError, check_room

LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}  # of LASzip's items by number; an extra byte is one
EXTRA_BYTES = (0, 14)  # numbers of the items that hold them
ONE_CHUNK, CHUNKED, LAYERED = 1, 2, 3  # compressors
ITEM_VERSIONS = {ONE_CHUNK: (1, 2), CHUNKED: (1, 2), LAYERED: (3, 4)}  # that lazrs reads
CHUNK_SIZE = slice(12, 16)  # place in the record
VARIABLE = 2**32 - 1  # this chunk size means that the table holds the sizes
BYTES_PER_ENTRY = 16  # of the table, at most: two integers with their probabilities
# Of a point at least one of 64 symbols is stored, whose likelihoods are multiples of 2**-15: 2,884
# points a byte if all are alike. lazrs comes to 655.
POINTS_A_BYTE = 2_900
# Each chunk takes lazrs a millisecond, as 4,000 points do, which have thousands of bytes.
FEW_CHUNKS, BYTES_A_CHUNK = 1_000, 250
CHUNKS_A_TIME = 64  # enough for all processors, and few enough for Ctrl-C to end soon


def compressed_parts(file, header, n_points):
    """The point records behind a header, as bytes, in parts of whole chunks; see `parts_of`."""
    lazrs, record, layout, chunks = _opened(file, header)
    header.vlrs.extract("LasZipVlr")
    ends = np.cumsum([0, *(n for n, _ in chunks)])
    first = 0
    while first < len(chunks):
        last = int(np.searchsorted(ends, ends[first] + n_points, side="right")) - 1
        last = max(last, first + 1)
        points = np.empty((ends[last] - ends[first], layout.n_bytes), dtype=np.uint8)
        for start in range(first, last, CHUNKS_A_TIME):
            end = min(start + CHUNKS_A_TIME, last)
            part = chunks[start:end]
            data = file.read(sum(n_bytes for _, n_bytes in part))
            layout.check_chunks(data, part, start)
            rows = points[slice(*(ends[[start, end]] - ends[first]))].reshape(-1)
            try:
                lazrs.decompress_points_with_chunk_table(data, record, rows, part)
            except lazrs.LazrsError as err:
                words = f"damaged: points {ends[start] + 1:,} to {ends[end]:,} cannot be"
                raise PointFileError(f"{words} decompressed ({err})") from err
        yield points.reshape(-1)
        first = last


def n_compressed(file, header):
    """How many points are there, at most as many as the header counts.

    Layers tell. Of others, the last chunk is tried if the points by return are not as many.
    """
    lazrs, record, layout, chunks = _opened(file, header)
    (n_last, n_bytes), n_points = chunks[-1], sum(n for n, _ in chunks)
    file.seek(sum(n for _, n in chunks[:-1]), os.SEEK_CUR)
    if layout.compressor == LAYERED:
        stored = file.read(layout.n_bytes + 4)[layout.n_bytes :]
        return n_points - n_last + min(n_last, int.from_bytes(stored, "little"))
    if n_points == sum(header.number_of_points_by_return):
        return n_points
    points = np.full((n_last, layout.n_bytes), 255, np.uint8)
    with suppress(lazrs.LazrsError):  # the points before the end are then written all the same
        lazrs.decompress_points_with_chunk_table(
            file.read(n_bytes), record, points.reshape(-1), chunks[-1:]
        )
    return n_points - n_last + int(np.flatnonzero((points < 255).any(axis=1)).max(initial=-1)) + 1


def _opened(file, header):
    """lazrs, the record of the compression, its layout, and the chunks; the file is at these."""
    lazrs = import_extra("lazrs", "las", "LAZ")
    records = header.vlrs.get("LasZipVlr")
    if not records:
        raise PointFileError("damaged: the record that says how its points are compressed is gone")
    record = records[0].record_data
    if record[CHUNK_SIZE] == bytes(4):  # so LASzip 1.2 writes one chunk, and others what varies
        record = record[: CHUNK_SIZE.start] + b"\xff" * 4 + record[CHUNK_SIZE.stop :]
    layout = _Layout(lazrs, record, header.point_format)
    return lazrs, record, layout, _chunks(lazrs, file, header, record, layout)


class _Layout:
    """The layout and compression of a point, from the LASzip record of the header."""

    def __init__(self, lazrs, record, point_format):
        # 34 bytes: the compressor first, the chunk size at 12, the number of items at 32. Each item
        # has 6 more: what it is of a point (coordinates, time, colors), its bytes, its version.
        n_items = struct.unpack_from("<H", record, 32)[0] if len(record) >= 34 else 0
        if n_items == 0 or len(record) < 34 + 6 * n_items:
            raise PointFileError("damaged: the record of the compression is too short")
        self.compressor, self.chunk_size = struct.unpack_from("<H10xI", record)
        if self.compressor not in ITEM_VERSIONS:
            raise PointFileError(f"damaged, or compressed in a way unknown ({self.compressor})")
        plain = lazrs.LazVlr.new_for_compression(point_format.id, 0, False).record_data()
        wanted = [item[:2] for item in struct.iter_unpack("<3H", plain[34:])]
        items = list(struct.iter_unpack("<3H", record[34 : 34 + 6 * n_items]))
        for i, (kind, n_bytes, version) in enumerate(items):
            is_usual = wanted[i] == (kind, n_bytes) if i < len(wanted) else kind in EXTRA_BYTES
            if not is_usual or version not in ITEM_VERSIONS[self.compressor]:
                raise PointFileError(
                    f"damaged, or compressed by an unknown LASzip ({record[4]}.{record[5]}): item "
                    f"{kind} of {n_bytes} bytes, version {version}; write it anew by laszip"
                )
        self.n_bytes = point_format.size
        if (n_compressed := sum(n_bytes for _, n_bytes, _ in items)) != self.n_bytes:
            raise PointFileError(f"damaged: points of {self.n_bytes} bytes, not {n_compressed}")
        self.n_layers = 0
        if self.compressor == LAYERED:
            self.n_layers = sum(LAYERS.get(kind, n_bytes) for kind, n_bytes, _ in items)

    @property
    def smallest_chunk(self):
        """Bytes of the first point, which is not compressed, and of the sizes that follow it."""
        return self.n_bytes + (4 + 4 * self.n_layers if self.compressor == LAYERED else 0)

    def check_chunks(self, data, chunks, first):
        """Refuse chunks that end too early, or layers that do not fit into their chunk."""
        if len(data) < sum(n_bytes for _, n_bytes in chunks):
            raise PointFileError("truncated: the compressed points end too early")
        start = 0
        for number, (n_points, n_bytes) in enumerate(chunks, start=first + 1):
            needed = self.smallest_chunk if n_points else 0  # lazrs may end with an empty one
            # The first point is followed by the number of points, and the bytes of each layer.
            if self.compressor == LAYERED and 0 < needed <= n_bytes:
                n_stored, *layers = struct.unpack_from(
                    f"<{1 + self.n_layers}I", data, start + self.n_bytes
                )
                needed += sum(layers)
                if not n_points <= n_stored <= self.chunk_size:
                    raise PointFileError(
                        f"damaged: chunk {number} holds {n_stored} points, not {n_points}"
                    )
            if needed > n_bytes:
                raise PointFileError(
                    f"damaged: chunk {number} would need {needed} bytes, and has {n_bytes}"
                )
            start += n_bytes


def _chunks(lazrs, file, header, record, layout):
    """Points and bytes of each chunk. The file is then at the first chunk."""
    size = file.seek(0, os.SEEK_END)
    points_at, n_points = header.offset_to_point_data, header.point_count
    check_room(n_points // POINTS_A_BYTE, size - points_at, f"{n_points:,} points")
    if layout.compressor == ONE_CHUNK:
        file.seek(points_at)
        return [(n_points, size - points_at)]
    table_at = _table_position(file, points_at, size)
    room = table_at - points_at - 8
    file.seek(table_at)
    start = file.read(8)  # a version, the number of chunks; then compressed entries
    (n_chunks,) = struct.unpack_from("<I", start, 4)
    is_variable = layout.chunk_size == VARIABLE
    most = room // layout.smallest_chunk + 1, FEW_CHUNKS + room // BYTES_A_CHUNK
    if not 1 <= n_chunks <= min(most):
        raise PointFileError(f"damaged: {n_points} points are not in {n_chunks} chunks")
    table = io.BytesIO(start + file.read(BYTES_PER_ENTRY * (n_chunks + 4)))
    try:
        entries = lazrs.read_chunk_table_only(table, lazrs.LazVlr(record))
    except lazrs.LazrsError as err:
        raise PointFileError(f"damaged: its chunk table cannot be read ({err})") from err
    if is_variable:
        chunks = [entry for entry in entries if any(entry)]
    else:
        # All chunks but the last have as many points; an entry without bytes may follow.
        if not entries[-1][1]:
            entries.pop()
        size = layout.chunk_size
        starts = range(0, min(n_points, size * len(entries)), size)
        counts = (min(size, n_points - start) for start in starts)
        chunks = [(n, n_bytes) for n, (_, n_bytes) in zip(counts, entries, strict=False)]
    n_listed, n_bytes = map(sum, zip(*chunks, strict=True)) if chunks else (0, 0)
    if not 0 < n_listed <= n_points or n_bytes > room:
        raise PointFileError(f"damaged: its table has {n_listed} points, not {n_points}")
    file.seek(points_at + 8)
    return chunks


def _table_position(file, points_at, size):
    """Position of the chunk table. Files written to a stream hold it in their last bytes."""
    for position in (points_at, size - 8):
        file.seek(position)
        (table_at,) = struct.unpack("<q", file.read(8).ljust(8, b"\0"))
        if table_at > points_at:
            break
    else:
        raise PointFileError("has no chunk table: it is damaged, or was not written to the end")
    if not points_at + 8 <= table_at <= size - 8:
        raise PointFileError(f"truncated: its chunk table begins at byte {table_at} of {size}")
    return table_at
