"""The compressed points of LAZ: checked first, then passed to lazrs.

A damaged file can make lazrs request more memory than there is, which ends the process (SIGABRT).
So all sizes that it reads are checked before; the compressed bytes remain unchecked. As lazrs turns
every error of Python's code into its own, even a KeyboardInterrupt, it gets bytes in memory.
"""

import io
import os
import struct

import numpy as np

from sklearn_mcmd.io._las_structure import as_described, record_length
from sklearn_mcmd.io._point_cloud import PointFileError, check_room, import_extra

LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}  # of LASzip's items by number; an extra byte is one
EXTRA_BYTES = (0, 14)  # numbers of the items that hold them
ONE_CHUNK, CHUNKED, LAYERED = 1, 2, 3  # compressors
ITEM_VERSIONS = {ONE_CHUNK: (1, 2), CHUNKED: (1, 2), LAYERED: (3, 4)}  # that lazrs reads
VARIABLE = 2**32 - 1  # this chunk size means that the table holds the sizes
BYTES_PER_ENTRY = 16  # of the table, at most: two integers with their probabilities
# Of a point at least one of 64 symbols is stored, whose likelihoods are multiples of 2**-15: 2,884
# points a byte if all are alike. lazrs comes to 655.
POINTS_A_BYTE = 2_900
CHUNKS_A_TIME = 64  # enough for all processors, and few enough for Ctrl-C to end soon


def compressed_parts(file, header, n_points):
    """The point records behind a header, as bytes, in parts of whole chunks; see `parts_of`."""
    lazrs = import_extra("lazrs", "las", "LAZ")
    records = header.vlrs.extract("LasZipVlr")
    if not records:
        raise PointFileError("damaged: the record that says how its points are compressed is gone")
    record = records[0].record_data
    size = record_length(file)
    layout = _Layout(lazrs, record, header.point_format.id, size)
    chunks = _chunks(lazrs, file, header, record, layout)
    ends = np.cumsum([0, *(n for n, _ in chunks)])
    first = 0
    while first < len(chunks):
        last = int(np.searchsorted(ends, ends[first] + n_points, side="right")) - 1
        last = max(last, first + 1)
        points = np.empty((ends[last] - ends[first], size), dtype=np.uint8)
        for start in range(first, last, CHUNKS_A_TIME):
            end = min(start + CHUNKS_A_TIME, last)
            part = chunks[start:end]
            data = file.read(sum(n_bytes for _, n_bytes in part))
            layout.check_chunks(data, part, start)
            rows = slice(*(ends[[start, end]] - ends[first]))
            lazrs.decompress_points_with_chunk_table(data, record, points[rows].reshape(-1), part)
        yield as_described(points.reshape(-1), size, header.point_format)
        first = last


class _Layout:
    """The layout and compression of a point, from the LASzip record of the header."""

    def __init__(self, lazrs, record, format_id, size):
        n_items = struct.unpack_from("<H", record, 32)[0] if len(record) >= 34 else 0
        if n_items == 0 or len(record) < 34 + 6 * n_items:
            raise PointFileError("damaged: the record of the compression is too short")
        self.compressor, self.chunk_size = struct.unpack_from("<H10xI", record)
        if self.compressor not in ITEM_VERSIONS:
            raise PointFileError(f"damaged, or compressed in a way unknown ({self.compressor})")
        if self.chunk_size == 0:
            raise PointFileError("damaged: its chunks are of 0 points")
        plain = lazrs.LazVlr.new_for_compression(format_id, 0, False).record_data()
        wanted = [item[:2] for item in struct.iter_unpack("<3H", plain[34:])]
        items = list(struct.iter_unpack("<3H", record[34 : 34 + 6 * n_items]))
        for i, (kind, n_bytes, version) in enumerate(items):
            known = wanted[i] == (kind, n_bytes) if i < len(wanted) else kind in EXTRA_BYTES
            if not known or version not in ITEM_VERSIONS[self.compressor]:
                raise PointFileError(f"damaged: item {kind} of {n_bytes} bytes, version {version}")
        self.n_bytes = size
        if (n_compressed := sum(n_bytes for _, n_bytes, _ in items)) != size:
            raise PointFileError(f"damaged: points of {size} bytes, not {n_compressed}")
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
            if self.compressor == LAYERED and 0 < needed <= n_bytes:
                n_stored, *layers = struct.unpack_from(
                    f"<{1 + self.n_layers}I", data, start + self.n_bytes
                )
                needed += sum(layers)
                if n_stored < n_points:
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
    start = file.read(8)
    (n_chunks,) = struct.unpack_from("<I", start, 4)
    is_variable = layout.chunk_size == VARIABLE
    n_needed = 1 if is_variable else -(-n_points // layout.chunk_size)
    if not n_needed <= n_chunks <= room // layout.smallest_chunk + 1:
        raise PointFileError(f"damaged: {n_points} points are not in {n_chunks} chunks")
    table = io.BytesIO(start + file.read(BYTES_PER_ENTRY * (n_chunks + 4)))
    try:
        entries = lazrs.read_chunk_table_only(table, lazrs.LazVlr(record))
    except lazrs.LazrsError as err:
        raise PointFileError(f"damaged: its chunk table cannot be read ({err})") from err
    if is_variable:
        chunks = [entry for entry in entries if any(entry)]
    else:
        chunks = [(layout.chunk_size, n_bytes) for _, n_bytes in entries[:n_needed]]
        chunks[-1] = (n_points - layout.chunk_size * (n_needed - 1), chunks[-1][1])
    n_listed, n_bytes = map(sum, zip(*chunks, strict=True)) if chunks else (0, 0)
    if n_listed != n_points or n_bytes > room:
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
