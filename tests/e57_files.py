"""E57 files, written by pye57."""

import pytest

pye57 = pytest.importorskip("pye57")


def write_scans(path, *scans):
    """The path of a file of scans: coordinates (n, 3), other fields, and what pye57 takes."""
    with pye57.E57(str(path), mode="w") as file:
        for xyz, fields, options in scans:
            points = {f"cartesian{axis}": xyz[:, i].astype(float) for i, axis in enumerate("XYZ")}
            file.write_scan_raw(points | fields, **options)
    return path
