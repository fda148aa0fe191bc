"""Many contaminated planes at once: the simulations of Section 5.1 as arrays of clouds."""

from dataclasses import dataclass

import numpy as np

from sklearn_mcmd.datasets import make_contaminated_plane


@dataclass(frozen=True)
class Clouds:
    """Independent clouds of one distribution.

    points : (runs, n, 3), rows of each cloud in random order
    clean : the same with regular points in place of outliers: the clean twins of Table 1
    regular : bool (runs, n)
    n_outliers : int, in each cloud
    """

    points: np.ndarray
    clean: np.ndarray
    regular: np.ndarray
    n_outliers: int

    def __len__(self):
        return len(self.points)

    def __getitem__(self, rows):
        return Clouds(self.points[rows], self.clean[rows], self.regular[rows], self.n_outliers)


def contaminated_planes(runs, n, percentage, random_state, **law):
    """Draw `runs` clouds of `n` points of which `percentage` percent are outliers.

    The number of outliers is rounded, but it is at least one, also for 1 % of 20 points. One call
    of `make_contaminated_plane`, which takes `law`, draws all clouds. Rows are shuffled within
    each cloud, because a table of trials must meet outliers at random positions.
    """
    n_outliers = max(1, int(n * percentage / 100 + 0.5)) if percentage > 0 else 0
    n_regular = n - n_outliers
    drawn = make_contaminated_plane(
        runs * n,
        outlier_share=n_outliers / n,
        return_X_y=False,
        random_state=random_state,
        **law,
    )

    def per_run(rows):
        kept, last = rows[: runs * n_regular], rows[runs * n_regular :]
        return np.concatenate(
            [kept.reshape(runs, n_regular, 3), last.reshape(runs, n_outliers, 3)], axis=1
        )

    points, clean = per_run(drawn.data), per_run(drawn.clean)
    order = np.argsort(random_state.random_sample((runs, n)), axis=1)
    rows = np.arange(runs)[:, None]
    return Clouds(points[rows, order], clean[rows, order], order < n_regular, n_outliers)
