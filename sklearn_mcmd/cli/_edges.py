"""``mcmd edges``."""

from dataclasses import dataclass

import numpy as np

import sklearn_mcmd
from sklearn_mcmd._choices import Criterion
from sklearn_mcmd.cli import _options
from sklearn_mcmd.cli._cloud_verb import BY_TILES, CloudVerb, tiles_row
from sklearn_mcmd.cli._files import Output
from sklearn_mcmd.cli._messages import number_and_share
from sklearn_mcmd.cli._options import command_of, made, option
from sklearn_mcmd.planes._resolution import in_own_precision


@dataclass
class Edges(CloudVerb):
    """All points are kept. New attributes are edge (1 or 0, 8 bits) and edge_score (float32: the
    distance to the nearest crease in spacings, at most 20, or the criterion's value). If the input
    has no colors, or with --colors, also red, green and blue.
    """

    n_neighbors: _options.NNeighbors = 40
    criterion: Criterion = option(
        "crease",
        "crease: the distance to the line where two faces meet. eigenvalue, surface_variation: "
        "how much the neighborhood differs from a plane.",
    )
    threshold: float | None = option(
        None,
        "Limit of an edge: the largest distance to a crease, in spacings of the points, or the "
        "least value of another criterion.",
        show_default="2; for the others median + 3 robust standard deviations",
    )
    min_angle: float = option(20.0, "Least angle of a crease, in degrees.")
    denoise: bool = option(True, "Whether outliers are removed before edges are searched.")
    colors: bool | None = option(
        None,
        "Whether to write colors: edges red, surfaces gray.",
        show_default="unless IN has colors",
    )

    results = "edges"

    def estimator(self):
        detector = None if self.denoise else "passthrough"
        return made(self, sklearn_mcmd.SharpFeatureDetector, outlier_detector=detector)

    def find(self, cloud, detector):
        scores = detector.fit(in_own_precision(cloud.xyz)).scores_
        is_edge = scores < detector.offset_
        return {
            "detector": detector,
            "is_edge": is_edge,
            "score": scores if detector.criterion == "crease" else -scores,
            "n_edges": np.count_nonzero(is_edge),
        }

    def written(self, cloud, outcome=None):
        from sklearn_mcmd.plotting._still import with_edges

        is_edge, score = np.zeros(len(cloud), bool), np.zeros(len(cloud), np.float32)
        if outcome is not None:
            is_edge, score = outcome.is_edge, outcome.score
        return Output(with_edges(cloud, is_edge, score, self.colors))

    def rows(self, outcome):
        return tiles_row(outcome) | {"edges": number_and_share(outcome.n_edges, outcome.n_points)}

    def contents(self, cloud, outcome):
        from sklearn_mcmd.plotting._still import edge_columns
        from sklearn_mcmd.report._pages import edges_contents
        from sklearn_mcmd.report._shown import Shown

        detector = outcome.detector
        scales = getattr(detector.normal_estimator_, "plane_scale_", None)
        results = edge_columns(outcome.is_edge, outcome.score)
        shown = Shown.of_memory(cloud, detector.n_neighbors, scales, **results)
        limit = float(detector.offset_ if detector.criterion == "crease" else -detector.offset_)
        n_outliers = np.count_nonzero(~detector.inlier_mask_)
        others = [("outliers that were left out", f"{n_outliers:,}")]
        return edges_contents(shown, detector.criterion, outcome.n_edges, limit, others)

    def tile_contents(self, catalog, run):
        from sklearn_mcmd.edges._detector import crease_width
        from sklearn_mcmd.report._pages import edges_contents

        shown = self.shown(catalog, run, ["edge", "edge_score"])
        limit = crease_width(self.estimator()) if self.criterion == "crease" else None
        return edges_contents(shown, self.criterion, run.n_edges, limit, [])


edges = command_of(Edges, without={"unit"}, more=BY_TILES)  # it has no option that is a length
