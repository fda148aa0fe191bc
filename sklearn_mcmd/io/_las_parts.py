"""LAS and LAZ in parts: files that are larger than memory are read and written piece by piece."""

from contextlib import contextmanager, suppress
from functools import cache
from hashlib import sha256

from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.io._las import (
    cloud_of_points,
    header_of,
    import_laspy,
    las_of_cloud,
    parts_of,
    read_header,
)
from sklearn_mcmd.io._las_structure import order_bounds
from sklearn_mcmd.io._laz import WAVE_PACKET_FORMATS, compressed_parts
from sklearn_mcmd.io._no_returns import NoReturns
from sklearn_mcmd.io._point_cloud import PointFileError
from sklearn_mcmd.io._waveforms import place_waveforms

__all__ = ["no_returns_of", "read_parts", "writing_parts"]

POINTS_A_TIME = 250_000


def read_parts(path, n_points):
    """The clouds of successive points of a LAS, LAZ or COPC file, as of `read_las`.

    A part has `n_points` at most, but of a compressed file at least one of its chunks.
    """
    some = no_returns_of(path).n_left_out
    for cloud in _all_parts(path, n_points):
        cloud = cloud.subset(cloud.xyz.any(axis=1)) if some else cloud
        if len(cloud):
            yield cloud


def no_returns_of(path):
    """The `NoReturns` of a file whose bounds hold 0, 0, 0; of no points otherwise."""
    with one_clear_line(path, "read"):
        status = path.stat()
    return _no_returns(path, status.st_size, status.st_mtime_ns)


@cache
def _no_returns(path, _size, _time):
    with one_clear_line(path, "read"):
        header, found = read_header(path), NoReturns()
    if (header.mins <= 0).all() and (header.maxs >= 0).all():
        for cloud in _all_parts(path, POINTS_A_TIME):
            found.add(cloud.xyz)
    return found


def _all_parts(path, n_points):
    with one_clear_line(path, "read"), open(path, "rb") as file:
        header = header_of(path, file)
        for points in parts_of(file, header, n_points):
            yield cloud_of_points(points, header)


@contextmanager
def writing_parts(path):
    """A function that appends the points of a cloud to a new LAS or LAZ file.

    It takes a cloud, and which of its points to mark as noise, as `write_points` does. All clouds
    must come from one file, in its order, with the same new attributes.
    """
    compressed = path.name.lower().endswith(".laz")
    laspy = import_laspy(compressed)
    writer, header, written = None, None, sha256()
    with open(path, "wb+") as file:
        sink = _Sink(file)

        def write(cloud, noise=None):
            nonlocal writer, header
            las = las_of_cloud(laspy, cloud, noise)
            with sink.telling():
                if writer is None:
                    header = las.header
                    backend = laspy.LazBackend.LazrsParallel if compressed else None
                    writer = laspy.open(
                        sink, "w", header=header, laz_backend=backend, closefd=False
                    )
                if las.point_format != writer.header.point_format:
                    raise PointFileError(
                        "an attribute fits its dimension in a part of the file only"
                    )
                writer.write_points(las.points)
                if header.point_format.id in WAVE_PACKET_FORMATS:
                    written.update(las.points.array.data)

        try:
            yield write
        except BaseException:
            if writer is not None:
                with suppress(Exception):  # the first error counts
                    writer.close()
            raise
        with sink.telling():
            if header.version.minor >= 4 and header.evlrs is not None:
                writer.write_evlrs(header.evlrs)
            writer.close()
    if compressed and header.point_format.id in WAVE_PACKET_FORMATS:
        _refuse_changed(path, written)
    order_bounds(path)
    place_waveforms(path, header)


def _refuse_changed(path, written):
    """Raise if the points of a LAZ are not those that were written."""
    stored = sha256()
    with open(path, "rb") as file:
        for points in compressed_parts(file, read_header(path), POINTS_A_TIME):
            stored.update(points.data)
    if stored.digest() != written.digest():
        raise PointFileError(
            "lazrs cannot compress these wave packets without loss, as of several scanner "
            "channels; write .las instead"
        )


class _Sink:
    """A file for lazrs, which turns every error of Python's code into one of its own."""

    def __init__(self, file):
        self.file, self.error = file, None

    def __getattr__(self, name):
        return getattr(self.file, name)

    def write(self, data):
        try:
            return self.file.write(data)
        except BaseException as err:
            self.error = err
            raise

    @contextmanager
    def telling(self):
        """Raise the error of the file in the place of what lazrs made of it."""
        try:
            yield
        except BaseException as err:
            if self.error is not None and err is not self.error:
                raise self.error from err
            raise
