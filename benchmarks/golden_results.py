"""Results for twelve clouds, saved before a change of the code and compared after it.

    python benchmarks/golden_results.py keep before.npz [--data shared/data]
    python benchmarks/golden_results.py compare before.npz [--data shared/data]
    python benchmarks/golden_results.py compare before.npz --against after.npz

If a change only moves code, every result must be equal to the last bit. ``compare`` prints one
line for each result that differs: the share of equal values, of values equal within a millionth,
and the largest difference. With ``--most-differ`` it fails where a larger share of a result is not
equal within a millionth: other versions of libraries round differently, and a rule that decides
by such a number then turns the other way.
"""

import argparse
from pathlib import Path

import numpy as np
from simulators import make_bus_stop, make_traffic_furniture

from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.datasets import (
    make_box,
    make_contaminated_plane,
    make_crown_roof,
    make_street,
)

MOST_POINTS = 6_000
REAL = (
    "ahn3_amsterdam_2397",
    "cad_angle_block",
    "jakarto_scanlines",
    "laspy_plane_patch",
    "pcl_building_region_growing",
    "pcl_cars_mincut",
)


def clouds(data):
    """Name and coordinates of each cloud, in a fixed order."""
    n = MOST_POINTS
    yield "box", make_box(n, outlier_share=0.1, random_state=0).data
    yield "bus stop", make_bus_stop(n, outlier_share=0.1, random_state=0).data
    yield "plane", make_contaminated_plane(2_000, random_state=0)[0]
    yield "roof", make_crown_roof(n, outlier_share=0.1, random_state=0).data
    yield "street", make_street(n, outlier_share=0.1, random_state=0).data
    yield "furniture", make_traffic_furniture(n, outlier_share=0.1, random_state=0).data
    for name in REAL:
        path = Path(data) / name / "cloud.npz"
        if path.is_file():
            yield name, np.load(path)["xyz"][:MOST_POINTS]


def results(X):
    """Name and array of each result of a cloud."""
    detector = MCMDOutlierDetector(random_state=0, n_jobs=2).fit(X)
    yield "outlier scores", detector.scores_
    yield "outlier plane", detector.plane_index_
    probe = X[::7] + 0.01 * (X[:1] - X[::7])
    yield "new scores", detector.score_samples(probe)
    literal = MCMDOutlierDetector(reweight=False, strictness=None, random_state=0, n_jobs=2)
    yield "literal scores", literal.fit(X).scores_
    normals = RobustNormalEstimator(random_state=0, n_jobs=2)
    columns = normals.fit_transform(X)
    yield "normals", normals.normals_
    yield "normal errors", normals.normal_error_
    yield "eigenvalues", normals.eigenvalues_
    yield "new normals", normals.transform(probe)
    growing = RegionGrowing(normals="precomputed", n_jobs=2).fit(columns)
    yield "regions", growing.labels_
    edges = SharpFeatureDetector(
        outlier_detector="passthrough", normal_estimator=normals, random_state=0, n_jobs=2
    )
    yield "edge scores", edges.fit(X).scores_
    yield from options(X)


def options(X):
    """The same of what is not the default."""
    for params in (
        {"strictness": "isolated"},
        {"strictness": "surfaces", "noise_scale": 0.01},
        {"method": "mcmd_md", "n_neighbors": 20},
        {"false_positive_rate": 0.05},
    ):
        detector = MCMDOutlierDetector(**{"random_state": 0, "n_jobs": 2, **params}).fit(X)
        yield f"outlier scores {params}", detector.scores_
    above = X.mean(axis=0) + np.array([0.0, 0.0, np.ptp(X)])
    along = above + (X - above) * np.array([0.5, 0.0, 0.0])
    for name, origin in {"a position": above, "positions": along}.items():
        detector = MCMDOutlierDetector(random_state=0, n_jobs=2).fit(X, sensor_origin=origin)
        yield f"outlier scores with {name}", detector.scores_
    for params in (
        {"n_neighbors": "auto"},
        {"orientation": "mst", "features": "all"},
        {"neighbor_planes": False, "radius": float(0.1 * np.ptp(X))},
        {"method": "pca"},
    ):
        normals = RobustNormalEstimator(**{"random_state": 0, "n_jobs": 2, **params})
        yield f"columns {params}", normals.fit_transform(X)
    yield "regions of points", RegionGrowing(random_state=0, n_jobs=2).fit(X).labels_
    for criterion in ("crease", "surface_variation"):
        edges = SharpFeatureDetector(criterion=criterion, random_state=0, n_jobs=2)
        yield f"edge scores by {criterion}", edges.fit(X).scores_


def main():
    """Keep or compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("action", choices=["keep", "compare"])
    parser.add_argument("file")
    parser.add_argument("--data", default="../shared/data")
    parser.add_argument("--against", help="a file of results, in place of computing them")
    parser.add_argument("--most-differ", type=float, default=np.inf, help="a share, such as 0.01")
    options = parser.parse_args()
    results_now = np.load(options.against) if options.against else dict(computed(options.data))
    if options.action == "keep":
        np.savez_compressed(options.file, **results_now)
        return
    before, n_equal, differing = np.load(options.file), 0, []
    for name, array in results_now.items():
        old = before[name]
        same = np.mean((old == array) | (np.isnan(old) & np.isnan(array)))
        differing.append(1 - np.mean(np.isclose(old, array, rtol=1e-6, atol=1e-9, equal_nan=True)))
        n_equal += same == 1
        if same < 1:
            print(
                f"{name:60} equal {same:8.3%}  within a millionth {1 - differing[-1]:8.3%}  "
                f"largest difference {np.nanmax(abs(old - array)):.3g}"
            )
    print(
        f"{n_equal} of {len(results_now)} results equal to the last bit; within a millionth, "
        f"{1 - np.mean(differing):.3%} of the values, and {1 - max(differing):.3%} in the worst"
    )
    if max(differing) > options.most_differ:
        raise SystemExit(f"more than {options.most_differ:.1%} of a result differ")


def computed(data):
    """The name and the values of each result of each cloud."""
    for cloud, X in clouds(data):
        for name, array in results(X):
            yield f"{cloud}: {name}", array


if __name__ == "__main__":
    main()
