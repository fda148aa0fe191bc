"""Results by tiles are those of memory to the last bit, wherever tiles begin."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from sklearn.base import clone

from benchmarks.simulators import (
    make_airborne_scan,
    make_bus_stop,
    make_lidar_turn,
    make_mobile_scan,
)
from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.datasets import make_box, make_crown_roof, make_street
from sklearn_mcmd.io import read_points
from sklearn_mcmd.tiling import process_files
from tiled import columns_of, fit_in_memory, written

RNG = np.random.default_rng(0)
VERBS = {
    "outliers": MCMDOutlierDetector(16, random_state=0),
    "normals": RobustNormalEstimator(16, random_state=0),
    "auto": RobustNormalEstimator("auto", random_state=0),
    "regions": RegionGrowing(
        20, normal_estimator=RobustNormalEstimator(24, random_state=0), max_angle=8
    ),
    "edges": SharpFeatureDetector(12, random_state=0),
}


@cache
def street_with_tree(n=1_700, seed=0):
    return make_street(n, outlier_share=0.05, tree=True, random_state=seed).data


def with_copies():
    X = np.round(street_with_tree(), 2)
    return np.vstack([X, X[:600], X[:600], X[-40:]])


def far_apart():
    X = street_with_tree().copy()
    X[850:, 0] += 1e4
    far = RNG.uniform(-1e5, 1e5, (15, 3))
    ghost = RNG.normal([0, 0, 2_000], 0.1, (30, 3))
    return np.vstack([X, far, ghost])


def noisy_floor(n=2_000):
    """Two levels, noisy enough for a hundred neighbors, and a smooth part for few."""
    X = RNG.uniform(0, 4, (n, 3)) * [1, 1, 0]
    X[:, 2] = RNG.normal(0, np.where(X[:, 0] < 2, 0.05, 0.005))
    X[: n // 5, 2] += 3
    return X


def blunt_gable():
    X = np.random.default_rng(0).uniform(-1, 1, (1_900, 3))
    X[:, 2] *= 0.01
    X[:, 2] -= 0.18 * np.abs(X[:, 0])
    return X


def machined():
    """A block with a slot, whose faces meet inward and outward, with displaced points."""
    rng = np.random.default_rng(2)
    box = make_box(2_000, random_state=2).data
    low, high = box.min(axis=0), box.max(axis=0)
    inside = (np.abs((box - low) / (high - low) - [0.5, 0.5, 1.0]) < [0.6, 0.2, 0.4]).all(axis=1)
    box[inside, 2] -= 0.4 * (high - low)[2]
    moved = rng.choice(len(box), 200, replace=False)
    box[moved] += rng.normal(0, 0.05, (200, 3)) * (high - low)
    return box


SCENES = {
    "street": street_with_tree,
    "airborne": lambda: make_airborne_scan(1_700, random_state=0).data,
    "turn": lambda: (turn := make_lidar_turn(2_000, random_state=0).data)[turn.any(axis=1)],
    "copies": with_copies,
    "far apart": far_apart,
    "volume": lambda: RNG.uniform(0, 5, (2_000, 3)),
    "floor": noisy_floor,
    "lattice": lambda: np.unique(RNG.integers(0, 12, (1_900, 3)), axis=0) * 0.25,
    "single precision": lambda: np.unique(np.round(8 * street_with_tree()) / 8, axis=0),
    "sparse beside dense": lambda: np.vstack(
        [street_with_tree(1_100), street_with_tree(1_100, seed=1) / 30]
    ),
    "plane of equal steps": lambda: np.indices((48, 48, 1)).reshape(3, -1).T * 0.1,
    "blunt gable": blunt_gable,
    "bus stop": lambda: make_bus_stop(2_000, random_state=0).data,
    "crown roof": lambda: make_crown_roof(1_900, random_state=0).data,
    "machined": machined,
}
# Of each estimator, the scenes that the fast tests try; the slow ones try all.
FAST = {
    "outliers": {"street", "turn", "copies", "far apart", "volume", "lattice"},
    "normals": {"street", "sparse beside dense", "single precision"},
    "auto": {"floor", "copies", "far apart"},
    "regions": {"blunt gable", "copies", "far apart", "crown roof", "plane of equal steps"},
    "edges": {"machined", "copies"},
}


def assert_equal_by_tiles(by_tiles, path, estimator, **options):
    """All results, the limit of scores, and what is reported; returns the report."""
    fitted = fit_in_memory(read_points(path).xyz, estimator)
    values, verb, report = by_tiles(path, estimator, **options)
    if isinstance(estimator, RobustNormalEstimator):
        assert_array_equal(values, columns_of(fitted)[1].T)
        return report
    if isinstance(estimator, RegionGrowing):
        assert_array_equal(values[:, 0], fitted.labels_)
        assert report.n_regions == fitted.n_regions_
        assert report.n_inside == (fitted.labels_ >= 0).sum()
        assert list(report.largest) == fitted.region_sizes_[:20].tolist()
        return report
    n_found = (fitted.scores_ < fitted.offset_).sum()
    if isinstance(estimator, MCMDOutlierDetector):
        assert_array_equal(values[:, 0], -fitted.scores_)
        assert (verb.cutoff, report.n_outliers) == (-fitted.offset_, n_found)
    else:
        assert_array_equal(values[:, 0], fitted.scores_)
        assert (verb.limit, report.n_edges) == (fitted.offset_, n_found)
        assert report.n_outliers == (~fitted.inlier_mask_).sum()
        assert report.removed_fraction == (~fitted.inlier_mask_).mean()
    return report


@pytest.mark.parametrize(
    ("verb", "scene"),
    [
        pytest.param(verb, scene, marks=[] if scene in FAST[verb] else pytest.mark.slow)
        for verb in VERBS
        for scene in SCENES
    ],
)
def test_results_are_those_of_memory_wherever_tiles_begin(verb, scene, by_tiles, tmp_path):
    path = written(tmp_path, SCENES[scene]())
    one_tile = scene in ("copies", "lattice") and verb != "regions"
    for tile_size in (700, *[10_000] * one_tile):
        report = assert_equal_by_tiles(by_tiles, path, VERBS[verb], tile_size=tile_size)
        assert report.n_tiles >= report.n_points / tile_size


NORMALS = "normal_estimator"
PARAMETERS = [
    ("outliers", "street", {"strictness": "isolated"}),
    ("outliers", "street", {"strictness": "surfaces"}),
    ("outliers", "volume", {"strictness": "surfaces"}),
    ("outliers", "street", {"strictness": None}),
    ("outliers", "street", {"noise_scale": 0.02, "n_neighbors": 40}),
    ("outliers", "street", {"reweight": False, "support_fraction": 0.7, "n_neighbors": 6}),
    ("outliers", "copies", {"contamination": 0.07}),
    ("outliers", "copies", {"false_positive_rate": 0.02}),
    ("outliers", "lattice", {"strictness": None, "false_positive_rate": 0.02}),
    ("normals", "copies", {"neighbor_planes": False, "features": "mean_curvature"}),
    ("normals", "street", {"reweight": False, "radius": 0.15, "orientation": "mst"}),
    ("normals", "street", {"method": "pca"}),
    ("normals", "street", {"radius": 0.1, "orientation": [1.0, 2.0, 3.0]}),
    ("normals", "copies", {"n_neighbors": 8, "orientation": "mst", "reweight": False}),
    ("normals", "street", {"method": "mcmd_md", "n_neighbors": 20, "tangents": False}),
    ("normals", "street", {"radius": 0.2, "features": ["roughness", "max_curvature_direction"]}),
    ("normals", "street", {"orientation": "sensor", "sensor_origin": [2.0, 2.0, 3.0]}),
    ("auto", "floor", {"method": "pca", "radius": 0.3}),
    ("auto", "floor", {"reweight": False, "features": ["normal_error"], "orientation": "mst"}),
    ("regions", "street", {f"{NORMALS}__n_neighbors": "auto", f"{NORMALS}__orientation": "mst"}),
    ("regions", "street", {"max_gap": 0.15}),
    ("regions", "crown roof", {"refine": False}),
    ("regions", "copies", {"refine": False}),
    ("regions", "street", {"refine": False, "max_distance": 0.02, "max_gap": 0.2}),
    ("regions", "street", {"min_region_size": 1, "n_neighbors": 30}),
    ("regions", "street", {f"{NORMALS}__neighbor_planes": False}),
    ("edges", "street", {"outlier_detector": "passthrough"}),
    ("edges", "copies", {"outlier_detector": MCMDOutlierDetector(16, contamination=0.1)}),
    ("edges", "street", {NORMALS: RobustNormalEstimator("auto", orientation="mst")}),
    ("edges", "copies", {"criterion": "eigenvalue"}),
    ("edges", "street", {"criterion": "removed_fraction"}),
    (
        *("edges", "street"),
        {
            **{"criterion": "eigenvalue", "threshold": "mean", "outlier_detector": "passthrough"},
            NORMALS: RobustNormalEstimator(12, reweight=False),
        },
    ),
]


@pytest.mark.parametrize(
    ("verb", "scene", "params"),
    [
        pytest.param(*row, marks=[pytest.mark.slow] if row[1] == "copies" else [])
        for row in PARAMETERS
    ],
    ids=str,
)
def test_results_are_those_of_memory_for_all_parameters(verb, scene, params, by_tiles, tmp_path):
    path = written(tmp_path, SCENES[scene]())
    estimator = clone(VERBS[verb]).set_params(**params)
    assert_equal_by_tiles(by_tiles, path, estimator, tile_size=900)


@st.composite
def clouds(draw):
    """More than a thousand places: faces, clusters, single points; some rounded or copied."""
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    n_volume, n_far = draw(st.integers(1, 600)), draw(st.integers(0, 40))
    faces = []
    for _ in range(draw(st.integers(1, 3))):
        size = rng.choice([0.3, 2.0, 5.0], 2)
        face = rng.uniform(0, 1, (500, 3)) * [*size, 0] + rng.normal(0, 0.01, (500, 3))
        faces.append(np.roll(face, rng.integers(3), axis=1) + rng.integers(0, 3, 3))
    parts = [*faces, rng.normal(0, 1, (n_volume + 600, 3)), rng.uniform(-90, 90, (n_far, 3))]
    X = np.round(np.vstack(parts), draw(st.sampled_from([1, 2, 4])))
    return np.vstack([X, X[rng.integers(0, len(X), draw(st.integers(0, 200)))]])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.* outliers lie together")
@pytest.mark.parametrize("verb", VERBS)
@given(X=clouds(), tile_size=st.integers(200, 1_200))
@settings(max_examples=4)
def test_results_of_any_cloud_are_those_of_memory(verb, X, tile_size, by_tiles, tmp_path):
    path = written(tmp_path, X)
    assert_equal_by_tiles(by_tiles, path, VERBS[verb], tile_size=tile_size)


@pytest.mark.parametrize("verb", VERBS)
def test_clouds_of_few_places_have_the_results_of_memory(verb, by_tiles, tmp_path):
    for n in (900, 30):
        path = written(tmp_path, street_with_tree()[:n])
        assert_equal_by_tiles(by_tiles, path, VERBS[verb], tile_size=200)


def test_edges_of_few_points_warn_of_what_was_asked_for_alone_as_in_memory(tmp_path):
    X = np.random.default_rng(0).uniform(size=(5, 3)).round(3)
    path, detector = written(tmp_path, X), SharpFeatureDetector(random_state=0)
    with pytest.warns(UserWarning, match="n_neighbors=40 is more than the number") as in_memory:
        detector.fit(X)
    with pytest.warns(UserWarning, match="n_neighbors=40 is more than the number") as by_tiles:
        process_files(path, tmp_path / "b.las", detector)
    assert len(in_memory) == len(by_tiles) == 1


def test_clouds_of_which_hardly_anything_is_kept_are_refused_as_in_memory(tmp_path):
    path = written(tmp_path, street_with_tree(1_500))
    cleaner = MCMDOutlierDetector(16, strictness="surfaces", cutoff=1e-9)
    detector = clone(VERBS["edges"]).set_params(outlier_detector=cleaner)
    with pytest.raises(ValueError, match=r"calls (\d+) of \1 points outliers"):
        process_files(path, tmp_path / "b.las", detector, tile_size=500)
    with pytest.raises(ValueError, match=r"calls (\d+) of \1 points outliers"):
        fit_in_memory(read_points(path).xyz, detector)


@pytest.mark.parametrize("n", [40, 10])
def test_normals_agree_along_the_tree_of_memory_where_costs_are_equal(n, by_tiles, tmp_path):
    side = np.indices((n, n, 1)).reshape(3, -1).T.astype(float)
    faces = [np.roll(side, turn, axis=1) + shift for turn in range(3) for shift in (0, 1000)]
    xyz = np.random.default_rng(0).permutation(np.vstack([*faces, side[:9]]) / 8)
    estimator = RobustNormalEstimator(16, orientation="mst", random_state=0)
    path, tile_size = written(tmp_path, xyz), len(xyz) // 4
    report = assert_equal_by_tiles(by_tiles, path, estimator, tile_size=tile_size)
    assert report.n_tiles > 4


@pytest.mark.slow
@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("make", [make_mobile_scan, make_airborne_scan])
def test_many_points_have_the_results_of_memory(make, verb, by_tiles, tmp_path):
    path = written(tmp_path, np.round(make(20_000, random_state=1).data, 3))
    assert_equal_by_tiles(by_tiles, path, VERBS[verb], tile_size=2_500, n_jobs=2)
