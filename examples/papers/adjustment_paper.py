"""The second paper's simulated clouds and its Table 5, for the examples and tests.

Arabsheibani, Abedini, Kanani Sadat, Geodesy and Cartography 41(3), 2015, section 1.3 and
Table 5. The paper states neither the size of its outliers nor their places. The counts in
its table determine both (see `plot_adjustment_table5`). Lengths are in units of s0.
"""

from dataclasses import dataclass

import numpy as np

from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector

# Name of the set -> grid, noise and placement of the outliers that reproduce it best.
SETS = {
    "A": {"shape": (25, 20), "noise": 0.10, "placement": "uniform"},
    "B": {"shape": (100, 50), "noise": 0.15, "placement": "edges"},
    "C": {"shape": (100, 100), "noise": 0.03, "placement": "edges"},
}
OUTLIER_SIZE = 6.0
SLOPES = np.array([0.3, -0.2])


@dataclass(frozen=True)
class Row:
    """A row of Table 5. The paper's Fuzzy column equals `inserted` in all rows."""

    set: str
    inserted: int
    alpha: float
    baarda: int


def _rows(name, columns, fixed, by_alpha):
    alphas = (0.01, 0.05, 0.10, 0.15, 0.20, 0.25)
    rows = [Row(name, inserted, 0.15, count) for inserted, count in columns]
    return rows + [Row(name, fixed, a, count) for a, count in zip(alphas, by_alpha, strict=True)]


TABLE_5 = (
    _rows(
        "A",
        [(10, 10), (40, 40), (60, 60), (80, 80), (100, 140), (120, 320), (160, 500)],
        100,
        (100, 100, 100, 140, 240, 334),
    )
    + _rows(
        "B",
        [(100, 100), (400, 400), (800, 800), (900, 900), (1000, 1300), (1200, 3100)],
        1000,
        (1000, 1000, 1000, 1300, 2400, 3300),
    )
    + _rows(
        "C",
        [
            (100, 100),
            (1000, 1000),
            (2000, 2000),
            (2200, 2200),
            (2300, 2420),
            (2450, 7510),
            (2500, 7900),
        ],
        2000,
        (2000, 2000, 2000, 2000, 3700, 7300),
    )
)


def simulate(name, inserted, random_state=None, **changes):
    """One of the paper's clouds: a grid on a plane, with normal noise and outliers above it.

    Returns
    -------
    X : ndarray of shape (n, 3)
    is_outlier : ndarray of bool of shape (n,)
    """
    return simulate_cloud(inserted, random_state=random_state, **(SETS[name] | changes))


def simulate_cloud(
    inserted, *, shape, noise, placement, size=OUTLIER_SIZE, two_sided=False, random_state=None
):
    """A grid of `shape` with `inserted` outliers of one size, placed in one of five ways."""
    rng = np.random.default_rng(random_state)
    x, y = (axis.ravel() for axis in np.meshgrid(*map(np.arange, shape), indexing="ij"))
    xy = np.column_stack([x, y]).astype(float)
    z = xy @ SLOPES + rng.normal(scale=noise, size=len(xy))
    chosen = _place(xy, inserted, placement, rng)
    signs = rng.choice([-1.0, 1.0], inserted) if two_sided else 1.0
    z[chosen] += size * signs
    is_outlier = np.zeros(len(xy), dtype=bool)
    is_outlier[chosen] = True
    return np.column_stack([xy, z]), is_outlier


def _place(xy, inserted, placement, rng):
    """Indices of the points that become outliers."""
    relative = 2 * xy / xy.max(axis=0) - 1  # -1 ... 1 in both directions
    jitter = 1e-6 * rng.uniform(size=len(xy))  # order among equals
    border = np.abs(relative).max(axis=1)
    if placement == "uniform":
        return rng.choice(len(xy), inserted, replace=False)
    if placement == "edges":  # more outliers near all edges
        density = 0.2 + border**4
        return rng.choice(len(xy), inserted, replace=False, p=density / density.sum())
    distance = {
        "ring": 1 - border,
        "strip": 1 + relative[:, 0],
        "corner": np.hypot(1 + relative[:, 0], 1 + relative[:, 1]),
    }[placement]
    return np.argsort(distance + jitter)[:inserted]


def batch_baarda(alpha, **parameters):
    """The protocol that gives the paper's counts: remove all rejected points, alpha uncorrected."""
    return BaardaPlaneDetector(alpha, correction="none", elimination="all", **parameters)


def detect(X, alpha):
    """Outliers of one cloud by each protocol: name -> bool (n,)."""
    one_by_one = BaardaPlaneDetector(alpha).fit(X)
    batch = batch_baarda(alpha).fit(X)
    found = {
        "batch": batch.elimination_step_ > 0,
        "batch, tested again": batch.labels_ < 0,
        "data snooping": one_by_one.labels_ < 0,
    }
    for width in (1.0, 1.25):
        found[f"fuzzy {width:g}"] = FuzzyPlaneDetector(alpha, width=width).fit(X).labels_ < 0
    found["fuzzy alpha"] = FuzzyPlaneDetector(alpha, width=alpha).fit(X).labels_ < 0
    return found
