"""Edges: against truth where it is known, by hand where a formula says."""

import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.base import clone
from sklearn.cluster import DBSCAN
from sklearn.metrics import f1_score, roc_auc_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from sklearn_mcmd import MCMDOutlierDetector, RobustNormalEstimator, SharpFeatureDetector
from sklearn_mcmd.datasets import make_box, make_crown_roof, make_street

CRITERIA = ["crease", "eigenvalue", "surface_variation"]


def fast(**parameters):
    """Without cleaning, which most tests do not need."""
    return SharpFeatureDetector(
        **{"outlier_detector": "passthrough", "random_state": 0, **parameters}
    )


def ridge(angle, n=1500, noise=0.002, seed=0):
    """Two faces that meet in the line x = z = 0, folded by an angle in degrees."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-0.5, 0.5, (2, n))
    slope = np.tan(np.radians(angle / 2))
    points = np.column_stack([x, y, -slope * np.abs(x)])
    return points + rng.normal(0, noise, (n, 3)), np.abs(x) / np.cos(np.radians(angle / 2))


@pytest.fixture(scope="module")
def box():
    return make_box(2000, random_state=0)


@pytest.fixture(scope="module")
def fitted(box):
    return fast().fit(box.data)


# --- Against the truth ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "options"), [(make_box, {}), (make_box, {"noise": 0}), (make_crown_roof, {})]
)
def test_edges_of_the_papers_shapes_are_found(make, options):
    cloud = make(random_state=0, **options)
    detector = fast().fit(cloud.data)
    edge = cloud.edge_distance <= 2 * cloud.spacing
    # .95 to .97 when measured with noise; one seed each.
    assert f1_score(edge, detector.predict(cloud.data) == -1) > 0.92
    assert roc_auc_score(edge, -detector.score_samples(cloud.data)) > 0.99


def test_edges_are_found_among_outliers():
    cloud = make_box(outlier_share=1 / 6, random_state=0)
    labels = SharpFeatureDetector(random_state=0).fit_predict(cloud.data)
    edge = cloud.edge_distance <= 2 * cloud.spacing
    assert f1_score(edge, labels == -1) > 0.88


def test_folds_of_less_than_the_least_angle_are_no_edges():
    points, _ = ridge(30)
    assert (fast(min_angle=45).fit_predict(points) == 1).all()


@pytest.mark.parametrize("radius", [0.3, 1.0])
def test_a_cylinder_or_sphere_has_no_edges(radius):
    rng = np.random.default_rng(0)
    angle, height = rng.uniform(0, np.pi, 2000), rng.uniform(0, 1, 2000)
    cylinder = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
    sphere = rng.normal(size=(2000, 3))
    sphere *= radius / np.linalg.norm(sphere, axis=1, keepdims=True)
    for surface in (cylinder, sphere):
        points = surface + rng.normal(0, 0.002, surface.shape)
        assert (fast().fit_predict(points) == -1).mean() < 0.02


def test_foliage_has_hardly_any_edges():
    street = make_street(20_000, outlier_share=0, tree=True, random_state=0)
    labels = fast().fit_predict(street.data)
    foliage = street.surface == street.surface_names.index("foliage")
    assert foliage.sum() > 1000
    # .027 when measured, of three seeds .03: leaves that lie in planes by chance.
    assert (labels[foliage] == -1).mean() < 0.06


def test_leaves_of_a_real_street_are_no_edges_and_its_kerb_is_one(shared_data):
    """.45 of the leaves without surfaces around. The kerb is what is found of the road."""
    with np.load(shared_data / "mobile_street_labelled" / "cloud.npz") as arrays:
        X, classes = arrays["xyz"], arrays["label"]
    on_edge = SharpFeatureDetector(random_state=0).fit_predict(X) == -1
    assert on_edge[classes == 1300].mean() < 0.09
    assert on_edge[classes == 1203].mean() > 0.03


def test_another_seed_changes_few_edges_of_a_town(shared_data):
    """5.4 % of the 2,800 when measured, 9.8 with as many trials as normals have."""
    with np.load(shared_data / "ahn3_amsterdam_2397" / "cloud.npz") as arrays:
        X = arrays["xyz"]
    X = X[np.argsort(X[:, 0])[:15_000]]
    first, second = (SharpFeatureDetector(random_state=s).fit_predict(X) == -1 for s in (0, 1))
    assert (first != second).sum() < 0.08 * (first | second).sum()


# --- Invariance -------------------------------------------------------------------------------


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_fit_predict_equals_predict_and_scores_are_kept(criterion, dtype):
    cloud = make_box(1200, outlier_share=0.1, random_state=0).data
    # Copies, of members and of what the cleaning removes, count once in the fitted cloud.
    cloud = np.vstack([cloud, cloud[::7]]).astype(dtype)
    detector = SharpFeatureDetector(criterion=criterion, random_state=0)
    labels = detector.fit_predict(cloud)
    assert 0 < np.count_nonzero(~detector.inlier_mask_) < len(cloud)
    assert_array_equal(labels, detector.predict(cloud))
    assert_array_equal(detector.scores_, detector.score_samples(cloud))


# --- Criteria of eigenvalues ------------------------------------------------------------------


def test_the_eigenvalue_criterion_is_equation_25():
    cloud = make_box(1200, outlier_share=0.1, random_state=0).data
    estimator = RobustNormalEstimator(30, reweight=False, random_state=0)
    detector = SharpFeatureDetector(
        30,
        criterion="eigenvalue",
        threshold="mean",
        outlier_detector="passthrough",
        normal_estimator=estimator,
    ).fit(cloud)
    values = estimator.fit(cloud).eigenvalues_[:, 0]
    limit = values.mean() + values.std(ddof=1)
    assert_allclose(-detector.offset_, limit)
    assert_array_equal(detector.predict(cloud) == -1, values > limit)


def test_the_robust_threshold_is_the_median_plus_three_deviations(box):
    detector = fast(criterion="surface_variation").fit(box.data)
    values = RobustNormalEstimator(40, method="pca").fit(box.data).surface_variation_
    median = np.median(values)
    limit = median + 3 * 1.4826 * np.median(np.abs(values - median))
    assert_allclose(-detector.offset_, limit)
    assert_allclose(-detector.score_samples(box.data), values)


@pytest.mark.parametrize(
    ("criterion", "strictness", "size"), [("crease", "groups", 30), ("eigenvalue", "surfaces", 50)]
)
def test_eigenvalues_need_a_stricter_cleaning_than_creases(criterion, strictness, size):
    cloud = make_box(outlier_share=0.1, random_state=0)
    detector = SharpFeatureDetector(criterion=criterion, random_state=0).fit(cloud.data)
    cleaner = MCMDOutlierDetector(
        size, strictness=strictness, random_state=detector.outlier_detector_.random_state
    )
    assert_array_equal(detector.inlier_mask_, cleaner.fit_predict(cloud.data) == 1)


# --- Stages and pipelines ---------------------------------------------------------------------


def test_labels_are_the_same_if_the_default_normal_estimator_is_passed_or_stands_before():
    street = make_street(3000, outlier_share=0, random_state=0)  # with poles, whose planes bend
    default = fast().fit(street.data)
    passed = clone(default.normal_estimator_)
    nested = fast(normal_estimator=passed).fit(street.data)
    pipeline = make_pipeline(passed, fast(normals="precomputed")).fit(street.data)
    assert_array_equal(nested.scores_, default.scores_)
    assert_array_equal(pipeline[-1].scores_, default.scores_)


@pytest.mark.parametrize("criterion", ["eigenvalue", "surface_variation"])
def test_precomputed_columns_serve_the_other_criteria(box, criterion):
    normals = RobustNormalEstimator(40, method="pca")
    columns = normals.fit_transform(box.data)
    scores = fast(normals="precomputed", criterion=criterion).fit(columns).score_samples(columns)
    assert_allclose(scores, fast(criterion=criterion).fit(box.data).score_samples(box.data))


# --- Bad input --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"n_neighbors": 3}, "n_neighbors=3 is too few for planes in 3D"),
        ({"threshold": "mean"}, "threshold='mean' is for eigenvalues"),
        ({"threshold": 11.0}, "threshold=11 is in spacings"),
        ({"normals": "precomputed"}, "the 3 columns of X are not those of"),
        ({"outlier_detector": DBSCAN(0.3)}, "labels other than"),
        ({"outlier_detector": MCMDOutlierDetector(cutoff=1e-300)}, "200 of 200 points outliers"),
        ({"outlier_detector": StandardScaler()}, "'outlier_detector' .* implementing 'fit_pred"),
    ],
)
def test_bad_parameters_are_named(box, parameters, message):
    with pytest.raises(ValueError, match=message):
        fast(**parameters).fit(box.data[:200])


def test_the_size_of_the_default_detector_is_not_warned_of(box):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for criterion in ("crease", "eigenvalue"):  # 40 neighbors; a default detector has 50
            SharpFeatureDetector(criterion=criterion, random_state=0).fit(box.data[:44])
