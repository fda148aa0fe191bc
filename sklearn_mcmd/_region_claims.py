"""Points that no region reached, and the regions whose planes claim them."""

import numpy as np

__all__ = ["claim_rest"]

# Standard deviations of a plane's noise within which it claims a point.
CUTOFF = 3.0
MAX_ROUNDS = 50
# Neighbors looked at at once: what bounds the memory.
CHUNK = 500_000


def claim_rest(index, normals, graph, noise, labels, max_gap=None):
    """Give points without a region the label of the neighbor whose plane is nearest.

    A plane claims a point that is within `CUTOFF` standard deviations of it and not farther
    from the plane's own point than that one's neighbors are. Points claimed in one round may
    claim others in the next: the outcome depends on no order.

    Parameters
    ----------
    index : NeighborIndex
    normals : ndarray of shape (n, d)
    graph : NeighborLinks
        For the planes' offsets and radii.
    noise : ndarray of shape (n,) or float
        Standard deviations of the planes; a float is the largest distance itself.
    labels : ndarray of int of shape (n,)
        -1 for points without a region.
    max_gap : float, default=None
        Largest distance of a neighbor instead of the planes' radii.

    Returns
    -------
    labels : ndarray of int of shape (n,)
    """
    labels = labels.copy()
    limit = np.broadcast_to(CUTOFF * noise if np.ndim(noise) else float(noise), labels.shape)
    reach = graph.radius if max_gap is None else np.full(len(labels), float(max_gap))
    rest = np.flatnonzero(labels < 0)
    step = max(1, CHUNK // index.n_neighbors)
    candidates = [
        _claimants(index, normals, graph.offset, limit, reach, rest[start : start + step])
        for start in range(0, len(rest), step)
    ]
    if not candidates:
        return labels
    neighbors, shares = (np.concatenate(parts) for parts in zip(*candidates, strict=True))
    for _ in range(MAX_ROUNDS):
        shares_now = np.where(labels[neighbors] >= 0, shares, np.inf)
        best = shares_now.argmin(axis=1)
        each = np.arange(len(rest))
        claimed = np.isfinite(shares_now[each, best])
        if not claimed.any():
            break
        labels[rest[claimed]] = labels[neighbors[each, best]][claimed]
        rest, neighbors, shares = rest[~claimed], neighbors[~claimed], shares[~claimed]
    return labels


def _claimants(index, normals, offset, limit, reach, rows):
    """Neighbors of rows, and each one's distance as a share of its limit; inf beyond."""
    points, k = index.points, index.n_neighbors
    distances, neighbors = index.tree.query(points[rows], k=k)
    distances, neighbors = distances.reshape(-1, k), neighbors.reshape(-1, k)
    deviations = points[rows][:, None] - points[neighbors]
    heights = np.einsum("mkd,mkd->mk", deviations, normals[neighbors])
    heights = np.abs(heights - offset[neighbors])
    usable = (heights <= limit[neighbors]) & (distances <= reach[neighbors])
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(heights > 0, heights / limit[neighbors], 0.0)
    return neighbors.astype(np.int32), np.where(usable, shares, np.inf)
