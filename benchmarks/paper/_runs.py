"""Runs of methods over many clouds, and the Monte-Carlo errors of the results."""

from zlib import crc32

import numpy as np

from sklearn_mcmd.metrics import bias_angle
from sklearn_mcmd.runtime._progress import current_span

# Number of clouds that a method gets at once. Their arrays stay in the processor's cache. Each
# chunk draws its own table of trials.
CHUNK = 50
RESAMPLES = 200


def stream(seed, *labels):
    """A separate RandomState for each labeled part of an experiment."""
    words = [crc32(str(label).encode()) for label in labels]
    return np.random.RandomState(np.random.MT19937(np.random.SeedSequence([seed, *words])))


def affordable(method, runs):
    """Number of runs that a method gets: its share of `runs`, at least four or all."""
    return min(runs, max(4, round(method.effort * runs)))


class Steps:
    """Tells listeners (see ``_progress``) how many of the runs are done."""

    def __init__(self, total):
        self.total, self.done, self.span = total, 0, current_span()

    def advance(self, n):
        self.done += n
        if self.span is not None:
            self.span.report(self.done / self.total)


def bias_angles(method, clouds, random_state, steps):
    """Angles between a method's planes of clouds and of their clean twins (Eq. 19), (runs,)."""
    angles = []
    for chunk in _chunks(clouds[: affordable(method, len(clouds))]):
        pair = [
            method(points, chunk.regular, chunk.n_outliers, random_state)[0]
            for points in (chunk.points, chunk.clean)
        ]
        angles.append(bias_angle(*pair))
        steps.advance(len(chunk))
    return np.concatenate(angles)


def flag_counts(method, clouds, random_state, steps, n_flagged=None):
    """Outliers found and regular points kept in each cloud, int (runs, 2)."""
    counts = []
    for chunk in _chunks(clouds[: affordable(method, len(clouds))]):
        _, inliers = method(chunk.points, chunk.regular, chunk.n_outliers, random_state, n_flagged)
        n_found = (~inliers & ~chunk.regular).sum(axis=1)
        counts.append(np.column_stack([n_found, (inliers & chunk.regular).sum(axis=1)]))
        steps.advance(len(chunk))
    return np.concatenate(counts)


def bootstrap_error(values, statistic):
    """Standard error of ``statistic(values, axis=1)`` over independent runs, by resampling."""
    rng = np.random.RandomState(0)
    drawn = values[rng.randint(len(values), size=(RESAMPLES, len(values)))]
    return float(np.std(statistic(drawn, axis=1)))


def _chunks(clouds):
    for start in range(0, len(clouds), CHUNK):
        yield clouds[start : start + CHUNK]
