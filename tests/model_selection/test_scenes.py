"""Grid search of segmentation: whole scenes as folds, segments scored as they are."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.cluster import DBSCAN
from sklearn.model_selection import GridSearchCV
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import Pipeline

from sklearn_mcmd import MCMDOutlierDetector, RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.datasets import make_box, make_crown_roof
from sklearn_mcmd.metrics import segmentation_scores
from sklearn_mcmd.model_selection import score_segments
from sklearn_mcmd.resampling import DenoisingSampler

GRID = {"segment__max_angle": [15.0, 60.0], "normals__n_neighbors": [10, 30]}


def pipeline(**parameters):
    steps = [
        ("normals", RobustNormalEstimator(30, random_state=0)),
        ("segment", RegionGrowing(normals="precomputed", refine=False)),
    ]
    return Pipeline(steps).set_params(**parameters)


@pytest.fixture(scope="module")
def scenes():
    clouds = [make_crown_roof(1200, random_state=seed) for seed in range(2)]
    clouds.append(make_box(900, noise=0.004, random_state=2))
    X = np.vstack([cloud.data for cloud in clouds])
    y = np.hstack([cloud.surface for cloud in clouds])
    scene = np.repeat([7, 8, 9], [len(cloud.data) for cloud in clouds])
    order = np.random.RandomState(0).permutation(len(X))
    return X[order], y[order], scene[order]


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.UndefinedMetricWarning")
def test_a_search_finds_what_a_loop_over_scenes_and_candidates_finds(scenes):
    X, y, scene = scenes
    folds = [(np.flatnonzero(scene == name),) * 2 for name in (7, 8, 9)]
    search = GridSearchCV(pipeline(), GRID, scoring=score_segments, cv=folds, refit=False)
    search.fit(X, y)
    results = search.cv_results_
    for row, params in enumerate(results["params"]):
        for fold, name in enumerate((7, 8, 9)):
            rows = scene == name
            labels = pipeline(**params).fit_predict(X[rows])
            scores = segmentation_scores(y[rows], labels)
            for column in ("f_score", "mean_iou", "adjusted_rand"):
                expected = np.nan_to_num(scores[column])
                assert results[f"split{fold}_test_{column}"][row] == pytest.approx(expected)
    # The roof's faces meet at 32 to 60 degrees: grown with 60 allowed they are one.
    angles = np.array([params["segment__max_angle"] for params in results["params"]])
    means = results["mean_test_adjusted_rand"]
    assert means[angles == 60].max() < means.max() - 0.1


def test_a_fitted_estimator_is_scored_on_the_given_points_not_on_its_own(scenes):
    X, y, scene = scenes
    fitted = pipeline().fit(X[scene == 9])
    labels = fitted[-1].labels_.copy()
    rows = scene == 7
    found = score_segments(fitted, X[rows], y[rows])
    assert found == score_segments(pipeline(), X[rows], y[rows])
    assert_array_equal(fitted[-1].labels_, labels)


def test_what_nothing_segments_scores_zero_and_not_nan(scenes):
    X, y, _ = scenes
    scores = score_segments(DBSCAN(1e-6), X, y)
    assert scores["f_score"] == scores["recall"] == scores["mean_iou"] == 0.0


def test_points_that_a_sampler_dropped_count_as_of_no_segment():
    imblearn = pytest.importorskip("imblearn.pipeline")
    box = make_box(1500, outlier_share=0.1, random_state=0)
    detector = MCMDOutlierDetector(30, random_state=0)
    model = imblearn.Pipeline([("denoise", DenoisingSampler(detector)), *pipeline().steps])
    found = score_segments(model, box.data, box.surface)
    kept = detector.fit_predict(box.data) == 1
    assert not kept.all()
    labels = np.full(len(box.data), -1)
    labels[kept] = pipeline().fit_predict(box.data[kept])
    expected = segmentation_scores(box.surface, labels)
    assert found["adjusted_rand"] == pytest.approx(expected.adjusted_rand)
    assert found["mean_iou"] == pytest.approx(expected.mean_iou)


class Halving(RegionGrowing):
    def fit_predict(self, X, y=None):
        return super().fit_predict(X, y)[::2]


def test_labels_missing_without_a_reason_are_refused(scenes):
    X, y, _ = scenes
    with pytest.raises(ValueError, match=r"labels for 3300 points.*sample_indices_"):
        score_segments(Halving(random_state=0), X, y)


def test_what_is_no_clusterer_is_refused(scenes):
    X, y, _ = scenes
    with pytest.raises(TypeError, match=r"KNeighborsClassifier.* has no fit_predict"):
        score_segments(KNeighborsClassifier(), X, y)
