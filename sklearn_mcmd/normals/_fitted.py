"""Estimators of normals that did not find their planes themselves."""

from sklearn.base import clone

from sklearn_mcmd.normals._features import settle_features

__all__ = ["fitted_of"]


def fitted_of(estimator, model, planes, X, orient, find_curvatures, n_jobs):
    """A clone of an estimator that has what is public of points X (n, d), from their planes.

    Others than itself found these, by its model; `orient` and `find_curvatures` are as of `_tell`.
    """
    fitted = clone(estimator).set_params(n_jobs=n_jobs)
    fitted.n_features_in_, d = X.shape[1], X.shape[1]
    fitted._feature_names, fitted._model = settle_features(fitted.features, d), model
    fitted._tell(planes, X, orient, find_curvatures)
    return fitted
