"""The same numbers in any container give the same results, and are left as they are."""

import numpy as np
import pytest
from sklearn.base import clone

from public import ESTIMATORS, cloud_for, expected_results, fitted, results
from sklearn_mcmd.adjustment import compare_planes, flatness, text_report
from sklearn_mcmd.metrics import bias_angle, outlier_scores, segmentation_scores


def strided(X):
    wide = np.full((2 * len(X), 2 * X.shape[1]), np.nan)
    wide[::2, ::2] = X
    return wide[::2, ::2]


def frame(library):
    def make(X, tmp_path):
        frames = pytest.importorskip(library)
        return frames.DataFrame({f"x{i}": column for i, column in enumerate(X.T)})

    return make


def memory_map(X, tmp_path):
    np.save(tmp_path / "X.npy", X)
    return np.load(tmp_path / "X.npy", mmap_mode="r")


def read_only(X, tmp_path):
    X = X.copy()
    X.flags.writeable = False
    return X


FORMS = {
    "array": lambda X, _: X.copy(),
    "Fortran order": lambda X, _: np.asfortranarray(X),
    "strided": lambda X, _: strided(X),
    "read-only": read_only,
    "memory map": memory_map,
    "other byte order": lambda X, _: X.astype(X.dtype.newbyteorder()),
    "objects": lambda X, _: X.astype(object),
    "list": lambda X, _: X.tolist(),
    "pandas": frame("pandas"),
    "polars": frame("polars"),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", {type(e): name for name, e in ESTIMATORS.items()}.values())
@pytest.mark.filterwarnings("ignore:X does not have valid feature names:UserWarning")
def test_the_container_changes_nothing(name, form, tmp_path):
    X = cloud_for(name)
    given = FORMS[form](X, tmp_path)
    estimator = fitted(ESTIMATORS[name], given)
    found, expected = results(estimator, given), expected_results(name, "small")
    for attribute, value in found.items():
        np.testing.assert_array_equal(value, expected[attribute], err_msg=attribute)
    np.testing.assert_array_equal(np.asarray(given, dtype=float), X)  # not changed


@pytest.mark.parametrize("name", ESTIMATORS)
def test_integers_of_numpy_are_parameters_as_those_of_python(name):
    """As grids of `np.arange` have them; a small type must not overflow."""
    X, numbered = cloud_for(name, "compiled"), clone(ESTIMATORS[name])
    for parameter, value in numbered.get_params(deep=False).items():
        if type(value) is int:
            numbered.set_params(**{parameter: np.uint8(value)})
    found, expected = results(fitted(numbered, X), X), expected_results(name, "compiled")
    for attribute, value in found.items():
        np.testing.assert_array_equal(value, expected[attribute], err_msg=attribute)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_single_precision_has_the_results_of_double(name):
    """Of coordinates that both hold exactly. Rounding joins the noise: 6e-8 of 2 m, and 4 mm."""
    X = cloud_for(name, "compiled").astype(np.float32)
    double = results(fitted(ESTIMATORS[name], X.astype(float)), X.astype(float))
    single = results(fitted(ESTIMATORS[name], X), X)
    for label in {"labels_", "predicted", "inlier_mask_"} & single.keys():
        assert np.mean(single[label] != double[label]) <= 0.001, label
    for attribute in {"scores_", "normals_", "test_statistic_", "plane_scale_"} & single.keys():
        close = np.isclose(single[attribute], double[attribute], rtol=1e-3, atol=1e-4)
        assert close.mean() > 0.99, attribute


@pytest.mark.parametrize("name", ESTIMATORS)
def test_whole_numbers_have_the_results_of_floats(name):
    X = np.rint(cloud_for(name) * 2**16).astype(int)
    found, expected = (
        results(fitted(ESTIMATORS[name], Y, unit=2**16), Y) for Y in (X, X.astype(float))
    )
    for attribute, value in found.items():
        np.testing.assert_array_equal(value, expected[attribute], err_msg=attribute)


@pytest.mark.parametrize("form", ["strided", "list", "polars"])
@pytest.mark.filterwarnings("ignore:X does not have valid feature names:UserWarning")
def test_functions_take_any_container(form, tmp_path):
    name = next(n for n, e in ESTIMATORS.items() if hasattr(e, "sigma0"))
    X = cloud_for(name)
    y = np.where(np.arange(len(X)) < len(X) // 20, -1, 1)
    given, labels = FORMS[form](X, tmp_path), y.tolist() if form == "list" else y
    detector = fitted(ESTIMATORS[name], given)
    same = fitted(ESTIMATORS[name], X)
    assert compare_planes(detector, same).verdict == "same"
    assert flatness(detector, given, 0.01) == flatness(same, X, 0.01)
    assert text_report(detector, given) == text_report(same, X)
    normals = X / np.linalg.norm(X, axis=1, keepdims=True)
    angles = bias_angle(FORMS[form](normals, tmp_path), X)
    np.testing.assert_allclose(angles, 0, atol=1e-6)
    assert outlier_scores(labels, y).accuracy == 1.0
    assert segmentation_scores(labels, y).f_score == 1.0
