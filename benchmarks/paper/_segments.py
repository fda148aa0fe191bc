"""Table 6: segments of traffic furniture and of a bus stop."""

import warnings
from dataclasses import dataclass

import numpy as np
from sklearn.exceptions import UndefinedMetricWarning

from benchmarks.paper._printed import SEGMENTATION
from benchmarks.paper._report import Report, Table, paired_rows
from benchmarks.paper._runs import Steps, stream
from benchmarks.paper._scene_methods import SCENE_METHODS, quietly, runs_of, summary
from benchmarks.simulators import make_bus_stop, make_traffic_furniture
from sklearn_mcmd.metrics import segmentation_scores
from sklearn_mcmd.segmentation._estimator import RegionGrowing

N_NEIGHBORS, MIN_REGION_SIZE = 50, 10
SLOW_POINTS = 34_000  # points of a scene for RPCA and uLSIF, which take minutes each
GROWTH_ALONE = {"refine": False}
PCA_AND_DEFAULT_GROWTH = "PCA, default growth"
COLUMNS = ("TS", "PS", "OS", "US", "missed", "r %", "p %", "F %", "Rand", "IoU")


@dataclass(frozen=True)
class SceneOf:
    """One of the paper's scenes: its counterpart, its number of points, and the angle."""

    make: object
    n_points: int
    max_angle: float


SCENES = {
    "traffic furniture": SceneOf(make_traffic_furniture, 127_898, 15.0),
    "bus stop": SceneOf(make_bus_stop, 33_719, 5.0),
}


def rows_of(slow):
    """The rows of the table, name -> (method of the normals, parameters of the growth)."""
    rows = {
        name: (method, {"n_neighbors": N_NEIGHBORS, **GROWTH_ALONE})
        for name, method in SCENE_METHODS.items()
        if (slow or not method.slow) and name != "default"
    }
    rows[PCA_AND_DEFAULT_GROWTH] = (SCENE_METHODS["PCA"], {})
    rows["default"] = (SCENE_METHODS["default"], {})
    return rows


def segment(row, X, max_angle, seed):
    """Labels of the segments of a cloud."""
    method, growth = row
    columns = method.normal_estimator(N_NEIGHBORS, seed).fit_transform(X)
    growing = RegionGrowing(
        **growth, max_angle=max_angle, min_region_size=MIN_REGION_SIZE, normals="precomputed"
    )
    return growing.fit_predict(columns)


def score(surface, labels):
    """The numbers of `COLUMNS`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UndefinedMetricWarning)  # printed as nan
        scores = segmentation_scores(surface, labels)
    return (
        scores.n_segments,
        scores.proper,
        scores.over,
        scores.under,
        scores.missed,
        100 * scores.recall,
        100 * scores.precision,
        100 * scores.f_score,
        scores.adjusted_rand,
        scores.mean_iou,
    )


def table6(runs=2, *, seed=0, n_points=None, slow_points=SLOW_POINTS):
    """Table 6: segments of traffic furniture and of a bus stop, by normals of each method.

    `results` maps (scene, points, method) to segments, PS, OS, US, missed surfaces, recall,
    precision and F-score in percent, adjusted Rand index and mean IoU, (runs, 10).
    """
    plan = []
    for scene, about in SCENES.items():
        n = about.n_points if n_points is None else n_points
        plan += [(scene, n, n <= slow_points)]
        plan += [(scene, slow_points, True)] if n > slow_points else []
    steps = Steps(
        sum(runs_of(row[0], runs) for _, _, slow in plan for row in rows_of(slow).values())
    )
    results, tables = {}, []
    for scene, n, slow in plan:
        rows = rows_of(slow)
        about = SCENES[scene]
        for run in range(runs):
            cloud = about.make(n, random_state=stream(seed, scene, n, run))
            for name, row in rows.items():
                if run < runs_of(row[0], runs):
                    labels = quietly(segment, row, cloud.data, about.max_angle, seed)
                    scores = results.setdefault((scene, n, name), [])
                    scores.append(score(cloud.surface, labels))
                    steps.advance(1)
        lines = []
        for name in rows:
            scores = results[scene, n, name] = np.array(results[scene, n, name])
            lines += _table_6_rows(scene, name, scores, printed=n == about.n_points or slow)
        n_surfaces = len(np.unique(cloud.surface))
        caption = f"{scene}, {n:,} points, {n_surfaces} surfaces, {about.max_angle:g} degrees" + (
            "" if slow else "; RPCA and uLSIF are in the next table"
        )
        tables.append(Table(caption, ("method", "", "runs", *COLUMNS), lines, n_labels=2))
    notes = [
        "The scenes are simulated counterparts of scans that are not public, with as many "
        "surfaces. TS is the number of segments that hold points of a surface; a surface is "
        "properly segmented by the rule of segmentation_scores, 80 % overlap.",
        f"RPCA and uLSIF are run on one scene of at most {SLOW_POINTS:,} points; compare them with "
        "the rows of the same scene.",
        *(f"{method.name}: {method.reading}." for method in SCENE_METHODS.values()),
    ]
    title = f"Table 6: segments by normals of each method, {runs} scenes of each kind"
    return Report("table6", title, tables, notes, results)


def _table_6_rows(scene, name, scores, printed):
    digits = (1, 1, 1, 1, 1, 1, 1, 1, 3, 2)
    cells = [summary(scores[:, i], d) for i, d in enumerate(digits)]
    ours = (str(len(scores)), *cells)
    paper = SEGMENTATION[scene].get(name)
    if paper is None or not printed:
        return paired_rows(name, ours)
    counts, ratios = map(str, paper[:4]), map("{:.2f}".format, paper[4:])
    return paired_rows(name, ours, ("", *counts, "", *ratios, "", ""))
