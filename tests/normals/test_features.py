"""Features by name: formulas, columns, errors; agreement with another library."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from reference import plane
from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.normals._features import OF_PLANES, check_features, feature_columns

NAMES = list(OF_PLANES)  # those of curvatures are tested in test_curvature.py


@pytest.fixture(scope="module")
def street():
    return make_street(3000, random_state=0)


def features_of(point, mean, eigenvalues, normal):
    """The formulas, one point at a time."""
    l0, l1, l2 = (float(value) for value in eigenvalues)
    e = [value / (l0 + l1 + l2) for value in (l0, l1, l2)]
    return {
        "linearity": (l2 - l1) / l2,
        "planarity": (l1 - l0) / l2,
        "sphericity": l0 / l2,
        "omnivariance": (e[0] * e[1] * e[2]) ** (1 / 3),
        "anisotropy": (l2 - l0) / l2,
        "eigenentropy": -sum(value * np.log(value) for value in e),
        "verticality": 1 - abs(float(normal[2])),
        "roughness": abs(float((point - mean) @ normal)),
    }


def columns_of(X, names, **parameters):
    estimator = RobustNormalEstimator(features=names, random_state=0, **parameters)
    names = estimator.fit(X).get_feature_names_out()[3 * X.shape[1] + 3 :]
    return dict(zip(names, estimator.features_.T, strict=True))


@pytest.mark.parametrize("n", [400, 3000])  # NumPy and compiled
def test_features_are_those_of_principal_components_taken_literally(n):
    X = make_street(n, random_state=1).data
    columns = columns_of(X, "all", n_neighbors=20, method="pca")
    for i in range(0, n, n // 20):
        nearest = np.argsort(np.linalg.norm(X - X[i], axis=1))[:20]
        mean, eigenvalues, axes = plane(X[nearest])
        for name, value in features_of(X[i], mean, eigenvalues, axes[:, 0]).items():
            assert_allclose(columns[name][i], value, rtol=1e-6, atol=1e-9, err_msg=name)


@pytest.mark.parametrize("d", [2, 3, 5])
def test_coincident_points_have_finite_features(d):
    columns = columns_of(np.ones((60, d)), "all", n_neighbors=20, max_outlier_rate=0.1)
    for name, values in columns.items():
        assert_array_equal(values, 90 if name == "normal_error" else 0, err_msg=name)


def test_columns_come_in_the_order_asked_for(street):
    names = ["roughness", "linearity", "normal_error", "removed_fraction"]
    estimator = RobustNormalEstimator(features=names, random_state=0)
    columns = estimator.fit_transform(street.data)
    assert list(estimator.get_feature_names_out()[12:]) == names
    assert_array_equal(columns[:, 12:], estimator.features_)
    assert_array_equal(columns[:, 14], estimator.normal_error_)
    assert_array_equal(columns[:, 15], estimator.removed_fraction_)
    assert_array_equal(columns, estimator.transform(street.data))
    assert_allclose(columns[:, 13], columns_of(street.data, "all")["linearity"])


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_features_are_columns_of_data_frames(street, library):
    frames = pytest.importorskip(library)
    X = frames.DataFrame({name: street.data[:200, i] for i, name in enumerate("xyz")})
    estimator = RobustNormalEstimator(20, features="all", random_state=0)
    frame = estimator.set_output(transform=library).fit_transform(X)
    assert list(frame.columns)[:12] == [
        *("x", "y", "z", "normal_x", "normal_y", "normal_z", "surface_variation"),
        *("eigenvalue_0", "eigenvalue_1", "eigenvalue_2", "plane_offset", "plane_scale"),
    ]
    assert list(frame.columns)[12:] == feature_columns(check_features("all"), "xyz")
    assert_array_equal(frame["roughness"].to_numpy(), estimator.features_[:, 7])


def test_planes_beyond_space_have_all_but_the_features_of_space():
    X = np.random.default_rng(0).normal(size=(200, 4))
    estimator = RobustNormalEstimator(20, features="all", max_outlier_rate=0.1).fit(X)
    assert list(estimator.get_feature_names_out()[-8:]) == NAMES[2:]
    assert np.isfinite(estimator.features_).all()


@pytest.mark.parametrize(
    ("d", "features", "message"),
    [
        (3, ["planarity", "flatness"], r"features='flatness' is not known: take linearity, .*, or"),
        (3, ["planarity", "planarity"], "has a name twice"),
        (3, [3], "features=3 is not known"),
        (3, "flatness", "'features' parameter .*'planarity'"),
        (2, ["sphericity", "linearity"], "'linearity' is defined in 3D only and X has 2 features"),
        (4, "planarity", "'planarity' is defined in 3D only and X has 4 features: take spher"),
    ],
)
def test_wrong_names_are_named_and_the_right_ones_listed(d, features, message):
    X = np.random.default_rng(0).normal(size=(50, d))
    with pytest.raises(ValueError, match=message):
        RobustNormalEstimator(20, features=features, max_outlier_rate=0.1).fit(X)
