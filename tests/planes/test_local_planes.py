"""The model behind the estimators: compiled and NumPy forms, on clouds made to break them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from adversarial import KINDS, neighborhoods
from sklearn_mcmd.planes._consistent_set import draw_trials
from sklearn_mcmd.planes._local_planes import LocalPlaneModel, PlaneSettings
from sklearn_mcmd.planes._neighborhoods import NeighborIndex


def planes_of(X, compiled, **parameters):
    settings = {
        "method": "mcmd_z",
        "support_fraction": 0.5,
        "cutoff": 2.5,
        "reweight": True,
        "precision": 2.0**-52,
    }
    queries = parameters.pop("queries", X)
    index = NeighborIndex(X, 30, parameters.pop("radius", None))
    settings = PlaneSettings(**{**settings, **parameters})
    model = LocalPlaneModel(index, draw_trials(69, 30, 0), settings)
    model.compiled = compiled
    return model.evaluate(queries)


@pytest.mark.parametrize(
    ("method", "reweight"),
    [("mcmd_z", True), ("mcmd_z", False), ("mcmd_md", True), ("mcmd_md", False), ("pca", True)],
)
@pytest.mark.parametrize("aside", [0.0, 0.05])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("d", [2, 3])
def test_compiled_and_numpy_forms_agree(d, kind, method, reweight, aside):
    X = neighborhoods(kind, 12, 60, seed=5).reshape(-1, 3)[:, 3 - d :]
    rng, parameters = np.random.default_rng(6), {"method": method, "reweight": reweight}
    parameters["queries"] = X + aside * np.ptp(X, axis=0).max() * rng.normal(size=X.shape)
    ours, our_distance = planes_of(X, True, **parameters)
    theirs, their_distance = planes_of(X, False, **parameters)
    # Scales at rounding level, as on a perfect plane, may differ by rounding.
    level = 1e-13 * (np.abs(X).max() + 1)
    agree = np.isclose(ours.scale, theirs.scale, rtol=1e-6, atol=level)
    # Nothing but a tie holds the plane of a thin line: where two members' distances round to
    # different steps, another plane wins. Everywhere else the forms agree without exception.
    assert agree.mean() >= (0.99 if kind == "thin" else 1.0)
    same = agree & (theirs.scale > 1e3 * level)
    assert_allclose(our_distance[same], their_distance[same], rtol=1e-5, atol=1e-6)
    assert_array_equal(ours.kept[same], theirs.kept[same])
    size = np.ptp(X, axis=0).max()
    assert_allclose(ours.centroids[same], theirs.centroids[same], rtol=1e-12, atol=1e-9 * size)
    most = theirs.eigenvalues.max()
    assert_allclose(ours.eigenvalues[same], theirs.eigenvalues[same], rtol=1e-6, atol=1e-15 * most)


def test_neighborhoods_of_different_sizes_agree():
    X = neighborhoods("noisy plane", 6, 80, seed=7).reshape(-1, 3)
    (ours, _), (theirs, _) = (planes_of(X, compiled, radius=0.4) for compiled in (True, False))
    assert_allclose(ours.scale, theirs.scale, rtol=1e-6, atol=1e-12)
    assert_array_equal(ours.kept, theirs.kept)
    assert_allclose(ours.radius, theirs.radius, rtol=1e-12)
    assert len(np.unique(NeighborIndex(X, 30, 0.4).query(X).sizes)) > 1
