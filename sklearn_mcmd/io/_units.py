"""The unit of coordinates, where the file tells it."""

import re

__all__ = ["length_unit"]

METERS = {1.0: "m", 0.3048: "ft", 0.3048006: "US ft"}
GEOTIFF = {9001: "m", 9002: "ft", 9003: "US ft"}
PLANE_UNIT, HEIGHT_UNIT = 3076, 4099  # GeoTIFF's keys
# In WKT of version 2, parts with a unit that need not be that of coordinates.
PARTS = re.compile(r"\b(?:ELLIPSOID|PARAMETER)\[[^\[\]]*(?:\[[^\[\]]*\][^\[\]]*)*\]")
UNIT = re.compile(r'\b(?:LENGTH)?UNIT\["(?!degree|grad|gon|rad)[^"]*", *(\d+\.?\d*)', re.IGNORECASE)


def length_unit(cloud):
    """``"m"``, ``"ft"`` or ``"US ft"`` if the file says that all axes have it, else None.

    LAS tells by its coordinate system, if that is projected. E57 and PTX are always in meters.
    """
    if "sensor_origins" in cloud.metadata:
        return "m"
    header = cloud.metadata.get("las_header")
    found, keys = set(), {}
    for record in [] if header is None else [*header.vlrs, *(header.evlrs or [])]:
        wkt = getattr(record, "string", "")
        if "PROJ" in wkt:
            factors = UNIT.findall(PARTS.sub("", wkt))
            found |= {METERS.get(round(float(factor), 7)) for factor in factors}
        keys |= {key.id: key.value_offset for key in getattr(record, "geo_keys", ())}
    if PLANE_UNIT in keys:
        found |= {GEOTIFF.get(keys[key]) for key in (PLANE_UNIT, HEIGHT_UNIT) if key in keys}
    return found.pop() if len(found) == 1 else None
