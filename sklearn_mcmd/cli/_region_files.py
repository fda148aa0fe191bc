"""Tables of regions as CSV and GeoJSON, in the coordinates of the cloud."""

import csv
import json
import math
import os

import numpy as np
import typer

from sklearn_mcmd.io._rehearsal import standing_in

SUFFIXES = (".csv", ".geojson", ".json")


def check_regions_file(path, catalog, *taken):
    """Raise if a table cannot be written there, or is asked of a cloud in tiles."""
    fault = None
    if path.suffix.lower() not in SUFFIXES:
        fault = f"{path}: a table of regions ends in {', '.join(SUFFIXES)}"
    elif os.path.realpath(path) in map(os.path.realpath, taken):
        fault = f"{path}: is IN or OUT as well"
    elif catalog is not None:
        fault = "is for clouds in memory, not for tiles; give more --memory, or one file"
    if fault:
        raise typer.BadParameter(fault, param_hint="--regions")
    with standing_in(path):
        pass


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
            known = not isinstance(part, float) or math.isfinite(part)
            row[f"{name}_{axis}" if axis else name] = part if known else None
    return row


def _geometry(outline):
    if outline.endswith("EMPTY"):
        return None
    ring = outline[outline.index("((") + 2 : -2].split(", ")
    corners = [[float(value) for value in corner.split()] for corner in ring]
    return {"type": "Polygon", "coordinates": [corners]}
