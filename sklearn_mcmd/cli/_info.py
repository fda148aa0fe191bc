"""``mcmd info``: the contents of point files."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from sklearn_mcmd._errors import counted
from sklearn_mcmd.cli._files import files_of, read
from sklearn_mcmd.cli._messages import clear_exits, print_table
from sklearn_mcmd.cli._options import Columns
from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._formats import supported_extensions
from sklearn_mcmd.io._sensor import place_words, stated_positions

TELLING = {"pcd_viewpoint", "sensor_origins"}  # of formats that may tell the sensor


def info(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="IN",
            help=f"Point file ({' '.join(supported_extensions())}), or a folder or .vpc index.",
        ),
    ],
    columns: Columns = None,
) -> None:
    """Of a folder or an index, each file has one line, and a line tells of all together."""
    with clear_exits():
        paths = files_of(source)
        if paths == [source]:
            print_table(str(source), **summarize(source, read(source, columns=columns)))
            return
        rows, errors = summarize_each(paths, lambda path: read(path, columns=columns))
        print_table(str(source), **rows)
        if errors:
            raise PointFileError("; ".join(errors))


def summarize(source, cloud):
    """Names and values of the table that `mcmd info` prints."""
    from sklearn_mcmd.report._facts import Facts

    rows, header = {"format": source.suffix[1:].upper()}, cloud.metadata.get("las_header")
    if header is not None:
        rows["format"] += f" {header.version}, point format {header.point_format.id}"
    rows |= Facts.of(cloud.xyz).rows(cloud)
    del rows["attributes"]  # which follow
    if TELLING & cloud.metadata.keys():
        positions, words, _ = stated_positions(cloud)
        stated = positions is not None and f"stated: {place_words(positions, words)}"
        rows["sensor"] = stated or f"not known: {words}"
    constant = []
    for name, values in cloud.attributes.items():
        if values.dtype.kind not in "biuf":
            rows[f"- {name}"] = str(values.dtype)
            continue
        numbers = values[np.isfinite(values)]
        if numbers.size == 0:
            constant.append(f"{name} nan")
            continue
        low, high, is_whole = numbers.min(), numbers.max(), numbers.size == values.size
        if low == high and is_whole:
            constant.append(f"{name} {low:g}")
            continue
        shape = f" x {values.shape[1]}" if values.ndim == 2 else ""
        missing = "" if is_whole else ", some without a value"
        rows[f"- {name}"] = f"{values.dtype}{shape}, {low:.6g} to {high:.6g}{missing}"
    if constant:
        rows["constant"] = ", ".join(constant)
    return rows


def summarize_each(paths, read):
    """A row for each file and one for all of them, and the errors of those that `read` refuses."""
    from sklearn_mcmd.report._facts import bounds_rows

    rows, errors, bounds, n_points = {}, [], [], 0
    for path in paths:
        try:
            cloud = read(path)
        except PointFileError as err:
            rows[path.name] = "cannot be read"
            errors.append(str(err))
            continue
        told = summarize(path, cloud)
        facts = [
            f"{name} {told[name].partition(' (')[0]}" for name in ("spacing", "CRS") if name in told
        ]
        bounds += [cloud.xyz.min(axis=0), cloud.xyz.max(axis=0)]
        n_points += len(cloud)
        extent = " x ".join(f"{length:.4g}" for length in bounds[-1] - bounds[-2])
        rows[path.name] = ", ".join([counted(len(cloud), "point"), extent, *facts])
    rows["all"] = f"{counted(n_points, 'point')} of {counted(len(bounds) // 2, 'file')}"
    if bounds:
        ranges = bounds_rows(np.min(bounds, axis=0), np.max(bounds, axis=0))
        rows["all"] += "".join(f", {axis} {words}" for axis, words in ranges.items())
    return rows, errors
