"""Region growing with single steps left out."""

from contextlib import contextmanager

from sklearn_mcmd import RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.segmentation._estimator import GrowthSteps


@contextmanager
def changed(record, **values):
    """Whoever makes a record of limits gets other defaults, meanwhile."""
    make, kept = record.__new__, record.__new__.__defaults__
    make.__defaults__ = tuple({**record._field_defaults, **values}.values())
    try:
        yield
    finally:
        make.__defaults__ = kept


def fitted_without(X, *steps, **params):
    """A fitted `RegionGrowing` that left out some steps of `GrowthSteps`."""
    with changed(GrowthSteps, **dict.fromkeys(steps, False)):
        return RegionGrowing(**{"random_state": 0, **params}).fit(X)


def grown_without(X, *steps, **params):
    """Its labels, of columns that are given."""
    return fitted_without(X, *steps, normals="precomputed", **params).labels_


def columns(X):
    """What growth takes as normals that are given, of 50 neighbors."""
    return RobustNormalEstimator(50, random_state=0).fit_transform(X)
