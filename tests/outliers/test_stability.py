"""The verdict is stable where distances tie, and by another seed.

Where none do, `tests/properties/test_motion.py` asks for the same results. Coordinates of files lie
on a lattice, of a millimeter or so: which of two equally distant points is the last neighbor is up
to the search.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scenes import near_the_first
from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_street

CUTOFF = 3.0


def scores_of(X, seed=0):
    return -MCMDOutlierDetector(random_state=seed, n_jobs=2).fit(X).scores_


def changed(X):
    """The same cloud elsewhere, turned, in another unit, order, or with the least of noises."""
    rng = np.random.default_rng(0)
    extent = np.ptp(X, axis=0).max()
    order = rng.permutation(len(X))
    same = np.arange(len(X))
    return {
        "1 km away": (X + 1e3, same),
        "1,000 km away": (X + np.array([1e6, -2e6, 1e6]), same),
        "turned": (Rotation.from_euler("zyx", [0.3, 1.1, -2.0]).apply(X), same),
        "in other units": (3.28084 * X, same),
        "in another order": (X[order], order),
        "jitter of 1e-12": (X + 1e-12 * extent * rng.normal(size=X.shape), same),
    }


def cloud_of(name, n, request):
    if name == "street":
        return make_street(n, outlier_share=0.2, random_state=1).data
    return near_the_first(request.getfixturevalue("shared_data"), name, n)


@pytest.mark.parametrize(("name", "n"), [("jakarto_scanlines", 10_000), ("isprs_samp31", 4_000)])
def test_few_labels_change_where_coordinates_lie_on_a_lattice(shared_data, name, n):
    """A tie that is resolved otherwise exchanges the last of 50 neighbors, or picks another set
    of the same least eigenvalue. Both planes are as good, and neither answer is the right one.

    Ties concern up to a quarter of the points here. Their scores change by 2 to 50 % (medians of
    these clouds), and of all points 7 % have a score between 2 and 4.5. So one in a hundred of the
    changed scores, at most, crosses 3; measured are 0 to 8 in a thousand. Copies that jitter
    drives apart are neighbors of their own from then on, and are among them.
    """
    with np.load(shared_data / name / "cloud.npz") as arrays:
        X = arrays["xyz"][:n]
    before = scores_of(X)
    for Y, rows in changed(X).values():
        after = scores_of(Y)
        n_changed = np.count_nonzero(~np.isclose(after, before[rows], rtol=1e-6))
        assert n_changed < 0.3 * len(X)
        flips = np.count_nonzero((before[rows] > CUTOFF) != (after > CUTOFF))
        assert flips <= 2 + 0.01 * n_changed


@pytest.mark.parametrize(("name", "n"), [("street", 10_000), ("jakarto_scanlines", 10_000)])
def test_another_seed_changes_few_flags(name, n, request):
    """At most 5 % of those of either seed, and one. Clean clouds with few flags need more."""
    X = cloud_of(name, n, request)
    first, *others = (scores_of(X, seed=seed) > CUTOFF for seed in range(3))
    assert first.any()
    for flagged in others:
        assert (first ^ flagged).sum() <= 1 + 0.05 * (first | flagged).sum()
