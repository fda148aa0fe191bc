"""The cutoff of a stated false-positive rate: the cloud's own points, judged again in parts.

A plane tells what noise does. It has no leaves, no poles, and no far pieces of walls of which the
scanner saw a few points. What such things do must be learnt from the cloud itself, which also
holds the outliers. So the points that are no clear outliers stand for a clean cloud. What they do
among all of them is known, and says nothing of others like them. But scores do not depend on the
unit: they compare spacings with spacings. So a quarter of the points, drawn evenly, is a cloud of
the same kind, in which what was barely large or dense enough before is not any more. The share of
it that is flagged is about the share that a clean scan of such surfaces and things loses.
"""

import numpy as np
from sklearn.base import clone

__all__ = [
    "PARTS",
    "REHEARSED",
    "exceeded_by_share",
    "most_kept",
    "n_parts_of",
    "parts_of",
    "rehearsal_of",
    "shuffled",
]

# Strictnesses that judge by company. On surfaces a plane alone tells the rate.
REHEARSED = ("isolated", "groups")
# Largest scores of the points that are kept: the usual cutoff; and of groups up to a clear error,
# since a real pole or twig may stand off by several of its own sizes.
KEPT_ALONE, KEPT_GROUPS = 3.0, 10.0
# Parts of the kept points. Each is judged by itself.
PARTS = 4
# Neighborhoods that a part has at least: where a fifth of the cloud is more than a thing needs, the
# sizes that decide are those of a large cloud. And points, below which a part is too few.
LEAST_PART, LEAST_POINTS = 10, 1_000
# Odd numbers near fractions of 2 ** 64.
FACTORS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
HALF_WORD = np.uint64(32)


def most_kept(strictness):
    """The largest score of points that are kept."""
    return KEPT_ALONE if strictness == "isolated" else KEPT_GROUPS


def n_parts_of(n_kept, n_neighbors):
    """Parts into which the kept points of a cloud are divided; 0 where these are too few."""
    n_parts = min(PARTS, n_kept // max(LEAST_PART * n_neighbors, LEAST_POINTS))
    return n_parts if n_parts > 1 else 0


def parts_of(X, kept, n_neighbors):
    """The part of each point, from 0 on; -1 of all that are not kept, or if there are no parts."""
    parts = np.full(len(X), -1)
    n_parts = n_parts_of(np.count_nonzero(kept), n_neighbors)
    if n_parts:
        parts[kept] = shuffled(X[kept]) % np.uint64(n_parts)
    return parts


def exceeded_by_share(parts, share):
    """The score that a share of all scores exceeds; 0 if there are no parts."""
    scores = [-part for part in parts]
    if not scores:
        return 0.0
    return -float(np.percentile(np.concatenate(scores), 100 * share))


def shuffled(X):
    """A number for each point that is as good as random, and depends on its digits alone.

    So neither the order of the rows nor tiles matter, copies of a point stay together, and a unit
    that is a power of two times another makes no difference.
    """
    digits, _ = np.frexp(X.astype(np.float64) + 0.0)
    numbers = np.zeros(len(X), np.uint64)
    for values, factor in zip(digits.T, np.resize(FACTORS, X.shape[1]), strict=True):
        numbers = (numbers ^ values.copy().view(np.uint64)) * factor
        numbers ^= numbers >> HALF_WORD
    numbers *= FACTORS[0]  # once more, for the last coordinate
    return numbers ^ (numbers >> HALF_WORD)


def rehearsal_of(detector, step):
    """The detector that judges parts, of a cloud whose coordinates are rounded to a step."""
    rehearsal = clone(detector).set_params(
        false_positive_rate=None, sensor_origin=None, reflections=False
    )
    rehearsal._step_of_cloud = step
    return rehearsal
