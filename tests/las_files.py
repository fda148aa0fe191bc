"""Points of LAS with a value in every dimension of their format."""

import numpy as np
import pytest

laspy = pytest.importorskip("laspy")
pytest.importorskip("lazrs")

VERSIONS = {**dict.fromkeys(range(4), "1.2"), 4: "1.3", 5: "1.3"}  # of point formats; then 1.4


def las_of(
    point_format=6, *, n=60, version=None, scales=0.001, offsets=0.0, extra=(), seed=0, xyz=None
):
    """laspy's points, of which `extra` are names and dtypes, or the parameters of laspy."""
    rng = np.random.default_rng(seed)
    version = version or VERSIONS.get(point_format, "1.4")
    header = laspy.LasHeader(version=version, point_format=point_format)
    header.scales, header.offsets = (np.full(3, some) for some in (scales, offsets))
    header.add_extra_dims(
        [laspy.ExtraBytesParams(*one) if isinstance(one, tuple) else one for one in extra]
    )
    las = laspy.LasData(header)
    if xyz is None:
        xyz = rng.uniform(-50, 50, (n, 3)) + header.offsets
    steps = np.rint((xyz - header.offsets) / header.scales)
    las.points = laspy.ScaleAwarePointRecord.zeros(len(xyz), header=header)
    for axis, column in zip("XYZ", steps.T, strict=True):
        las[axis] = column.astype(np.int32)  # laspy's own would refuse negative scales
    for name in sorted(set(las.point_format.dimension_names) - set("XYZ")):
        dimension = las.point_format.dimension_by_name(name)
        if dimension.kind.name == "FloatingPoint":
            las[name] = rng.normal(size=np.shape(las[name]))
        elif dimension.scales is None:
            most = min(dimension.max, 89)
            las[name] = rng.integers(0, most, np.shape(las[name]), endpoint=True)
    return las


def las_file(path, *args, **options):
    """The path of a file of `las_of`."""
    las_of(*args, **options).write(path)
    return path


def change(path, position, data):
    """Write bytes over those at a position of a file."""
    with open(path, "rb+") as file:
        file.seek(position)
        file.write(data)
    return path
