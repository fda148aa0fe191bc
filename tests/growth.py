"""Region growing with single steps left out."""

from benchmarks._ablation_changes import without_steps
from sklearn_mcmd import RegionGrowing


def fitted_without(X, *steps, **params):
    """A fitted `RegionGrowing` that left out some steps of `GrowthSteps`."""
    with without_steps(*steps):
        return RegionGrowing(**{"random_state": 0, **params}).fit(X)


def grown_without(X, *steps, **params):
    """Its labels, of columns that are given."""
    return fitted_without(X, *steps, normals="precomputed", **params).labels_
