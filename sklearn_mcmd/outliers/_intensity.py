"""How much light came back from each point, against all others: in any unit and on any scale."""

import numpy as np
from sklearn.utils import check_array


def ranks_of_intensity(intensity, index, n):
    """The share of the points of an index that returned less than each, and half of the equal.

    None if `intensity` (n,) is None or the same everywhere. Copies have the largest of theirs: as
    ranks it needs no scale, and it doubts least, since one bright return tells a solid place.
    """
    if intensity is None:
        return None
    if np.shape(intensity) != (n,):
        shape = np.shape(intensity)
        raise ValueError(f"intensity must have the shape ({n},) of the points; got {shape}.")
    given = check_array(intensity, dtype=np.float64, ensure_2d=False, input_name="intensity")
    largest = given[index.rows]
    np.maximum.at(largest, index.places, given)
    values, place, counts = np.unique(largest, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(counts) - counts / 2) / len(largest)
    return ranks[place] if len(values) > 1 else None
