"""The unit of coordinates, where the file tells it, and degrees beside other units."""

import re
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.io._point_cloud import SETUPS

METERS = {1.0: "m", 0.3048: "ft", 0.3048006: "US ft"}  # units by their length
GEOTIFF = {9001: "m", 9002: "ft", 9003: "US ft"}  # units by GeoTIFF's code
PLANE_UNIT, HEIGHT_UNIT = 3076, 4099  # GeoTIFF's keys
MODEL, GEOGRAPHIC, PROJECTED = 1024, 2048, 3072  # the first is 2 for geographic systems
# WKT of a geographic system, and names of columns of degrees.
GEOGRAPHIC_WKT = re.compile(r"(?!.*(?:PROJ|GEOCCS|Cartesian)).*\bGEO[GD]", re.DOTALL)
DEGREES = re.compile(r"(?<![a-z])(lon|long|longitude|lng|lat|latitude)(?![a-z])", re.IGNORECASE)
SAMPLE = 10_000  # points whose extents are looked at
# In WKT of version 2, parts with a unit that need not be that of coordinates.
PARTS = re.compile(r"\b(?:ELLIPSOID|PARAMETER)\[[^\[\]]*(?:\[[^\[\]]*\][^\[\]]*)*\]")
UNIT = re.compile(r'\b(?:LENGTH)?UNIT\["(?!degree|grad|gon|rad)[^"]*", *(\d+\.?\d*)', re.IGNORECASE)


class DegreeLimits(NamedTuple):
    """Which extents are of degrees beside heights of another unit."""

    # Times that heights reach farther than x and y. Of meters beside degrees, all terrain does that
    # does not rise by less than 0.002 of its width; of one unit, only a wire that hangs down.
    steep: float = 200.0


def length_unit(cloud):
    """``"m"``, ``"ft"`` or ``"US ft"`` if the file says that all axes have it, else None.

    LAS tells by its coordinate system, if that is projected. E57 and PTX are always in meters.
    """
    if SETUPS in cloud.metadata:
        return "m"
    units, (wkts, keys) = set(), system_of(cloud.metadata.get("las_header"))
    for wkt in wkts:
        if "PROJ" in wkt:
            factors = UNIT.findall(PARTS.sub("", wkt))
            units |= {METERS.get(round(float(factor), 7)) for factor in factors}
    if PLANE_UNIT in keys:
        units |= {GEOTIFF.get(keys[key]) for key in (PLANE_UNIT, HEIGHT_UNIT) if key in keys}
    return units.pop() if len(units) == 1 else None


@np.errstate(over="ignore", invalid="ignore")
def degrees_warning(path, xyz, header=None, columns=None):
    """What to warn of where x and y are degrees and z is not, or None.

    The coordinate system of a LAS header tells, or the names of `columns`, which are as of
    `read_points`; else the extents of most of the points (n, 3), or of their bounds.
    """
    low, high = np.quantile(xyz[:: len(xyz) // SAMPLE + 1], [0.01, 0.99], axis=0)
    wkts, keys = system_of(header)
    named = [str(name) for name in (columns or {}).values() if DEGREES.search(str(name))]
    extent_x, extent_y, height = np.subtract(high, low)
    if not (np.sort(np.abs([low, high]).max(axis=0)[:2]) <= (90, 360)).all():
        return None
    if any(map(GEOGRAPHIC_WKT.match, wkts)) or (
        GEOGRAPHIC in keys and PROJECTED not in keys and keys.get(MODEL, 2) == 2
    ):
        reason = "its coordinate system is geographic"
    elif named:
        reason = f"they are {' and '.join(named)}"
    elif not (wkts or keys) and height > DegreeLimits().steep * max(extent_x, extent_y) > 0:
        reason = "heights reach so much farther"
    else:
        return None
    return (
        f"{path}: x and y seem to be degrees and heights are not ({reason}): distances mean "
        "nothing; project the cloud first, for example to UTM"
    )


def system_of(header):
    """What a LAS header tells of its coordinate system: texts in WKT, and GeoTIFF's keys."""
    records = [] if header is None else [*header.vlrs, *(header.evlrs or [])]
    wkts = [record.string for record in records if getattr(record, "string", "")]
    keys = [key for record in records for key in getattr(record, "geo_keys", ())]
    return wkts, {key.id: key.value_offset for key in keys}
