"""``mcmd segment``."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import typer

import sklearn_mcmd
from sklearn_mcmd.cli import _options
from sklearn_mcmd.cli._cloud_verb import BY_TILES, CloudVerb, tiles_row
from sklearn_mcmd.cli._files import Output
from sklearn_mcmd.cli._messages import number_and_share
from sklearn_mcmd.cli._options import command_of, length, made, option
from sklearn_mcmd.io._files import replacing
from sklearn_mcmd.io._region_files import SUFFIXES, write_regions
from sklearn_mcmd.io._rehearsal import standing_in
from sklearn_mcmd.planes._resolution import in_own_precision

LARGEST_SHOWN = 3  # regions in the summary


@dataclass
class Segment(CloudVerb):
    """All points are kept. New attributes are region (int32; 0 is the largest, -1 is none) and red,
    green and blue (8 bits, one color for each region). Denoise a cloud with outliers first.
    """

    max_angle: float = option(
        15.0, "Largest angle between normals of neighbors, in degrees, up to 90."
    )
    max_distance: float | None = length(
        None,
        "Largest distance of a neighbor from a point's plane.",
        show_default="by the scatter of each neighborhood",
    )
    max_gap: float | None = length(
        None, "Largest distance of a neighbor.", show_default="by the spacing of each neighborhood"
    )
    min_region_size: int = option(10, "Regions with fewer points are dissolved.", min=1)
    refine: bool = option(
        True,
        "Whether to refine the paper's growth: narrow faces such as kerbs, division at blunt "
        "creases, joining of parts of planes and cylinders, and the points left over.",
    )
    colors: bool | None = option(
        None,
        "Whether to write colors: one for each region, gray for points of none.",
        show_default="unless IN has colors",
    )
    regions: Path | None = option(
        None,
        "Also write a table of the regions, .csv or .geojson: kind, plane or cylinder, outline, "
        "area, dip, standard errors.",
    )
    n_neighbors: _options.NNeighbors = 50
    growth_neighbors: int = option(
        30, "Points in a neighborhood for growth. Regions grow to the nearer half of them.", min=4
    )
    max_outlier_rate: _options.MaxOutlierRate = 0.5

    results = "regions"

    def check_options(self, catalog):
        if self.regions is not None:
            check_regions_file(self.regions, self.source, self.target)

    def estimator(self):
        normals = made(self, sklearn_mcmd.RobustNormalEstimator)
        growth = {"n_neighbors": self.growth_neighbors, "normal_estimator": normals}
        return made(self, sklearn_mcmd.RegionGrowing, **growth)

    def find(self, cloud, growing):
        labels = growing.fit(in_own_precision(cloud.xyz)).labels_
        sizes = growing.region_sizes_
        return {
            "growing": growing,
            "n_regions": len(sizes),
            "n_inside": np.count_nonzero(labels >= 0),
            "largest": sizes,
        }

    def written(self, cloud, outcome=None):
        from sklearn_mcmd.plotting._still import with_regions

        labels = np.zeros(len(cloud), np.int64) if outcome is None else outcome.growing.labels_
        return Output(with_regions(cloud, labels, self.colors))

    def write(self, cloud, outcome):
        if self.regions is None:
            super().write(cloud, outcome)
            return
        with replacing(self.regions) as temporary:  # no file is replaced before both are written
            write_regions(temporary, outcome.growing.regions_)
            super().write(cloud, outcome)

    def tile_options(self):
        return super().tile_options() | {"regions": self.regions}

    def rows(self, outcome):
        return tiles_row(outcome) | {
            "regions": f"{outcome.n_regions:,}",
            "inside": number_and_share(outcome.n_inside, outcome.n_points),
            "largest": ", ".join(f"{size:,}" for size in outcome.largest[:LARGEST_SHOWN]) or "none",
        }

    def contents(self, cloud, outcome):
        from sklearn_mcmd.report._pages import segment_contents
        from sklearn_mcmd.report._shown import Shown

        growing, planes = outcome.growing, outcome.growing.normal_estimator_
        n_neighbors = int(np.median(planes.n_neighbors_))
        region = growing.labels_.astype(np.int32)
        shown = Shown.of_memory(cloud, n_neighbors, planes.plane_scale_, region=region)
        return segment_contents(shown, outcome.largest, outcome.n_regions, outcome.n_inside)

    def tile_contents(self, catalog, run):
        from sklearn_mcmd.report._pages import segment_contents

        shown = self.shown(catalog, run, ["region"])
        return segment_contents(shown, run.largest, run.n_regions, run.n_inside)


segment = command_of(Segment, more=BY_TILES)


def check_regions_file(path, *taken):
    """Raise if a table cannot be written there."""
    fault = None
    if path.suffix.lower() not in SUFFIXES:
        fault = f"{path}: a table of regions ends in {', '.join(SUFFIXES)}"
    elif os.path.realpath(path) in map(os.path.realpath, taken):
        fault = f"{path}: is IN or OUT as well"
    if fault:
        raise typer.BadParameter(fault, param_hint="--regions")
    with standing_in(path):
        pass
