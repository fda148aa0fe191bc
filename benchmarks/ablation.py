"""What does each rule and each constant gain? Rules are switched off, constants are scaled.

`PARTS` holds the parts of the package. Each names its constants, its rules, and the clouds for the
trials. One change is made at a time. The program prints the points of 100 that it gains on each
cloud with a truth, or loses (-), and the number of regions in real clouds.

    python benchmarks/ablation.py growing --size 20000 --seeds 2 --data ../shared/data
    python benchmarks/ablation.py normals --size 20000 --seeds 1 --data ../shared/data
    python benchmarks/ablation.py sizes --seeds 1 --data ../shared/data
    python benchmarks/ablation.py edges --seeds 3 --data ../shared/data
    python benchmarks/ablation.py detector --data ../shared/data
    python benchmarks/ablation.py rays --seeds 1 --data ../shared/data

The detector is measured by what it keeps of real points, what it finds of outliers (TPR), the
average precision of its score (AP) and the share of right labels, on streets and on real clouds
into which outliers were put.

A limit is changed in its record, for all who make one.
"""

import argparse
import functools
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from _ablation_changes import FACTORS, Limit, Step
from _ablation_clouds import (
    contaminated,
    edge_distances,
    labelled,
    machined_edges,
    machined_parts,
    ridges,
    seen,
    shapes,
    simulated,
    streets,
    true_normals,
)
from sklearn.metrics import average_precision_score

from sklearn_mcmd.segmentation._estimator import GrowthSteps


@dataclass(frozen=True)
class Part:
    """What is tried: constants and steps, on clouds, by what measures.

    scenes : (options) -> name, points and truth of each cloud with a truth; means are taken over
        the parts of a "name/part" and over clouds of the same name
    prepare : (X) -> what `run` takes; slow steps before the part, done once a cloud
    run : (prepared) -> result
    measure : (truth, result) -> dict of numbers, 100 being perfect
    clouds : names of real clouds without a truth
    count : (result) -> number to print for these
    most : points of these, the nearest to the middle
    """

    tried: tuple
    scenes: Callable
    prepare: Callable
    run: Callable
    measure: Callable
    clouds: tuple = ()
    count: Callable = len
    most: int | None = None


def columns_of(X):
    from sklearn_mcmd import RobustNormalEstimator

    return RobustNormalEstimator(random_state=0).fit_transform(X)


def regions_of(columns):
    from sklearn_mcmd import RegionGrowing

    return RegionGrowing(normals="precomputed").fit_predict(columns)


def region_scores(surface, labels):
    from sklearn_mcmd.metrics import segmentation_scores

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # undefined ratios are nan
        scores = segmentation_scores(surface, labels)
    return {"Rand": 100 * scores.adjusted_rand, "IoU": 100 * scores.mean_iou}


def normals_of(X, **parameters):
    from sklearn_mcmd import RobustNormalEstimator

    return RobustNormalEstimator(random_state=0, n_jobs=-1, **parameters).fit(X).normals_


def normal_scores(truth, normals):
    """Shares within 10 degrees of the true normal: of all regular points, and near edges."""
    true, near, regular = truth
    cosines = np.minimum(np.abs(np.einsum("nd,nd->n", normals, true)), 1.0)
    right = np.degrees(np.arccos(cosines)) <= 10
    near = near & regular
    return {"all": 100 * right[regular].mean(), "near": 100 * right[near].mean()}


def faces_of(X):
    """Columns of the points that the detector of edges keeps; others have coordinates alone."""
    from sklearn_mcmd import SharpFeatureDetector
    from sklearn_mcmd.edges._detector import steps_of

    cleaner, normals = steps_of(SharpFeatureDetector(random_state=0))
    kept = cleaner.fit_predict(X) == 1
    columns = normals.fit_transform(X[kept])
    with_columns = np.full((len(X), columns.shape[1]), np.nan)
    with_columns[:, :3], with_columns[kept] = X, columns
    return with_columns


def edge_scores_of(columns):
    """Scores of points, and which are edges'."""
    from sklearn_mcmd import SharpFeatureDetector

    kept, scores = np.isfinite(columns).all(axis=1), np.empty(len(columns))
    detector = SharpFeatureDetector(
        outlier_detector="passthrough", normals="precomputed", n_jobs=-1
    ).fit(columns[kept])
    scores[kept] = detector.scores_
    scores[~kept] = detector._model.distance(columns[~kept, :3])
    return scores, scores < detector.offset_


def edge_figures(truth, result):
    """F1 of the band of two spacings, and average precision of the score."""
    (distance, spacing), (scores, flagged) = truth, result
    regular = np.isfinite(distance)
    edge, flagged = distance[regular] <= 2 * spacing, flagged[regular]
    f1 = 200 * np.count_nonzero(flagged & edge) / (flagged.sum() + edge.sum())
    return {"F1": f1, "AP": 100 * average_precision_score(edge, -scores[regular])}


def judged(X):
    """Scores of points, which may be followed by positions of the sensor; and which are flagged."""
    from sklearn_mcmd import MCMDOutlierDetector

    positions = X[:, 3:] if X.shape[1] > 3 else None
    points = np.ascontiguousarray(X[:, :3])
    detector = MCMDOutlierDetector(random_state=0, n_jobs=-1).fit(points, sensor_origin=positions)
    return -detector.scores_, detector.labels_ == -1


def seen_scores(outlier, result):
    flagged = result[1]
    share = 100 * flagged[outlier].mean() if outlier.any() else np.nan
    return {"kept": 100 * (~flagged[~outlier]).mean(), "TPR": share}


def outlier_scores(outlier, result):
    scores, flagged = result
    return {
        **seen_scores(outlier, result),
        "AP": 100 * average_precision_score(outlier, scores),
        "right": 100 * (flagged == outlier).mean(),
    }


PARTS = {
    "growing": Part(
        tried=(
            Limit("planes._around", "NoiseLimits", "n_errors", np.inf),
            Limit("planes._explaining", "ExplainLimits", "explained"),
            Limit("segmentation._graph", "GrowthLimits", "usual", 0.0),
            Limit("segmentation._graph", "GrowthLimits", "bent", 0.0),
            Limit("segmentation._graph", "GrowthLimits", "n_deviations"),
            Limit("segmentation._region_division", "VoteLimits", "blunt", 0.0),
            Limit("segmentation._merge_coplanar", "JoinLimits", "most_noise", np.inf),
            Limit("segmentation._merge_coplanar", "JoinLimits", "most_gap", 1e9),
            Limit("segmentation._narrow_faces", "NarrowFaceLimits", "reach", np.inf),
            Limit("segmentation._cylinder_parts", "CylinderLimits", "growth"),
            Limit("segmentation._cylinder_parts", "CylinderLimits", "least_size", 6),
            Limit("segmentation._cylinder_parts", "FitLimits", "n_steps"),
            Limit("segmentation._cylinder_parts", "FitLimits", "least_gain"),
            *map(Step, GrowthSteps._fields),
        ),
        scenes=lambda options: chain(
            simulated(options, lambda scene: scene.surface, 0.0), labelled(options)
        ),
        prepare=columns_of,
        run=regions_of,
        measure=region_scores,
        clouds=("pcl_building_region_growing", "ahn3_amsterdam_2397", "open3d_redwood_fragment"),
        count=lambda labels: int(labels.max()) + 1,
        most=30_000,
    ),
    "normals": Part(
        tried=(
            Limit("normals._surface_planes", "MendLimits", "removed", 1.0),
            Limit("planes._quadrics", "QuadricLimits", "chance"),
            Limit("planes._around", "NoiseLimits", "n_errors", np.inf),
            Limit("normals._surface_planes", "MendLimits", "quiet"),
            Limit("normals._surface_planes", "MendLimits", "half_ball", np.inf),
            Limit("planes._explaining", "ExplainLimits", "explained", np.inf),
            Limit("normals._surface_planes", "PatchLimits", "patch"),
            Limit("planes._quadrics", "FoldLimits", "evidence", np.inf),
            Limit("planes._quadrics", "FoldLimits", "best", 1.0, most=1.0),
            Limit("planes._quadrics", "FoldLimits", "off"),
            Limit("planes._quadrics", "SmoothnessLimits", "curved", 0.0),
            Limit("planes._quadrics", "SmoothnessLimits", "n_errors", 0.0),
            Limit("planes._quadrics", "QuadricLimits", "pivot", 0.0),
            Limit("planes._rules", "ReweightLimits", "cutoff"),
            Limit("planes._agreement", "AgreementLimits", "passes", 0),
            Limit("planes._agreement", "AgreementLimits", "face", np.inf),
            Limit("planes._principal_planes", "RowLimits", "width", 0.0),
        ),
        scenes=lambda options: chain(
            simulated(options, true_normals, 0.1), machined_parts(options)
        ),
        prepare=lambda X: X,
        run=normals_of,
        measure=normal_scores,
    ),
    "sizes": Part(
        tried=(
            Limit("normals._adaptive_k", "SizeLimits", "tilt"),
            Limit("normals._adaptive_k", "SizeLimits", "least"),
            Limit("normals._adaptive_k", "SizeLimits", "most"),
            Limit("normals._adaptive_k", "SizeLimits", "quiet", most=0.99),
            Limit("normals._adaptive_k", "SizeLimits", "around"),
            Limit("planes._quadrics", "QuadricLimits", "chance", 0.0),
        ),
        scenes=lambda options: chain(
            simulated(options, true_normals, 0.1), machined_parts(options), shapes(options)
        ),
        prepare=lambda X: X,
        run=functools.partial(normals_of, n_neighbors="auto"),
        measure=normal_scores,
    ),
    "edges": Part(
        tried=(
            Limit("planes._explaining", "ExplainLimits", "explained", np.inf),
            Limit("edges._crease_distance", "FaceLimits", "n_spacing", 10_000),
            Limit("edges._crease_distance", "FaceLimits", "least_noise", 1e-6),
            Limit("edges._crease_distance", "FaceLimits", "flat", np.inf),
            Limit("edges._crease_distance", "CreaseLimits", "far"),
            Limit("edges._crease_distance", "CreaseLimits", "evening_steps", 0),
            Limit("edges._crease_distance", "CreaseLimits", "radii", (1e9,)),
            Limit("edges._crease_distance", "CreaseLimits", "smooth_steps", 1),
            Limit("edges._crease_distance", "CreaseLimits", "huber", np.inf),
            Limit("edges._detector", "EdgeLimits", "width"),
        ),
        scenes=lambda options: chain(
            simulated(options, edge_distances, 0.1), machined_edges(options), ridges(options)
        ),
        prepare=faces_of,
        run=edge_scores_of,
        measure=edge_figures,
    ),
    "detector": Part(
        tried=(
            Limit("planes._explaining", "ExplainLimits", "explained"),
            Limit("planes._agreement", "AgreementLimits", "passes", 0),
            Limit("outliers._surfaces", "SurfaceLimits", "flat", off=np.inf),
            Limit("outliers._surfaces", "SurfaceLimits", "angle", off=180.0),
            Limit("outliers._surfaces", "SurfaceLimits", "n_links"),
            Limit("outliers._surfaces", "SurfaceLimits", "least_share", 1.0, most=1.0),
            Limit("outliers._groups", "ShapeLimits", "thin", off=0.0),
            *(
                Limit("outliers._off_surface", "OffSurfaceLimits", name, off, most)
                for name, off, most in (
                    ("n_near", None, np.inf),
                    ("n_usual", None, np.inf),
                    ("usual", None, 0.99),
                    ("half", None, 0.99),
                    ("reach", 0.0, np.inf),
                    ("rest_weight", 0.0, 1.0),
                    ("thing", 0.0, np.inf),
                )
            ),
        ),
        scenes=lambda options: chain(streets(options), contaminated(options)),
        prepare=lambda X: X,
        run=judged,
        measure=outlier_scores,
    ),
    "rays": Part(
        tried=tuple(
            Limit("sensors._rays", "RayLimits", name)
            for name in ("n_beams", "searched", "usual", "alone", "sheet")
        ),
        scenes=seen,
        prepare=lambda X: X,
        run=judged,
        measure=seen_scores,
    ),
}


def scenes_of(part, options):
    """Name, prepared cloud and truth of each scene."""
    for name, X, truth in part.scenes(options):
        yield name.partition("/")[0], part.prepare(X), truth


def clouds_of(part, options):
    """Name and prepared cloud of each real cloud that is there."""
    for name in part.clouds:
        path = Path(options.data) / name / "cloud.npz"
        if path.is_file():
            X = np.load(path)["xyz"].astype(np.float64)
            away = np.square(X - np.median(X, axis=0)).sum(axis=1)
            X = X[np.sort(np.argsort(away)[: part.most])]
            yield name, part.prepare(X)


def evaluate(part, scenes, clouds):
    """Means over the seeds, (measure, scene) -> number; and counts of real clouds."""
    by_scene = {}
    for name, prepared, truth in scenes:
        for measure, value in part.measure(truth, part.run(prepared)).items():
            by_scene.setdefault((measure, name), []).append(value)
    counts = [part.count(part.run(prepared)) for _, prepared in clouds]
    return {key: float(np.mean(values)) for key, values in by_scene.items()}, counts


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", choices=list(PARTS))
    parser.add_argument("--size", type=int, default=20_000, help="points of a scene")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--data", default="../shared/data", help="folder of real clouds")
    parser.add_argument("--only", help="try only what has this in its name")
    parser.add_argument("--factors", type=float, nargs="+", default=FACTORS)
    options = parser.parse_args(arguments)
    part = PARTS[options.part]
    scenes, clouds = list(scenes_of(part, options)), list(clouds_of(part, options))
    default, counts = evaluate(part, scenes, clouds)
    names = list(dict.fromkeys(name for name, _, _ in scenes))
    for (measure, name), value in default.items():
        print(f"default: {name:20} {measure:6} {value:7.2f}")
    measures = list(dict.fromkeys(measure for measure, _ in default))
    print(f"\npoints gained (lost: -), by scene, for {' and '.join(measures)}")
    width = 7 * len(measures)
    head = "".join(f"{name[:10]:>{width}}" for name in names)
    print(f"{'':40}{head}  " + "  ".join(name[:8] for name, _ in clouds))
    print(f"{'default':40}{'':{width * len(names)}}  " + "  ".join(f"{c:8}" for c in counts))
    for tried in part.tried:
        if options.only and options.only not in str(tried):
            continue
        for label, context in tried.variants(options.factors):
            with context():
                values, counts = evaluate(part, scenes, clouds)
            gained = [values[m, name] - default[m, name] for name in names for m in measures]
            row = "".join(f"{g:7.2f}" for g in gained)
            print(
                f"{tried!s:30}{label:10}{row}  " + "  ".join(f"{c:8}" for c in counts), flush=True
            )


if __name__ == "__main__":
    main()
