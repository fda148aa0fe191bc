"""DenoisingSampler: outliers leave X and y together, with and without imbalanced-learn."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.base import BaseEstimator, clone
from sklearn.neighbors import KNeighborsClassifier

from sklearn_mcmd import MCMDOutlierDetector, RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.resampling import DenoisingSampler

DETECTOR = MCMDOutlierDetector(30, random_state=0)


@pytest.fixture(scope="module")
def street():
    return make_street(3000, outlier_share=0.1, random_state=0)


@pytest.fixture(scope="module")
def kept(street):
    """What the detector alone keeps."""
    return np.flatnonzero(DETECTOR.fit_predict(street.data) == 1)


def test_the_rows_kept_are_the_detectors_inliers_in_order(street, kept):
    detector = clone(DETECTOR)
    sampler = DenoisingSampler(detector)
    X, y = sampler.fit_resample(street.data, street.surface)
    assert not hasattr(detector, "offset_")
    assert sampler.detector_.offset_ < 0
    assert 0 < len(kept) < len(street.data)
    assert_array_equal(sampler.sample_indices_, kept)
    assert_array_equal(X, street.data[kept])
    assert_array_equal(y, street.surface[kept])
    X, y = sampler.fit_resample(street.data.tolist())
    assert y is None
    assert_array_equal(X, street.data[kept])
    y = np.column_stack([street.surface, street.outlier_kind])
    assert_array_equal(sampler.fit_resample(street.data, y)[1], y[kept])


def test_the_default_drops_most_outliers_and_few_others(street):
    _, y = DenoisingSampler().fit_resample(street.data, street.target)
    assert np.sum(y == -1) < 0.5 * np.sum(street.target == -1)
    assert np.sum(y == 1) > 0.95 * np.sum(street.target == 1)


def test_pandas_objects_keep_their_kind_names_and_index(street, kept):
    pd = pytest.importorskip("pandas")
    X = pd.DataFrame(street.data, columns=["x", "y", "z"]).set_index(np.arange(3000) + 5)
    y = pd.Series(street.surface, index=X.index, name="surface")
    sampler = DenoisingSampler(DETECTOR)
    X_kept, y_kept = sampler.fit_resample(X, y)
    pd.testing.assert_frame_equal(X_kept, X.iloc[kept])
    pd.testing.assert_series_equal(y_kept, y.iloc[kept])
    assert list(sampler.feature_names_in_) == ["x", "y", "z"]
    assert sampler.n_features_in_ == 3


def test_polars_and_pyarrow_objects_keep_their_kind(street, kept):
    pl, pa = pytest.importorskip("polars"), pytest.importorskip("pyarrow")
    X, y = pl.DataFrame(street.data, schema=["x", "y", "z"]), pl.Series("surface", street.surface)
    X_kept, y_kept = DenoisingSampler(DETECTOR).fit_resample(X, y)
    assert X_kept.equals(X[kept])
    assert y_kept.equals(y[kept])
    X = pa.table(dict(zip("xyz", street.data.T, strict=True)))
    X_kept, y_kept = DenoisingSampler(DETECTOR).fit_resample(X, pa.array(street.surface))
    assert_array_equal(np.column_stack(X_kept.columns), street.data[kept])
    assert isinstance(y_kept, pa.Array)
    assert_array_equal(y_kept, street.surface[kept])


def test_what_is_no_detector_is_refused(street):
    with pytest.raises(ValueError, match="inconsistent numbers of samples"):
        DenoisingSampler(DETECTOR).fit_resample(street.data, street.target[:-1])
    with pytest.raises(ValueError, match=r"'detector' parameter .* implementing 'fit_predict'"):
        DenoisingSampler(RobustNormalEstimator()).fit_resample(street.data)
    with pytest.raises(ValueError, match="other than"):
        DenoisingSampler(RegionGrowing(random_state=0)).fit_resample(street.data)


class Strict(BaseEstimator):
    def fit_predict(self, X):
        return np.full(len(X), -1)


def test_a_detector_that_keeps_nothing_is_refused(street):
    with pytest.raises(ValueError, match="3000 of 3000 points outliers"):
        DenoisingSampler(Strict()).fit_resample(street.data)


def test_a_classifier_behind_it_learns_from_the_kept_rows_and_predicts_all(street, kept):
    imblearn = pytest.importorskip("imblearn.pipeline")
    pipeline = imblearn.make_pipeline(DenoisingSampler(DETECTOR), KNeighborsClassifier(5))
    found = pipeline.fit(street.data, street.surface).predict(street.data)
    expected = KNeighborsClassifier(5).fit(street.data[kept], street.surface[kept])
    assert_array_equal(found, expected.predict(street.data))
