"""Flat for its noise: against numbers of which the truth is known."""

import numpy as np
import pytest

from sklearn_mcmd.planes._around import are_flat, most_noise_around, quantile_of
from sklearn_mcmd.planes._record import Neighborhoods, Planes


def deviations(n_planes, n_members, seed=0):
    """Standard deviations that samples of noise of one have."""
    rng = np.random.default_rng(seed)
    return np.sqrt(rng.chisquare(n_members, n_planes) / n_members)


@pytest.mark.parametrize("k", [16, 50, 200])
def test_next_to_an_edge_the_usual_noise_is_that_of_the_face(k):
    noise = deviations(3000, k)
    noise[1500:] *= 4  # planes across both faces
    rows = np.random.default_rng(1).integers(0, len(noise), (len(noise), k)).astype(np.int32)
    around = Neighborhoods(rows, np.full(len(rows), k))
    flat = noise <= most_noise_around(noise, around, around.sizes, 0.25)
    assert flat[:1500].mean() > 0.9
    assert flat[1500:].mean() < 0.05


def test_what_curvature_adds_to_noise_adds_to_the_limit():
    around = Neighborhoods(np.zeros((1, 50), np.int32), np.array([50]))
    plain, bent = (
        most_noise_around(np.array([3.0]), around, 50, 0.25, bend) for bend in (0.0, 4.0)
    )
    assert plain == pytest.approx(3.0 * (1 + 3 * np.sqrt(1 / 100)))  # three standard errors
    assert bent / plain == pytest.approx(5 / 3)


def test_a_filled_ball_is_not_flat_and_a_plane_of_no_noise_is_none():
    ball = np.random.default_rng(0).normal(size=(20_000, 3))
    ball *= np.cbrt(np.linspace(0, 1, 20_000))[:, None] / np.linalg.norm(ball, axis=1)[:, None]
    planes = Planes.unknown(3, 3)
    planes.scale[:], planes.radius[:] = [ball[:, 2].std(), 0.1, -1.0], 1.0
    assert planes.scale[0] == pytest.approx(0.447, abs=0.01)
    assert are_flat(planes, 0.15).tolist() == [False, True, False]


@pytest.mark.parametrize("n", [1, 2, 3, 10, 1_001, 2_000])
@pytest.mark.parametrize("spread", [0.0, 1e-9, 1.0, 1e9])
@pytest.mark.parametrize("q", [0.0, 0.07, 0.5, 0.999, 1.0])
def test_a_quantile_of_parts_is_that_of_all_values(n, spread, q):
    rng = np.random.default_rng(n)
    values = rng.choice([-1.0, 0.0, -0.0, 1.0, 5e6], n) + spread * rng.normal(size=n)
    parts = np.array_split(values, [0, n // 3, n // 2])
    assert quantile_of(lambda: parts, q) == np.quantile(values, q)


def test_a_quantile_of_parts_is_no_number_where_one_is_none():
    assert np.isnan(quantile_of(lambda: [np.ones(3), np.array([np.nan])], 0.5))
