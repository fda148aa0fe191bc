"""LAS and LAZ in parts: files that are larger than memory are read piece by piece."""

from functools import cache

from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.io._las import cloud_of_points, header_of, parts_of, read_header
from sklearn_mcmd.io._no_returns import NoReturns

POINTS_A_TIME = 250_000  # that are read to look for rays without a return


def read_parts(path, n_points):
    """The clouds of successive points of a LAS, LAZ or COPC file, as of `read_las`."""
    has_no_returns = no_returns_of(path).n_left_out > 0
    for cloud in _all_parts(path, n_points):
        if has_no_returns:
            cloud = cloud.subset(cloud.xyz.any(axis=1))
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
        header, no_returns = read_header(path), NoReturns()
    if (header.mins <= 0).all() and (header.maxs >= 0).all():
        for cloud in _all_parts(path, POINTS_A_TIME):
            no_returns.add(cloud.xyz)
    return no_returns


def _all_parts(path, n_points):
    with one_clear_line(path, "read"), open(path, "rb") as file:
        header = header_of(path, file)
        for points in parts_of(file, header, n_points):
            yield cloud_of_points(points, header)
