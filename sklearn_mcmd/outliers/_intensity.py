"""How much light came back: whether what is isolated is dark, and what darkness then adds."""

from itertools import chain
from math import fsum
from typing import NamedTuple

import numpy as np
from sklearn.utils import check_array

from sklearn_mcmd.planes._explaining import ExplainLimits
from sklearn_mcmd.planes._whole import whole_cloud


class Darkness(NamedTuple):
    """How dark the points of an index are, and how far that tells errors from things."""

    ranks: np.ndarray  # (n,), as of `ranks_of_intensity`
    isolated: np.ndarray  # rows of those whose isolation no surface would explain
    telling: float  # from 0, where these are as bright as all others, to 1, if they are the darkest

    @classmethod
    def of(cls, ranks, rows, isolation):
        """Of points off the surfaces, which are `rows` of the index, with their isolation (m,)."""
        isolated, whole = rows[isolation > ExplainLimits().explained], whole_cloud()
        telling = telling_of([ranks[isolated]]) if whole is None else whole.telling
        return cls(ranks, isolated, telling)

    def factor(self, rows):
        """The factor on the isolation of these points: as far as intensity tells, from 0 of the
        brightest of all to 1.4 of the darkest, 1 in the middle."""
        return np.sqrt(2 * (1 - self.ranks[rows])) ** self.telling


def ranks_of_intensity(intensity, index, n):
    """The share of the points of an index that returned less than each, and half of the equal.

    None if `intensity` (n,) is None or the same everywhere. Copies have the largest of theirs: as
    ranks it needs no scale, and it doubts least, since one bright return tells a solid place. Of a
    part of a cloud, `intensity` has the ranks in the whole.
    """
    if intensity is None:
        return None
    if np.shape(intensity) != (n,):
        shape = np.shape(intensity)
        raise ValueError(f"intensity must have the shape ({n},) of the points; got {shape}.")
    light = check_array(intensity, dtype=np.float64, ensure_2d=False, input_name="intensity")
    largest = light[index.rows]
    np.maximum.at(largest, index.places, light)
    if whole_cloud() is not None:
        return largest
    values, place, counts = np.unique(largest, return_inverse=True, return_counts=True)
    return middle_ranks(counts)[place] if len(values) > 1 else None


def telling_of(parts):
    """How far intensity tells, by the ranks of isolated points, in any parts and order."""
    n = sum(map(len, parts))
    # The mean rank is 1/2 if they are like all points, 0 if they are the darkest.
    return max(0.0, 1 - 2 * fsum(chain.from_iterable(parts)) / n) if n else 0.0


def middle_ranks(counts):
    """The share of all values that are less than each, and half of the equal ones."""
    return (np.cumsum(counts) - counts / 2) / counts.sum()
