"""uLSIF: outliers by the ratio of the densities of regular and of all points."""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from sklearn_mcmd.baselines._fits import SHARE, Method, Verdict, flag_share
from sklearn_mcmd.baselines._mcd import McdLimits, fit_mcd

POINTS_AT_ONCE = 20_000  # whose kernels are in memory


class RatioLimits(NamedTuple):
    """Training points, kernels, and what widths and regularizations are chosen from."""

    training_fraction: float = 0.5  # of the members is central, by the MCD
    n_starts: int = 50  # of that MCD
    max_basis: int = 100  # kernels, at most
    most_left_out: int = 1000  # pairs that suffice to compare widths
    widths: tuple = tuple(10.0 ** np.linspace(-1, 1, 9))  # in median distances of training points
    regularizations: tuple = tuple(10.0 ** np.linspace(-3, 1, 9))


@dataclass(frozen=True)
class Ulsif(Method):
    """Density ratio of training and test points by least squares (Eqs 6-8).

    The ratio is a sum of Gaussian kernels at training points, with weights in closed form. Width
    and regularization have the best leave-one-out score, also in closed form. The ratio is small
    at points that the training points do not explain. The score is minus the ratio.

    The test points are the members of a neighborhood. The training points must be regular: the
    half of the members that is central by the minimum covariance determinant is taken.

    Parameters
    ----------
    contamination : float in [0, 0.5], default=None
        Share of each neighborhood that is removed: the members with the highest scores. The
        method has no cut-off of its own. None removes nothing.

    References
    ----------
    .. [1] T. Kanamori, S. Hido, M. Sugiyama, "A least-squares approach to direct importance
       estimation", Journal of Machine Learning Research 10 (2009) 1391-1445.
    .. [2] S. Hido, Y. Tsuboi, H. Kashima, M. Sugiyama, T. Kanamori, "Statistical outlier
       detection using direct density ratio estimation", Knowledge and Information Systems
       26 (2011) 309-336.
    """

    has_cutoff: ClassVar[bool] = False
    _parameter_constraints: ClassVar[dict] = SHARE
    contamination: float | None = None

    def table_shape(self, size: int, d: int) -> tuple[int, int]:
        # The last row is the random order of the members; the other rows are the MCD's starts.
        return (1 if size >= McdLimits().nested_from else RatioLimits().n_starts + 1), size

    def _fit(self, points, table, floor):
        # Step 1: training points are central, and kernels stand at the first of them.
        n_sets, shuffled = len(points), table[-1]
        training = self._training(points, table, floor)
        basis = training[:, : RatioLimits().max_basis]
        gaps = training - np.median(training, axis=1, keepdims=True)
        usual = np.median(np.sqrt(np.square(gaps).sum(axis=-1)), axis=1)
        candidates = np.maximum(usual, floor)[:, None] * RatioLimits().widths
        # Step 2: the width and the regularization with the best leave-one-out score.
        best = np.full(n_sets, np.inf)
        width, weights = np.ones(n_sets), np.zeros((n_sets, basis.shape[1]))
        for widths in candidates.T:
            test_kernels = gaussian_kernels(basis, points[:, shuffled], widths)
            training_kernels = gaussian_kernels(basis, training, widths)
            moments = second_moments(test_kernels)
            for regularization in RatioLimits().regularizations:
                score = leave_one_out_score(test_kernels, training_kernels, regularization, moments)
                better = score < best
                best[better], width[better] = score[better], widths[better]
                weights[better] = ratio_weights(
                    moments[better], training_kernels[better], regularization
                )
        model = RatioModel(basis, width, weights)
        scores = model.score(points)
        inliers, cutoff = flag_share(scores, self.contamination)
        return Verdict(model, scores, inliers, cutoff)

    def _training(self, points, table, floor):
        """The central members (B, m, d), in random order."""
        (_, n, d), shuffled = points.shape, table[-1]
        mcd = fit_mcd(points, table[:-1, : d + 1], 0.5, floor)
        m = max(d + 1, int(np.ceil(round(RatioLimits().training_fraction * n, 9))))
        squares = mcd.raw_squares[:, shuffled]
        central = np.sort(np.argsort(squares, axis=1, kind="stable")[:, :m], axis=1)
        return np.take_along_axis(points[:, shuffled], central[..., None], 1)


@dataclass(frozen=True)
class RatioModel:
    """Minus the weighted sum of Gaussian kernels: width (B,), basis (B, b, d), weights (B, b)."""

    basis: np.ndarray
    width: np.ndarray
    weights: np.ndarray

    def score(self, points):
        scores = np.empty(points.shape[:2])
        for start in range(0, points.shape[1], POINTS_AT_ONCE):
            part = slice(start, start + POINTS_AT_ONCE)
            kernels = gaussian_kernels(self.basis, points[:, part], self.width)
            scores[:, part] = -np.einsum("bl,blm->bm", self.weights, kernels)
        return scores


def gaussian_kernels(basis, points, widths):
    """exp(-|x - c|^2 / (2 s^2)), (B, b, m), of points (B, m, d) around a basis (B, b, d)."""
    # |x - c|^2 by one product of matrices; rounding may leave a little less than zero.
    squares = np.square(basis).sum(axis=-1)[..., None] + np.square(points).sum(axis=-1)[:, None]
    squares = np.maximum(squares - 2.0 * basis @ np.swapaxes(points, 1, 2), 0.0)
    return np.exp(-0.5 * squares / np.square(widths)[:, None, None])


def second_moments(kernels):
    """Mean products (B, b, b) of kernels (B, b, n)."""
    return kernels @ np.swapaxes(kernels, 1, 2) / kernels.shape[2]


def ratio_weights(moments, training_kernels, regularization):
    """Weights (B, b) of the ratio, ``max(0, (H + lambda I)^-1 h)``.

    H are the second moments of the test kernels, h is the mean of the training kernels (B, b, m).
    """
    matrix = moments + regularization * np.eye(moments.shape[1])
    return np.maximum(
        np.linalg.solve(matrix, training_kernels.mean(axis=2)[..., None])[..., 0], 0.0
    )


def leave_one_out_score(test_kernels, training_kernels, regularization, moments):
    """Mean loss (B,) of leaving out one test and one training point at a time, in closed form.

    The i-th of both are left out together, for i up to the smaller number or `most_left_out`. The
    weights are found without them, and the loss ``w(test)^2 / 2 - w(training)`` is taken at them
    (Kanamori, Hido and Sugiyama, 2009, section 2.4).
    """
    n, m = test_kernels.shape[2], training_kernels.shape[2]
    both = min(n, m, RatioLimits().most_left_out)
    test, training = test_kernels[..., :both], training_kernels[..., :both]
    matrix = moments + regularization * (n - 1) / n * np.eye(moments.shape[1])
    mean = training_kernels.mean(axis=2)[..., None]
    solved = np.linalg.solve(matrix, np.concatenate([mean, test, training], axis=2))
    from_mean, from_test, from_training = np.split(solved, [1, both + 1], axis=2)
    # Sherman and Morrison's formula takes a test point's own part out of the matrix.
    denominator = n - (test * from_test).sum(axis=1)
    by_mean = from_mean + from_test * ((mean * from_test).sum(axis=1) / denominator)[:, None]
    by_own = from_training + from_test * ((training * from_test).sum(axis=1) / denominator)[:, None]
    weights = (n - 1) / (n * (m - 1)) * (m * by_mean - by_own)
    weights = np.maximum(weights, 0.0)
    at_test, at_training = (test * weights).sum(axis=1), (training * weights).sum(axis=1)
    return 0.5 * np.square(at_test).mean(axis=1) - at_training.mean(axis=1)
