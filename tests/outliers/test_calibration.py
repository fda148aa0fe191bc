"""A stated false-positive rate is what clean planes are flagged at."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.outliers import _calibration
from sklearn_mcmd.planes._local_planes import LocalPlaneModel

OWN = {"strictness": None}


def plane(n, noise, seed):
    """A square of n points of spacing 1."""
    rng = np.random.default_rng(seed)
    X = rng.uniform(0, np.sqrt(n), (n, 3))
    X[:, 2] = rng.normal(0, noise, n)
    return X


def detector(rate, **parameters):
    return MCMDOutlierDetector(false_positive_rate=rate, random_state=0, **parameters)


def interior(X, margin):
    middle = np.ptp(X[:, :2], axis=0) / 2
    return (np.abs(X[:, :2] - middle) < middle - margin).all(axis=1)


def tolerance(rate, n, n_simulated=10_000):
    """Four relative standard errors of a share of n points against that of the simulated.

    Flagged points are not independent, as neighbors share planes: a third is added.
    """
    return 4 * 1.33 * np.sqrt(1 / (rate * n) + 1 / (rate * n_simulated))


@pytest.mark.parametrize(
    ("form", "k", "noise", "rate"),
    [
        (OWN, 20, 0.3, 0.05),
        (OWN, 50, 0.1, 0.01),
        ({}, 20, 0.3, 0.05),
        ({}, 50, 0.1, 0.01),
        ({"strictness": "isolated"}, 30, 0.1, 0.05),
        ({"strictness": "surfaces"}, 30, 0.1, 0.05),
        ({"strictness": "surfaces"}, 50, 0.3, 0.01),
        ({"noise_scale": 0.3}, 30, 0.3, 0.05),
    ],
)
def test_a_fresh_plane_is_flagged_at_the_stated_rate(form, k, noise, rate):
    X = plane(8000, noise, seed=1)
    far = interior(X, 2 * np.sqrt(k / np.pi))
    flagged = detector(rate, n_neighbors=k, **form).fit_predict(X)[far] == -1
    assert_allclose(flagged.mean(), rate, rtol=tolerance(rate, far.sum()))


@pytest.fixture
def trials_made(monkeypatch):
    """The trials of each model that is made, the first of them of the cloud; planes are small."""
    made, begin = [], LocalPlaneModel.__init__

    def counted(self, index, trials, settings):
        made.append(len(trials))
        begin(self, index, trials, settings)

    monkeypatch.setattr(LocalPlaneModel, "__init__", counted)
    monkeypatch.setitem(_calibration.FEWEST, True, 1_000)
    return made


@pytest.mark.parametrize(("n", "d", "most"), [(10, 3, 120), (10, 2, 45), (50, 3, 300)])
@pytest.mark.parametrize("k", [50, None])
def test_simulated_planes_have_each_minimal_subset_once_and_few_of_many(k, n, d, most, trials_made):
    X = plane(n, 0.1, seed=0)[:, -d:]
    n_trials = detector(0.05, n_neighbors=k, max_outlier_rate=0.9).fit(X).n_trials_
    assert trials_made[0] == n_trials > 900
    assert set(trials_made[1:]) == {most}


@pytest.mark.parametrize("n", [20, 200])
def test_one_plane_of_few_points_is_flagged_at_the_stated_rate(n):
    rate, n_planes = 0.05, 4000 // n
    cutoff = -detector(rate, n_neighbors=None).fit(plane(n, 0.1, seed=0)).offset_
    clouds = [plane(n, 0.1, seed=1 + i) for i in range(n_planes)]
    # Scores of one plane do not depend on the cutoff.
    one_plane = MCMDOutlierDetector(None, random_state=0)
    scores = np.concatenate([-one_plane.fit(X).score_samples(X) for X in clouds])
    assert_allclose(np.mean(scores > cutoff), rate, rtol=tolerance(rate, n * n_planes, 1000))


def test_the_cutoff_does_not_depend_on_units():
    X = plane(1200, 0.3, seed=4)
    expected = detector(0.05, n_neighbors=20, **OWN).fit(X).offset_
    # A power of two: no coordinate is rounded.
    scaled = detector(0.05, n_neighbors=20, **OWN).fit(1024 * X).offset_
    assert_allclose(scaled, expected, rtol=1e-9)


def test_a_rate_that_cannot_be_simulated_is_refused():
    with pytest.raises(ValueError, match=r"false_positive_rate=1e-06 .* at least 0\.0001"):
        detector(1e-6, n_neighbors=20).fit(plane(100, 0.1, seed=0))


@pytest.mark.parametrize("is_seen", [False, True])
def test_the_rate_holds_for_whole_clean_scans(is_seen):
    """Also for kerbs, reveals, poles and a post, whether or not the sensor's position is known."""
    street = make_street(20_000, outlier_share=0, sampling="scan_lines", random_state=0)
    origin = street.sensor_origins[0] if is_seen else None
    fitted = detector(0.01, n_neighbors=50, sensor_origin=origin).fit(street.data)
    assert 0.008 < (fitted.scores_ < fitted.offset_).mean() < 0.013
