"""Results of one cell are those of memory to the last bit; of several, those that are proven."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from sklearn.base import clone

from benchmarks.simulators import make_airborne_scan
from depth_frames import turned_wall
from sklearn_mcmd import MCMDOutlierDetector, RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import read_points
from sklearn_mcmd.tiling import process_files
from sklearn_mcmd.tiling._verbs import normal_columns
from tiled import EDGES, ESTIMATOR, VERBS, but, fit_in_memory, street, values_of, written

AUTO = RobustNormalEstimator("auto", random_state=0)
SCENES = {
    "street": lambda: street(4_000),
    "airborne": lambda: make_airborne_scan(4_000, random_state=0).data,
    "copies": lambda: np.tile(np.round(make_street(1_300, random_state=0).data, 2), (3, 1)),
    "volume": lambda: np.random.default_rng(0).uniform(0, 5, (4_000, 3)),
    "lattice": lambda: np.random.default_rng(0).integers(0, 14, (4_000, 3)) * 0.25,
    "depths of a camera": lambda: turned_wall(60, 3)[0][::6],
    "plane of equal steps": lambda: np.indices((64, 64, 1)).reshape(3, -1).T * 0.1,
}
PARAMS = [
    {"method": "pca", "radius": 0.3},
    {"radius": 0.15, "reweight": False, "orientation": [1.0, 2.0, 3.0]},
    {"neighbor_planes": False, "features": "all"},
    {"tangents": False, "n_neighbors": 20},
    {"orientation": "sensor", "sensor_origin": [2.0, 2.0, 3.0]},
]


@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize("verb", [*VERBS, "auto"])
@pytest.mark.parametrize("n", [3_000, 30])
def test_one_cell_has_the_results_and_the_report_of_memory(verb, n, by_tiles, tmp_path):
    path, estimator = written(tmp_path, street(n)), VERBS.get(verb, AUTO)
    fitted = fit_in_memory(read_points(path).xyz, estimator)
    values, proven, run, report = by_tiles(path, estimator)
    assert_array_equal(values, values_of(fitted))
    assert report.n_tiles == 1
    assert report.n_proven == report.n_points == proven.sum()
    if verb == "outliers":
        n_found = np.count_nonzero(fitted.scores_ < fitted.offset_)
        assert (run.cutoff, report.n_outliers) == (-fitted.offset_, n_found)
    if verb == "regions":
        assert list(report.largest) == fitted.region_sizes_[:20].tolist()
        assert report.n_inside == np.count_nonzero(fitted.labels_ >= 0)
    if verb == "edges":
        assert (run.limit, report.n_outliers) == (fitted.offset_, (~fitted.inlier_mask_).sum())


def share_of_proven_normals_which_are_those_of_memory(by_tiles, path, estimator, tile_size):
    values, proven, _, report = by_tiles(path, estimator, tile_size=tile_size)
    assert report.n_proven == proven.sum()
    assert report.n_tiles >= report.n_points / tile_size
    fitted = fit_in_memory(read_points(path).xyz, estimator)
    expected = values_of(fitted)
    names = normal_columns(fitted)[0]
    if "normal_error" in names:  # of rows it asks four times as many neighbors, beyond the proof
        column = names.index("normal_error")
        assert np.mean(values[proven, column] != expected[proven, column]) < 0.005
        values, expected = (np.delete(one, column, axis=1) for one in (values, expected))
    assert_array_equal(values[proven], expected[proven])
    return proven.mean()


@pytest.mark.parametrize(
    ("scene", "estimator"),
    [
        *((scene, ESTIMATOR) for scene in SCENES),
        *((scene, AUTO) for scene in ("airborne", "copies")),
        *(("street", but(ESTIMATOR, **params)) for params in PARAMS),
    ],
    ids=str,
)
def test_proven_normals_are_those_of_memory(scene, estimator, by_tiles, tmp_path):
    path = written(tmp_path, SCENES[scene]())
    share = share_of_proven_normals_which_are_those_of_memory(by_tiles, path, estimator, 1_500)
    assert share > 0.9


@st.composite
def clouds(draw):
    """Faces, clusters and single points; some rounded or copied."""
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    faces = [
        np.roll(rng.uniform(0, [*rng.choice([0.3, 2.0, 5.0], 2), 0.01], (500, 3)), turn, axis=1)
        for turn in range(draw(st.integers(1, 3)))
    ]
    sizes = draw(st.tuples(st.integers(1, 900), st.integers(0, 40)))
    parts = [*faces, rng.normal(0, 1, (sizes[0], 3)), rng.uniform(-90, 90, (sizes[1], 3))]
    X = np.round(np.vstack(parts), draw(st.sampled_from([1, 2, 4])))
    return np.vstack([X, X[rng.integers(0, len(X), draw(st.integers(0, 200)))]])


@pytest.mark.slow
@given(X=clouds(), tile_size=st.integers(100, 1_200))
@settings(max_examples=20)
def test_proven_normals_of_any_cloud_are_those_of_memory(X, tile_size, by_tiles, tmp_path):
    path = written(tmp_path, X)
    share_of_proven_normals_which_are_those_of_memory(by_tiles, path, ESTIMATOR, tile_size)


@pytest.mark.parametrize("verb", ["outliers", "normals", "edges"])
def test_clouds_of_fewer_points_than_neighbors_are_warned_of_once_as_in_memory(verb, tmp_path):
    path, estimator = written(tmp_path, street(8)), clone(VERBS[verb])
    cloud = read_points(path).xyz
    for work in (estimator.fit, lambda X: process_files(path, tmp_path / "b.las", estimator)):
        with pytest.warns(UserWarning, match=r"n_neighbors=1\d is more than the num") as caught:
            work(cloud)
        assert len(caught) == 1


def test_clouds_of_which_hardly_anything_is_kept_are_refused_as_in_memory(tmp_path):
    path = written(tmp_path, street(1_500))
    cleaner = MCMDOutlierDetector(16, strictness="surfaces", cutoff=1e-9)
    detector = but(EDGES, outlier_detector=cleaner)
    with pytest.raises(ValueError, match=r"calls (\d+) of \1 points outliers"):
        process_files(path, tmp_path / "b.las", detector, tile_size=2_000)
