"""The table of regions as CSV or GeoJSON."""

import csv
import json
import math

import numpy as np

SUFFIXES = (".csv", ".geojson", ".json")


def write_regions(path, table):
    """Write the `regions_` of a `RegionGrowing`."""
    rows = [_row(number, region) for number, region in enumerate(table)]
    if path.suffix.lower() == ".csv":
        with open(path, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(_row(0, np.zeros(1, table.dtype)[0]))
            writer.writerows(row.values() for row in rows)
        return
    features = [
        {"type": "Feature", "geometry": _geometry(row.pop("outline")), "properties": row}
        for row in rows
    ]
    text = json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def _row(number, region):
    """Names and values of a line; vectors have a value for each axis, None is what has no value."""
    row = {"region": number}
    for name in region.dtype.names:
        value = region[name].tolist() if hasattr(region[name], "tolist") else region[name]
        parts = zip("xyz", value, strict=True) if isinstance(value, list) else [("", value)]
        for axis, part in parts:
            has_value = not isinstance(part, float) or math.isfinite(part)
            row[f"{name}_{axis}" if axis else name] = part if has_value else None
    return row


def _geometry(outline):
    if outline.endswith("EMPTY"):
        return None
    ring = outline[outline.index("((") + 2 : -2].split(", ")
    corners = [[float(value) for value in corner.split()] for corner in ring]
    return {"type": "Polygon", "coordinates": [corners]}
