"""The cutoff of a stated false-positive rate, by the simulation of a clean plane.

No formula gives the law of a score that is the least over planes which the point itself helped
to fit. So a plane with Gaussian noise is simulated and judged by the code and settings that
judge the cloud, and the cutoff is where the stated share of its points is flagged.
"""

from math import gamma, pi
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd.outliers._model import judge
from sklearn_mcmd.planes._around import ratio
from sklearn_mcmd.planes._local_planes import LocalPlaneModel
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._whole import Steps
from sklearn_mcmd.runtime._chunks import slices

SEED = 20_150  # of the simulated planes
EXPECTED = 50  # flagged points wanted in the simulation, whose own error is 14 % then,
LEAST_EXPECTED = 10  # and at least, where it is 30 %
# Points that count, where compiled code does the work and where it doesn't.
FEWEST = {True: 10_000, False: 1_000}  # at least
MOST = {True: 100_000, False: 10_000}  # at most
MOST_SIMULATED = {True: 400_000, False: 4_000}  # with those near the border; in many dimensions all
MATCHED = 1_000  # points whose planes tell the noise
MATCHING_STEPS = 4  # in which it is found
BATCH = 20_000  # points a batch of planes of their own
# Trials for each simulated plane, at most: it has no outliers. Those of 1,000 changed cutoffs of 20
# and of 50 neighbors by 0.3 % at most.
MOST_TRIALS = 300


class CalibrationLimits(NamedTuple):
    """What a simulated plane is."""

    margin: float = 2.0  # points count that are so far from the border, in radii of a neighborhood
    least_noise: float = 0.01  # in spacings
    most_noise: float = 2.0  # in spacings


def calibrated_cutoff(model, settings, rate, roughness=None):
    """Cutoff beyond which a stated share of a clean plane's points is flagged.

    The model is of the whole cloud. Its planes also tell how large the noise is against the
    spacing, which matters where it reaches the size of a neighborhood. The settings are
    `JudgeSettings`. Raise if the rate is less than the simulation resolves. The `roughness` is as
    by `roughness_of`, if the model is of other points.
    """
    d = model.index.points.shape[1]
    compiled = d == 3 and model.index.n_neighbors is not None
    check_rate(rate, compiled)
    n_counted = int(np.clip(EXPECTED / rate, FEWEST[compiled], MOST[compiled]))
    if model.index.n_neighbors is None:
        return float(np.quantile(_one_plane(model, settings, n_counted), 1 - rate))
    noise = _matching_noise(model, roughness_of(model) if roughness is None else roughness)
    X, counted = _clean_plane(n_counted, model.index.n_neighbors, d, noise)
    if settings.noise_scale is not None:
        settings = settings._replace(noise_scale=noise)
    _, judgement = judge(_model_over(model, X), X, settings)
    return float(np.quantile(judgement.scores[counted], 1 - rate))


def check_rate(rate, compiled=True):
    """Raise if a false-positive rate, or None, is less than the simulation resolves."""
    if rate is not None and rate * MOST[compiled] < LEAST_EXPECTED:
        raise ParameterError(
            f"$false_positive_rate={rate} is less than the simulation can resolve: at least "
            f"{LEAST_EXPECTED / MOST[compiled]:g} is needed here. Choose a cutoff instead."
        )


def _clean_plane(n_counted, n_neighbors, d, noise):
    """Points of spacing 1 with noise along the last axis, and which are far from the border."""
    compiled, margin = d == 3, CalibrationLimits().margin * _radius(n_neighbors, d)
    side = n_counted ** (1 / (d - 1)) + 2 * margin
    n = min(side ** (d - 1), max(MOST_SIMULATED[compiled], n_counted))
    n = int(max(n, 2 * n_neighbors))
    side = n ** (1 / (d - 1))
    rng = np.random.default_rng(SEED)
    X = rng.uniform(-side / 2, side / 2, (n, d))
    off_center = np.abs(X[:, :-1]).max(axis=1)
    # The innermost where the border leaves fewer; with many dimensions it is nearly everywhere.
    inner = max(side / 2 - margin, np.quantile(off_center, min(1.0, n_counted / n)))
    counted = off_center <= inner
    for part in (counted, ~counted):
        X[part, -1] = noise * _stratified_noise(np.count_nonzero(part), rng)
    return X, counted


def _stratified_noise(n, rng):
    """Standard normal values of which exactly as many are beyond any limit as should be: the share
    of flagged points then varies less from simulation to simulation."""
    return rng.permutation(ndtri((np.arange(n) + 0.5) / n))


def _radius(n_neighbors, d):
    """Radius of the ball in d - 1 dimensions that holds so many points of spacing 1."""
    unit_ball = pi ** ((d - 1) / 2) / gamma((d - 1) / 2 + 1)
    return (n_neighbors / unit_ball) ** (1 / (d - 1))


def _matching_noise(model, wanted):
    """Noise of a clean plane, in spacings, whose planes are as rough for their size as the cloud's.

    Where noise reaches the size of the neighborhoods these turn from disks into balls, and
    planes follow the noise: scale and cutoff are then different.
    """
    k, d = model.index.n_neighbors, model.index.points.shape[1]
    _, least, most = CalibrationLimits()
    noise = wanted * _radius(k, d)
    for _ in range(MATCHING_STEPS):
        noise = float(np.clip(noise, least, most))
        X, counted = _clean_plane(MATCHED, k, d, noise)
        simulated = _model_over(model, X)
        noise *= wanted / _roughness(simulated, np.flatnonzero(counted[simulated.index.rows]))
    return float(np.clip(noise, least, most))


def roughness_of(model):
    """Median ratio of scale to radius of planes, all over a cloud: around rows evenly along the
    first axis, so that neither the order of rows nor the unit matters."""
    points = model.index.points
    return _roughness(model, np.lexsort(points.T[::-1])[:: max(1, len(points) // MATCHED)])


def _roughness(model, rows):
    """Median ratio of scale to radius of the planes around some of the points."""
    ratios = []
    for part in slices(len(rows), model.chunk()):
        around = model.index.query_own(rows[part])
        planes, _ = model.first_planes(model.index.points[rows[part]], around)
        ratios.append(ratio(planes.scale, planes.radius))
    return float(np.median(np.concatenate(ratios)))


def _model_over(model, X):
    """The model of another cloud, with the same settings and the first of its trials."""
    k = model.index.n_neighbors
    settings = model.settings._replace(precision=np.finfo(float).eps, steps=Steps())
    # A minimal subset that is drawn again has the same plane.
    subsets = np.sort(model.trials[:, : X.shape[1]], axis=1)
    first = np.sort(np.unique(subsets, axis=0, return_index=True)[1])
    trials = model.trials[first[:MOST_TRIALS]]
    simulated = LocalPlaneModel(NeighborIndex(X, k), trials, settings)
    # However small the cloud is, this one is not.
    simulated.compiled = X.shape[1] <= 3
    return simulated


def _one_plane(model, settings, n_counted):
    """Scores of many clean planes of as many points as the cloud has, each fitted as one."""
    n, d = model.index.points.shape
    n_planes = -(-n_counted // n)
    rng = np.random.default_rng(SEED)
    batch, scores, noise = max(1, BATCH // n), [], CalibrationLimits().least_noise
    for first in range(0, n_planes, batch):
        X = rng.uniform(-1, 1, (min(batch, n_planes - first), n, d))
        X[..., -1] = noise * _stratified_noise(X[..., 0].size, rng).reshape(X.shape[:2])
        # As the one neighborhood is kept.
        off_center = np.linalg.norm(X - X.mean(axis=1, keepdims=True), axis=2)
        X = np.take_along_axis(X, np.argsort(off_center, axis=1)[..., None], axis=1)
        sizes = np.full(len(X), n)
        fit = _model_over(model, X[0]).fit_rule(X, sizes, model.rounding)
        distances = fit.score(X)
        if settings.noise_scale is not None:
            distances *= fit.scale[:, None] / noise
        scores.append(distances.ravel())
    return np.concatenate(scores)
