"""LAS and LAZ in parts: files that are larger than memory are read and written piece by piece."""

from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.io._las import cloud_of_points, header_of, parts_of, writing_parts

__all__ = ["read_parts", "writing_parts"]


def read_parts(path, n_points):
    """The clouds of successive points of a LAS, LAZ or COPC file, as of `read_las`.

    A part has `n_points` at most, but of a compressed file at least one of its chunks.
    """
    with one_clear_line(path, "read"), open(path, "rb") as file:
        header = header_of(path, file)
        for points in parts_of(file, header, n_points):
            yield cloud_of_points(points, header)
