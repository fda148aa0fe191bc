"""Degenerate clouds: each has a clear error or a right answer, and no warning of NumPy."""

import re
import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sklearn.base import clone

from public import ESTIMATORS, NOISE, fitted, results
from sklearn_mcmd import (
    BaardaPlaneDetector,
    CloudChange,
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
    datasets,
)
from sklearn_mcmd.baselines import PlaneOutlierDetector

TURN = Rotation.from_euler("xyz", [30, 30, 30], degrees=True).as_matrix()
DRAWN = np.random.default_rng(0)
ALONG = DRAWN.uniform(0, 1, (150, 1))
PLATE = DRAWN.uniform(0, 1, (250, 3)) * [1, 1, 0] + DRAWN.normal(0, NOISE, (250, 3))
FLAT = np.round(DRAWN.uniform(0, 1, (250, 3)) * 2**20) / 2**20
FLAT[:, 2] = FLAT[:, 0] / 2 + FLAT[:, 1] / 4  # exact in binary
LATTICE = np.indices((20, 20, 1)).reshape(3, -1).T * 0.01
SHEET = np.indices((40, 30, 1)).reshape(3, -1).T
SHEETS = DRAWN.uniform(0, 1, (400, 3)) * [1, 1, 0]
SHEETS[200:, 2] = 0.002


def with_row(row, value):
    X = PLATE.copy()
    X[row] = value
    return X


# Exact planes, with their normal; more than 1,000 points have compiled code.
PLANES = {
    "coplanar": (FLAT * [1, 1, 0], [0, 0, 1]),
    "coplanar in binary": (FLAT, np.array([-2, -1, 4]) / np.sqrt(21)),
    "lattice": (LATTICE, [0, 0, 1]),
    "turned lattice": (LATTICE @ TURN.T, TURN[:, 2]),
    "compiled turned lattice": (SHEET @ TURN.T * 0.01, TURN[:, 2]),
}
# Nothing determines a plane.
LINES = {
    "equal": np.full((150, 3), 1.5),
    "equal to the origin": np.zeros((150, 3)),
    "equal in UTM": np.full((150, 3), 5123456.789),
    "two places": np.repeat([[0.0, 0, 0], [1, 2, 3]], 75, axis=0),
    "collinear": ALONG * [1, 2, 3] + [4, 5, 6],
    "collinear with an axis": ALONG * [0, 0, 1],
    "evenly collinear": np.linspace(0, 1, 150)[:, None] * [1, 2, 3],
    "collinear in UTM": ALONG * [1, 2, 3] + [5e5, 5e6, 100],
}
OTHERS = {
    "solid lattice": np.indices((7, 7, 7)).reshape(3, -1).T * 0.01,
    "turned solid lattice": np.indices((7, 7, 7)).reshape(3, -1).T @ TURN.T * 0.01,
    "centimeters, turned": np.round(PLATE, 2) @ TURN.T,
    "sheets": SHEETS,
    "noisy sheets": SHEETS + DRAWN.normal(0, 2e-4, SHEETS.shape),
    "one at 1e30": with_row(7, 1e30),
    "unit of 1e-60": 1e-60 * PLATE,
    "unit of 1e60": 1e60 * PLATE,
    "steps too small for float64": 1e-90 * PLATE + 1,
    "half copies": np.vstack([PLATE, PLATE]),
    "half at one place": np.vstack([PLATE, np.repeat(PLATE[:1], 200, axis=0)]),
    "k = n": PLATE[:50],
    "2D": PLATE[:, 1:],
    "4D": np.column_stack([DRAWN.uniform(0, 1, (150, 3)), DRAWN.normal(0, 0.01, 150)]),
    "4D, coplanar": np.column_stack([DRAWN.uniform(0, 1, (150, 3)), np.zeros(150)]),
    "10D": np.column_stack([DRAWN.uniform(0, 1, (30, 9)), DRAWN.normal(0, 0.01, 30)]),
}
REFUSED = {
    "NaN": (with_row(3, [0, np.nan, 0]), r"X has NaN in row 3: \[0\.0, nan, 0\.0\]"),
    "infinity": (with_row(5, [0, 0, np.inf]), r"X has infinity in row 5"),
    "minus infinity": (with_row(5, [0, -np.inf, 0]), r"X has infinity in row 5"),
    "one at 1e300": (with_row(7, 1e300), "beyond 1e.70 in row 7|squares overflow float64"),
    "unit of 1e150": (1e150 * PLATE, "beyond 1e.70 in row 0"),
    "unit of 1e-310": (1e-310 * PLATE, "spans no more than|lie at one place"),
    "no point": (PLATE[:0], "0 sample"),
    "one point": (PLATE[:1], "n_samples=1 is too few|too few to test"),
    "three points": (PLATE[:3], "n_samples=3 is too few|too few to test"),
    "one column": (PLATE[:, :1], "minimum of 2"),
}
# None that takes a second for each cloud, or has the fit of another.
SOME = {
    name: estimator
    for name, estimator in ESTIMATORS.items()
    if getattr(estimator, "method", "") != "ransac"
    and getattr(estimator, "strictness", "") not in ("isolated", "surfaces")
    and getattr(estimator, "criterion", "") != "surface_variation"
    and not isinstance(estimator, CloudChange)
}
CLEAR = "lie on one line|lie at one place|distinct point|is for points in 2D and 3D"
# May be infinite, or not a number where it is documented so.
UNKNOWN = ("global_test_pvalue", "defuzzification", "critical_value_", "form_.statistic")
UNKNOWN += ("form_.pvalue", "form_.bow", "form_.alike_dof")


def quiet_fit(estimator, X):
    """Fitted, with no warning but our own, and few of these."""
    with warnings.catch_warnings(record=True) as given:
        warnings.simplefilter("always")
        estimator = fitted(estimator, X)
    assert [str(w.message) for w in given if not issubclass(w.category, UserWarning)] == []
    assert len(given) <= 6
    return estimator


def check(estimator, X):
    try:
        estimator = quiet_fit(estimator, X)
    except ValueError as error:
        if re.search(CLEAR, str(error)):
            return
        raise
    for name, value in results(estimator, X).items():
        if value.dtype.kind == "f" and not name.startswith(UNKNOWN):
            assert np.isfinite(value).all(), name


@pytest.mark.parametrize("case", ["coplanar", "compiled turned lattice", *LINES, *OTHERS])
@pytest.mark.parametrize("name", SOME)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_degenerate_cloud_has_a_clear_error_or_finite_results(name, case):
    X = {**{key: X for key, (X, _) in PLANES.items()}, **LINES, **OTHERS}[case]
    estimator = clone(SOME[name])
    if len(X[0]) == 10 and hasattr(estimator, "max_outlier_rate"):
        estimator.set_params(max_outlier_rate=0.1)
    check(estimator, X)


@pytest.mark.parametrize("case", REFUSED)
@pytest.mark.parametrize("name", ESTIMATORS)
def test_what_no_plane_can_be_made_of_is_refused(name, case):
    X, message = REFUSED[case]
    if case == "unit of 1e150" and hasattr(ESTIMATORS[name], "sigma0"):
        pytest.skip("an adjustment takes it")
    with pytest.raises(ValueError, match=message):
        fitted(ESTIMATORS[name], X)


@pytest.mark.parametrize("case", PLANES)
def test_an_exact_plane_has_its_normal_and_nothing_else(case):
    X, normal = PLANES[case]
    assert (MCMDOutlierDetector(random_state=0).fit_predict(X) == 1).all()
    assert (SharpFeatureDetector(random_state=0).fit_predict(X) == 1).all()
    normals = RobustNormalEstimator(random_state=0).fit(X)
    np.testing.assert_allclose(np.abs(normals.normals_ @ normal), 1, atol=1e-12)
    assert normals.normal_error_.max() < 1e-6
    growing = RegionGrowing(random_state=0).fit(X)
    assert growing.region_sizes_.tolist() == [len(X)]
    assert growing.regions_["kind"].tolist() == ["plane"]
    baarda = BaardaPlaneDetector(sigma0=NOISE, surface="orthogonal").fit(X)
    np.testing.assert_allclose(np.abs(baarda.normal_ @ normal), 1, atol=1e-12)
    assert (baarda.labels_ == 1).all()


@pytest.mark.parametrize("case", LINES)
@pytest.mark.filterwarnings("ignore:n_neighbors=.* is more than")
def test_a_line_has_no_normal_no_edge_and_no_outlier(case):
    X = LINES[case]
    for strictness in ("isolated", "groups", "surfaces"):
        detector = MCMDOutlierDetector(strictness=strictness, random_state=0).fit(X)
        assert (detector.labels_ == 1).all()
        # What is away from all of it has nothing that explains it.
        assert detector.predict(np.add(X[:1], [50, 0, 0])).tolist() == [-1]
    assert (SharpFeatureDetector(random_state=0).fit_predict(X) == 1).all()
    assert (RobustNormalEstimator(random_state=0).fit(X).normal_error_ == 90).all()
    growing = RegionGrowing(random_state=0).fit(X)
    found = growing.regions_  # a cylinder of the rounding of a line is none
    assert len(found) == 1
    assert found["points"].sum() == len(X)
    assert (found["kind"] == "plane").all()
    assert (found["normal_error"] == 90).all()
    with pytest.raises(ValueError, match=CLEAR):
        BaardaPlaneDetector(surface="orthogonal").fit(X)


def test_a_point_at_1e30_is_an_outlier_and_hides_nothing():
    far = with_row(7, 1e30)
    labels = MCMDOutlierDetector(random_state=0).fit_predict(far)
    assert np.flatnonzero(labels == -1).tolist() == [7]
    normals = RobustNormalEstimator(random_state=0).fit(far).normals_
    assert (np.delete(normals, 7, axis=0)[:, 2] > 0.99).all()
    labels = RegionGrowing(random_state=0).fit_predict(far)
    assert labels[7] == -1
    assert np.count_nonzero(np.delete(labels, 7) == 0) >= 248  # one of noise may be left out
    box = datasets.make_box(1200, random_state=0).data
    detector = SharpFeatureDetector(outlier_detector="passthrough", random_state=0)
    expected = detector.fit_predict(box)
    found = detector.fit_predict(np.vstack([box, np.full((1, 3), 1e30)]))
    assert (expected == -1).sum() > 100
    assert np.mean(found[:-1] == expected) > 0.99


def test_parallel_sheets_2_mm_apart_are_one_surface_if_points_are_farther_apart():
    X = OTHERS["noisy sheets"]
    assert (MCMDOutlierDetector(random_state=0).fit_predict(X) == 1).mean() >= 0.99
    assert (RobustNormalEstimator(random_state=0).fit(X).normals_[:, 2] > 0.999).all()
    growing = RegionGrowing(random_state=0).fit(X)
    assert growing.n_regions_ == 1
    np.testing.assert_allclose(growing.region_errors_, 0.001, rtol=0.1)  # half of the gap


def test_subnormal_differences_are_refused():
    X = np.vstack([PLATE, 1e-310 * PLATE])
    for estimator in (MCMDOutlierDetector(), RegionGrowing(), SharpFeatureDetector()):
        with pytest.raises(ValueError, match="250 points within 1e-70 of the origin that are not"):
            estimator.fit(X)
    X[250:] = 0  # as the message says
    assert np.isfinite(MCMDOutlierDetector(random_state=0).fit(X).scores_).all()


@pytest.mark.parametrize("shape", ["plate", "lattice", "line", "place", "ball"])
@pytest.mark.parametrize("name", SOME)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_clouds_of_4_to_60_points_have_finite_results(name, shape):
    clouds = {
        "plate": PLATE,
        "lattice": LATTICE,
        "line": LINES["collinear"],
        "place": LINES["equal"],
        "ball": DRAWN.normal(size=(60, 3)),
    }
    for n in (4, 5, 11, 31, 51):
        X = clouds[shape][:n]
        check(SOME[name], X)


@pytest.mark.parametrize("method", ["ransac", "msac", "robpca", "ulsif", "qsp"])
@pytest.mark.filterwarnings("ignore:n_neighbors=.* is more than")
def test_a_query_away_from_copies_of_the_origin_is_a_finite_outlier_of_a_baseline(method):
    share = 0.1 if method in ("ulsif", "qsp") else "auto"
    detector = PlaneOutlierDetector(10, method=method, contamination=share, random_state=0)
    detector = quiet_fit(detector, np.zeros((30, 3)))
    queries = np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 1e-3]])
    assert np.isfinite(detector.score_samples(queries)).all()
    assert detector.predict(queries).tolist() == [1, -1, -1]


@pytest.mark.parametrize("case", [*LINES, "n = 30"])
@pytest.mark.parametrize("sensor_origin", ["origin", "auto", [0.0, 0.0, 5.0]])
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_line_beside_the_sensor_has_no_outlier(case, sensor_origin):
    X = LINES.get(case, LINES["evenly collinear"][:30])
    detector = MCMDOutlierDetector(sensor_origin=sensor_origin, random_state=0)
    if case == "equal to the origin" and sensor_origin == "origin":
        with pytest.raises(ValueError, match="is where all points are"):
            detector.fit(X)
        return
    detector = quiet_fit(detector, X)
    assert np.isfinite(detector.scores_).all()
    if not (case == "evenly collinear" and sensor_origin == "origin"):  # one beam, many echoes
        assert (detector.predict(X) == 1).all()


@pytest.mark.filterwarnings("ignore:n_neighbors=.* is more than")
def test_a_stated_rate_is_kept_where_no_plane_tells_the_noise():
    X = LINES["equal"]
    detector = quiet_fit(MCMDOutlierDetector(false_positive_rate=0.01, random_state=0), X)
    assert (detector.predict(X) == 1).all()


# ---- Functions -------------------------------------------------------------------------------


@pytest.mark.parametrize("make", datasets.__all__)
def test_made_up_clouds_have_as_many_finite_points_as_asked_for(make):
    for n in (1, 3, 31):
        cloud = getattr(datasets, make)(n, outlier_share=0.0, random_state=0)
        X = cloud.data if hasattr(cloud, "data") else cloud[0]
        assert len(X) == n
        assert np.isfinite(X).all()
