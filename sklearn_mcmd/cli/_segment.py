"""``mcmd segment``."""

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import sklearn_mcmd
from sklearn_mcmd.cli import _files, _options
from sklearn_mcmd.cli._cloud_verb import CloudVerb, command_of, counts, tiles_row
from sklearn_mcmd.cli._messages import number_and_share
from sklearn_mcmd.cli._region_files import check_regions_file, write_regions
from sklearn_mcmd.io._files import replacing
from sklearn_mcmd.io._point_cloud import has_colors, with_results

__all__ = ["segment"]

LARGEST_SHOWN = 3


@dataclass
class Segment(CloudVerb):
    """Divide a cloud into surfaces: road, kerb and footpath, walls, signs, poles.

    All points are kept. New attributes are region (int32; 0 is the largest, -1 is none) and red,
    green and blue (8 bits, one color for each region). Denoise a cloud with outliers first.
    """

    max_angle: Annotated[
        float,
        _options.number_option(
            "Largest angle between normals of neighbors, in degrees, up to 90.",
            expected="a number above 0 and up to 90",
            fits=lambda angle: 0 < angle <= 90,
        ),
    ] = 15.0
    max_distance: Annotated[
        float | None,
        _options.length_option(
            "Largest distance of a neighbor from a point's plane, in units of the file.",
            "by the scatter of each neighborhood",
        ),
    ] = None
    max_gap: Annotated[
        float | None,
        _options.length_option(
            "Largest distance of a neighbor, in units of the file.",
            "by the spacing of each neighborhood",
        ),
    ] = None
    min_region_size: Annotated[
        int, typer.Option(min=1, help="Regions with fewer points are dissolved.")
    ] = 10
    refine: Annotated[
        bool,
        typer.Option(
            help="Whether to refine the paper's growth: narrow faces such as kerbs, division at "
            "blunt creases, joining of parts of planes and cylinders, and the points left over."
        ),
    ] = True
    colors: Annotated[
        bool | None,
        _options.colors_option(
            "Whether to write colors: one for each region, gray for points of none."
        ),
    ] = None
    regions: Annotated[
        Path | None,
        typer.Option(
            help="Also write a table of the regions, .csv or .geojson: kind, plane or cylinder, "
            "outline, area, dip, standard errors. Of clouds in memory.",
            show_default=False,
        ),
    ] = None
    n_neighbors: _options.NNeighbors = 50
    growth_neighbors: Annotated[
        int,
        typer.Option(
            min=4,
            help="Points in a neighborhood for growth. Regions grow to the nearer half of them.",
        ),
    ] = 30
    max_outlier_rate: _options.MaxOutlierRate = 0.5
    random_state: _options.RandomState = 0
    n_jobs: _options.NJobs = -1

    work = "regions"

    def check(self, catalog):
        check_regions_file(self.regions, catalog, self.source, self.target)

    def outputs(self):
        return [self.target] if self.regions is None else [self.target, self.regions]

    def estimator(self):
        normals = self.made(sklearn_mcmd.RobustNormalEstimator)
        own = {"n_neighbors": self.growth_neighbors, "normal_estimator": normals}
        return self.made(sklearn_mcmd.RegionGrowing, **own)

    def in_memory(self):
        cloud = self.read("regions")
        colors = not has_colors(cloud) if self.colors is None else self.colors
        _files.rehearse(self.target, _segmented(cloud, np.zeros(len(cloud), np.int64), colors))
        if self.regions is not None:
            with _files.standing_in(self.regions):
                pass
        with _files.working(self.source):
            fitted = self.estimator().fit(_files.coordinates(cloud))
        n_inside, sizes = np.count_nonzero(fitted.labels_ >= 0), fitted.region_sizes_
        told = counts(len(cloud), n_regions=len(sizes), n_inside=n_inside, largest=sizes)
        with ExitStack() as stack:  # no file is replaced before both are on the disk
            if self.regions is not None:
                temporary = stack.enter_context(replacing(self.regions))
                with _files.naming(self.regions):
                    write_regions(temporary, fitted.regions_)
            _files.write(self.target, _segmented(cloud, fitted.labels_, colors))
        return told, lambda: _contents(cloud, fitted, n_inside)

    def tile_options(self):
        return {"colors": self.colors}

    def rows(self, told):
        return tiles_row(told) | {
            "regions": f"{told.n_regions:,}",
            "inside": number_and_share(told.n_inside, told.n_points),
            "largest": ", ".join(f"{size:,}" for size in told.largest[:LARGEST_SHOWN]) or "none",
        }

    def tile_contents(self, catalog, told):
        from sklearn_mcmd.report._regions_page import Regions, segment_contents

        shown = self.shown(catalog, told, "region")
        regions = Regions.of_sample(shown.cloud, told.largest)
        return segment_contents(shown, regions, told.n_regions, told.n_inside)


segment = command_of(Segment)


def _contents(cloud, fitted, n_inside):
    from sklearn_mcmd.report._regions_page import Regions, segment_contents
    from sklearn_mcmd.report._shown import Shown

    planes, labels = fitted.normal_estimator_, fitted.labels_
    n_neighbors = int(np.median(planes.n_neighbors_))
    shown = Shown.of_memory(cloud, n_neighbors, planes.plane_scale_, region=labels.astype(np.int32))
    regions = Regions(
        fitted.region_sizes_, fitted.region_normals_, fitted.region_centroids_,
        fitted.region_errors_,
    )  # fmt: skip
    return segment_contents(shown, regions, fitted.n_regions_, n_inside)


def _segmented(cloud, labels, colors):
    """The cloud to write."""
    from sklearn_mcmd.plotting._still import region_columns

    return with_results(cloud, region_columns(labels, colors))
