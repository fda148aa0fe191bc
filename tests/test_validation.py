"""What is no table of points is refused or warned of, in all estimators alike."""

import warnings

import numpy as np
import pytest

from sklearn_mcmd import (
    BaardaPlaneDetector,
    FuzzyPlaneDetector,
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd._validation import validate_points
from sklearn_mcmd.baselines import PlaneOutlierDetector
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import PointCloud

RNG = np.random.default_rng(0)
FLOOR = np.c_[RNG.uniform(0, 3, (60, 2)), RNG.normal(0, 0.003, 60)]
SCENE = make_street(400, outlier_share=0.1, random_state=0).data
VOLUME = RNG.uniform(size=(400, 3))
LIGHT = RNG.uniform(size=400)
ESTIMATORS = [
    MCMDOutlierDetector(20, random_state=0),
    RobustNormalEstimator(20, random_state=0),
    RegionGrowing(20, random_state=0),
    SharpFeatureDetector(20, random_state=0),
    PlaneOutlierDetector(20, method="pca"),
    BaardaPlaneDetector(sigma0=0.003),
    FuzzyPlaneDetector(sigma0=0.003),
]
each_estimator = pytest.mark.parametrize(
    "estimator", ESTIMATORS, ids=lambda one: type(one).__name__
)


def check(X, estimator=ESTIMATORS[0]):
    return validate_points(estimator.__class__(**estimator.get_params(False)), X)


@each_estimator
@pytest.mark.parametrize("n", [2, 3, 4, 6, 12])
def test_coordinates_as_rows_are_asked_to_be_transposed(estimator, n):
    with pytest.raises(ValueError, match=rf"X has {n} rows of 6,000 columns: transpose it\?"):
        estimator.fit(np.ones((n, 6000)))


@pytest.mark.parametrize(
    "form", [lambda X: X.tolist(), lambda X: X.astype("f4"), np.asfortranarray]
)
def test_new_points_as_rows_are_asked_to_be_transposed(form):
    estimator = BaardaPlaneDetector(sigma0=0.003).fit(FLOOR)
    for method in (estimator.predict, estimator.score_samples, estimator.residuals):
        with pytest.raises(ValueError, match=r"X has 3 rows of 60 columns: transpose it\?"):
            method(form(FLOOR.T))


@pytest.mark.parametrize("rows", [FLOOR[:2], FLOOR[:3], FLOOR[:1]])
def test_few_rows_of_three_columns_are_few_points(rows):
    with pytest.raises(ValueError, match="too few"):
        ESTIMATORS[0].fit(rows)
    assert len(BaardaPlaneDetector(sigma0=0.003).fit(FLOOR).predict(rows)) == len(rows)


def test_columns_behind_the_coordinates_may_be_more_than_rows():
    columns = RobustNormalEstimator(None, method="pca").fit_transform(FLOOR)[:11]
    growing = RegionGrowing(5, normals="precomputed", min_region_size=1)
    assert growing.fit(columns).n_regions_ >= 1


def fields():
    return np.rec.fromarrays(FLOOR.T, names="x, y, z")


def lazy_frame():
    polars = pytest.importorskip("polars")
    return polars.LazyFrame(dict(zip("xyz", FLOOR.T, strict=True)))


@each_estimator
@pytest.mark.parametrize(
    ("make", "words"),
    [
        (fields, r"X is a structured array, .* give X\[\['x', 'y', 'z'\]\].tolist"),
        (lazy_frame, r"X is a LazyFrame, .* give X.collect\(\)"),
        (lambda: PointCloud(FLOOR), "X is a PointCloud, .* give X.xyz"),
    ],
)
def test_what_holds_coordinates_in_another_form_is_named_with_the_way_to_them(
    estimator, make, words
):
    with pytest.raises(ValueError, match=words):
        estimator.fit(make())


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_columns_of_a_dataframe_may_have_any_name(library):
    frames = pytest.importorskip(library)
    frame = frames.DataFrame(dict(zip(("xyz", "collect", "dtype"), FLOOR.T, strict=True)))
    assert check(frame).shape == FLOOR.shape


@pytest.mark.parametrize(
    "more",
    [
        LIGHT,
        (255 * LIGHT).astype(int),
        1.6e9 + LIGHT,
        np.c_[LIGHT, LIGHT, LIGHT],
        np.zeros(400),
    ],
    ids=["intensity", "of 8 bits", "time", "color", "constant"],
)
@pytest.mark.parametrize("offset", [0.0, 5e6])
def test_columns_behind_those_of_surfaces_are_taken_for_no_coordinates(more, offset):
    with pytest.warns(UserWarning, match=r"each counts as a coordinate.*fit\(xyz, intensity=...\)"):
        check(np.c_[SCENE + offset, more])


@each_estimator
def test_an_estimator_of_clouds_warns_once_and_a_regression_does_not(estimator):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        estimator.fit(np.c_[SCENE, LIGHT])
    of_columns = [one for one in caught if "X has 4 columns" in str(one.message)]
    assert len(of_columns) == (not hasattr(estimator, "sigma0"))  # once, whatever is fitted within
    assert all(one.filename == __file__ for one in of_columns)


@pytest.mark.parametrize(
    "X",
    [
        SCENE,
        np.c_[VOLUME, 0.01 * LIGHT],
        np.c_[VOLUME, np.zeros(400)],
        RNG.normal(size=(400, 6)) * [1, 1, 1, 1, 1, 0.01],
        RNG.normal(size=(12, 4)),
        RNG.normal(size=(60, 10)),
        1e200 * RNG.normal(size=(60, 4)),
        np.repeat(RNG.normal(size=(3, 4)), 40, axis=0),
    ],
    ids=["3D", "4D", "exact", "6D", "few", "10D", "huge", "copies"],
)
def test_columns_that_fill_a_space_are_coordinates(X):
    check(X)


def named(names, columns=VOLUME):
    frames = pytest.importorskip("pandas")
    extra = RNG.uniform(size=(400, len(names) - 3))
    return frames.DataFrame(np.c_[columns, extra], columns=names)


@pytest.mark.parametrize("names", ["x y z intensity", "X Y Z red green blue", "id x y z"])
def test_names_beside_x_y_and_z_tell_what_is_no_coordinate(names):
    with pytest.warns(UserWarning, match=r"fit\(xyz, intensity=...\)"):
        check(named(names.split()))


@pytest.mark.parametrize("names", ["w x y z", "x y z w", "x0 x1 x2 x3"])
def test_names_of_coordinates_are_silent(names):
    check(named(names.split(), SCENE if "w" in names else VOLUME))


def test_the_last_name_tells_what_a_plane_of_a_regression_is_of():
    regression = BaardaPlaneDetector()
    check(named(["temperature", "x", "y", "z"]), regression)
    with pytest.raises(UserWarning, match="X has 4 columns"):
        check(named(["x", "y", "z", "intensity"]), regression)
