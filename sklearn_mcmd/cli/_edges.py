"""``mcmd edges``."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import typer

import sklearn_mcmd
from sklearn_mcmd._choices import Criterion
from sklearn_mcmd.cli import _files, _options
from sklearn_mcmd.cli._cloud_verb import CloudVerb, command_of, counts, tiles_row
from sklearn_mcmd.cli._messages import number_and_share
from sklearn_mcmd.io._point_cloud import has_colors, with_results

__all__ = ["edges"]


@dataclass
class Edges(CloudVerb):
    """Mark edges and corners: points next to a line where two faces meet.

    All points are kept. New attributes are edge (1 or 0, 8 bits) and edge_score (float32: the
    distance to the nearest crease in spacings, at most 20, or the criterion's value). If the input
    has no colors, or with --colors, also red, green and blue.
    """

    n_neighbors: _options.NNeighbors = 40
    criterion: Annotated[
        Criterion,
        typer.Option(
            help="crease: the distance to the line where two faces meet. eigenvalue, "
            "surface_variation, removed_fraction: how much the neighborhood differs from a plane."
        ),
    ] = "crease"
    threshold: Annotated[
        float | None,
        _options.number_option(
            "Limit of an edge: the largest distance to a crease, in spacings of the points, "
            "or the least value of another criterion.",
            "2; for the others median + 3 robust standard deviations",
        ),
    ] = None
    min_angle: Annotated[
        float, typer.Option(min=1.0, max=89.0, help="Least angle of a crease, in degrees.")
    ] = 20.0
    denoise: Annotated[
        bool, typer.Option(help="Whether outliers are removed before edges are searched.")
    ] = True
    colors: Annotated[
        bool | None, _options.colors_option("Whether to write colors: edges red, surfaces gray.")
    ] = None
    random_state: _options.RandomState = 0
    n_jobs: _options.NJobs = -1

    work = "edges"

    def estimator(self):
        detector = None if self.denoise else "passthrough"
        return self.made(sklearn_mcmd.SharpFeatureDetector, outlier_detector=detector)

    def in_memory(self):
        from sklearn_mcmd.plotting._still import edge_columns

        cloud = self.read("edges")
        colors = not has_colors(cloud) if self.colors is None else self.colors
        nothing = _files.blank(cloud)
        blank = edge_columns(nothing > 0, nothing, colors)
        _files.rehearse(self.target, with_results(cloud, blank))
        with _files.working(self.source):
            detector = self.estimator().fit(_files.coordinates(cloud))
        is_edge, score = _verdict(detector)
        told = counts(len(cloud), n_edges=np.count_nonzero(is_edge))
        _files.write(self.target, with_results(cloud, edge_columns(is_edge, score, colors)))
        return told, lambda: _contents(cloud, detector)

    def tile_options(self):
        return {"colors": self.colors}

    def rows(self, told):
        return tiles_row(told) | {"edges": number_and_share(told.n_edges, told.n_points)}

    def tile_contents(self, catalog, told):
        from sklearn_mcmd.edges._detector import crease_width
        from sklearn_mcmd.report._edges_page import edges_contents

        shown = self.shown(catalog, told, "edge", "edge_score")
        limit = crease_width(self.estimator()) if self.criterion == "crease" else None
        return edges_contents(shown, self.criterion, told.n_edges, limit, [])


edges = command_of(Edges, without={"unit"})  # it has no option that is a length


def _verdict(detector):
    """Whether each point belongs to an edge, and its distance or the criterion's value."""
    scores = detector.scores_
    return scores < detector.offset_, scores if detector.criterion == "crease" else -scores


def _contents(cloud, detector):
    from sklearn_mcmd.report._edges_page import edges_contents
    from sklearn_mcmd.report._shown import Shown

    is_edge, score = _verdict(detector)
    scales = getattr(detector.normal_estimator_, "plane_scale_", None)
    results = {"edge": is_edge.astype(np.uint8), "edge_score": score.astype(np.float32)}
    shown = Shown.of_memory(cloud, detector.n_neighbors, scales, **results)
    limit = float(detector.offset_ if detector.criterion == "crease" else -detector.offset_)
    n_outliers = np.count_nonzero(~detector.inlier_mask_)
    cards = [(f"{n_outliers:,}", "outliers that were left out")]
    return edges_contents(shown, detector.criterion, np.count_nonzero(is_edge), limit, cards)
