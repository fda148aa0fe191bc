"""Cross-validation on one cloud, by blocks that keep their neighbors."""

from collections.abc import Iterator
from numbers import Integral

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree
from sklearn.model_selection import BaseCrossValidator
from sklearn.utils import check_array, check_random_state

from sklearn_mcmd._sklearn import Interval, checked

# Extents are measured between these percentiles, so that a single far point changes no cut.
BULK = 5, 95
BLOCKS_OF_FOLD = 4  # places of the cloud that a fold mixes


@checked(X=["array-like"], n_blocks=[Interval(Integral, 1, None, closed="left")])
def spatial_blocks(X: "ArrayLike", n_blocks: int) -> NDArray[np.intp]:
    """Cut a cloud into boxes of nearly equal numbers of points.

    The cloud is halved across its longest side. Then each half is halved in the same way, and so
    on.

    Parameters
    ----------
    X : array-like of shape (n_samples, n_features)
        Coordinates.
    n_blocks : int
        Number of blocks, at most n_samples.

    Returns
    -------
    blocks : ndarray of int of shape (n_samples,)
        Block of each point, 0 to ``n_blocks - 1``. Scikit-learn's splitters take it as ``groups``.

    Raises
    ------
    ValueError
        If X has NaN or infinite values, or fewer points than `n_blocks`.

    See Also
    --------
    SpatialBlockSplit : Folds of such blocks with the neighbors they need.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.model_selection import spatial_blocks
    >>> spatial_blocks(np.array([[0.0, 5.0], [1.0, 5.1], [9.0, 5.2], [10.0, 5.3]]), 2)
    array([0, 0, 1, 1])
    """
    points: NDArray[np.float64] = check_array(X, dtype=np.float64)
    if n_blocks > len(points):
        raise ValueError(f"n_blocks={n_blocks} is more than n_samples={len(points)}; take fewer.")
    blocks = np.empty(len(points), dtype=np.intp)
    left = [(np.arange(len(points)), 0, n_blocks)]
    while left:
        rows, first, count = left.pop()
        if count == 1:
            blocks[rows] = first
            continue
        low, high = np.percentile(points[rows], BULK, axis=0)
        along = points[rows, np.argmax(high - low)]
        n_before = count // 2
        order = np.argsort(along, kind="stable")
        # In proportion to the blocks on both sides, whose numbers differ if theirs is odd.
        cut = len(rows) * n_before // count
        left += [
            (rows[order[:cut]], first, n_before),
            (rows[order[cut:]], first + n_before, count - n_before),
        ]
    return blocks


class SpatialBlockSplit(BaseCrossValidator):
    """Folds of spatial blocks, each with the neighbors that its points are judged by.

    A detector of local outliers judges a point by its neighbors. Other splitters fit on one part
    of a cloud and score another. Then the points of a held-out block have no neighbors (blocks as
    groups), or all neighborhoods are thinner (random folds), and the score is that of another
    task. Here the test points of a fold are whole blocks. Its training points are the same blocks
    and the nearest neighbors of their points. So the labels of a block are the same as in the
    whole cloud if the detector looks no farther. They are nearly the same for a detector that
    asks how large the surface or the group of a point is.

    Parameters
    ----------
    n_splits : int, default=5
        Number of folds, at least 2. Each has four blocks at random, and so mixes places.
    n_neighbors : int, default=50
        Size of the largest neighborhood in the search. Every test point finds this number of
        nearest neighbors, itself included, among the training points.
    n_rings : int, default=1
        Number of times that neighbors are added. 1 suffices for a detector that looks at the
        neighbors of a point, as `MCMDOutlierDetector` does with ``strictness=None``. A detector
        that also looks at their neighbors needs more: 2 if planes are borrowed or compared among
        neighbors, 3 for :class:`~sklearn.neighbors.LocalOutlierFactor` and for the default
        `MCMDOutlierDetector`. About 1 % of the latter's scores then still differ from those in
        the whole cloud.
    random_state : int, RandomState instance or None, default=None
        Seed of the order in which blocks are dealt.

    See Also
    --------
    spatial_blocks : The blocks alone.
    sklearn.model_selection.GroupKFold : Disjoint folds, for classifiers of points.

    Notes
    -----
    *Training and test points overlap on purpose*. That is correct for detectors that are fitted
    without labels: labels only score, once for each point, in the fold of its block. It is a
    leak for estimators that learn from y. For these take ``GroupKFold`` with `spatial_blocks`.

    ``LocalOutlierFactor(novelty=True)`` takes a test point of its own training cloud as its own
    nearest neighbor. That one of `n_neighbors` tells nothing, which shifts its scores a little.
    With ``MCMDOutlierDetector`` a point belongs to its neighborhood by definition.

    A fold without any outlier has no ROC-AUC: take fewer folds.

    Examples
    --------
    >>> from sklearn.model_selection import GridSearchCV
    >>> from sklearn_mcmd import MCMDOutlierDetector
    >>> from sklearn_mcmd.datasets import make_street
    >>> from sklearn_mcmd.model_selection import SpatialBlockSplit
    >>> street = make_street(900, outlier_share=0.1, random_state=0)
    >>> search = GridSearchCV(
    ...     MCMDOutlierDetector(random_state=0),
    ...     {"n_neighbors": [10, 30]},
    ...     scoring=["balanced_accuracy", "roc_auc"],
    ...     refit="balanced_accuracy",
    ...     cv=SpatialBlockSplit(2, n_neighbors=30, random_state=0),
    ... ).fit(street.data, street.target)
    >>> search.best_params_
    {'n_neighbors': 30}
    """

    def __init__(
        self,
        n_splits: int = 5,
        *,
        n_neighbors: int = 50,
        n_rings: int = 1,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.n_splits = n_splits
        self.n_neighbors = n_neighbors
        self.n_rings = n_rings
        self.random_state = random_state

    def get_n_splits(self, X: object = None, y: object = None, groups: object = None) -> int:
        """Number of folds.

        Parameters
        ----------
        X, y, groups : Ignored

        Returns
        -------
        n_splits : int
        """
        return self.n_splits

    def split(
        self, X: "ArrayLike", y: object = None, groups: object = None
    ) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
        """Indices of the training and test points of each fold.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Coordinates.
        y, groups : Ignored

        Yields
        ------
        train, test : ndarray of int
            Ascending; `test` is part of `train`.

        Raises
        ------
        ValueError
            If a parameter is out of range, or X has too few points for it.
        """
        points: NDArray[np.float64] = check_array(X, dtype=np.float64)
        self._check_parameters(len(points))
        blocks = spatial_blocks(points, BLOCKS_OF_FOLD * self.n_splits)
        fold_of_block = np.arange(BLOCKS_OF_FOLD * self.n_splits) % self.n_splits
        check_random_state(self.random_state).shuffle(fold_of_block)
        fold = fold_of_block[blocks]
        tree = cKDTree(points)
        for i in range(self.n_splits):
            inside = fold == i
            front = test = np.flatnonzero(inside)
            for _ in range(self.n_rings):  # neighbors of what the ring before has added
                near = np.zeros(len(points), dtype=np.bool_)
                near[tree.query(points[front], k=self.n_neighbors)[1].ravel()] = True
                front = np.flatnonzero(near & ~inside)
                inside |= near
            yield np.flatnonzero(inside), test

    def _check_parameters(self, n_samples):
        most_folds = n_samples // BLOCKS_OF_FOLD
        for name, least, most in (
            ("n_splits", 2, most_folds),
            ("n_neighbors", 2, n_samples),
            ("n_rings", 1, np.inf),
        ):
            value = getattr(self, name)
            if not isinstance(value, Integral) or isinstance(value, bool):
                raise ValueError(f"{name}={value!r} must be an integer.")
            if value < least:
                raise ValueError(f"{name}={value} is too few: at least {least} are needed.")
            if int(value) > most:
                raise ValueError(f"{name}={value} is too many for n_samples={n_samples}.")
