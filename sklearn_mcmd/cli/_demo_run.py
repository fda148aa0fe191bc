"""The parts of ``mcmd demo``: a street with known truth, and the accuracy of the results."""

import io

import numpy as np

from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import PointCloud, PointFileError, read_points, write_points
from sklearn_mcmd.io._files import replacing
from sklearn_mcmd.metrics import bias_angle
from sklearn_mcmd.normals._estimator import RobustNormalEstimator
from sklearn_mcmd.plotting._still import plot_before_after
from sklearn_mcmd.runtime._progress import progress_part

__all__ = ["draw", "made_by_demo", "normal_errors", "outlier_rates", "write_street"]

N_POINTS = 60_000
OUTLIER_SHARE = 0.1
LEVEL = 0.1  # z of the true normal of an upright face is less
COLORS = 160  # of the picture's palette, which reduces the file to a third


def made_by_demo(path):
    """Whether a file is the street of an earlier run: it then holds the truth."""
    try:
        return {"true_outlier", "true_normal_x"} <= read_points(path).attributes.keys()
    except PointFileError:
        return False


def write_street(path):
    """Write a contaminated street, the truth of each point as attributes."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as err:
        reason = (err.strerror or str(err)).lower()
        raise PointFileError(f"{path.parent}: the folder cannot be made: {reason}") from err
    street = make_street(N_POINTS, outlier_share=OUTLIER_SHARE, random_state=0)
    truth = {
        "true_outlier": (street.target == -1).astype(np.uint8),
        "outlier_kind": street.outlier_kind.astype(np.uint8),
        "edge_distance": street.edge_distance.astype(np.float32),
    }
    for axis, values in zip("xyz", street.normals.T, strict=True):
        truth[f"true_normal_{axis}"] = values.astype(np.float32)
    # Tenths of a millimeter, as a scanner writes.
    write_points(path, PointCloud(np.round(street.data, 4), truth))


def outlier_rates(street, clean):
    """Accuracy of the removal, from the two files alone: both hold the truth."""
    is_outlier = read_points(street).attributes["true_outlier"] == 1
    missed = read_points(clean).attributes["true_outlier"] == 1
    n_outliers, n_regular = np.count_nonzero(is_outlier), np.count_nonzero(~is_outlier)
    n_found, n_kept = n_outliers - np.count_nonzero(missed), np.count_nonzero(~missed)
    return {
        "outliers found": n_found / n_outliers,
        "regular points kept": n_kept / n_regular,
        "accuracy": (n_found + n_kept) / len(is_outlier),
    }


def normal_errors(street, n_jobs):
    """Median and 95 % quantile of the angle to the true normal, in degrees, by method."""
    cloud = read_points(street)
    true_normals = _stack(cloud, "true_normal_")
    has_normal = np.isfinite(true_normals).all(axis=1)
    errors = {}
    for begin, method in ((0.0, "pca"), (0.5, "mcmd_z")):
        estimator = RobustNormalEstimator(method=method, random_state=0, n_jobs=n_jobs)
        with progress_part(begin, begin + 0.5):
            fitted = estimator.fit(cloud.xyz)
        angles = bias_angle(fitted.normals_[has_normal], true_normals[has_normal])
        errors[method] = (np.median(angles), np.quantile(angles, 0.95))
    return errors


def draw(street, clean, with_normals, path):
    """Draw the three files side by side into a PNG."""
    import matplotlib

    matplotlib.use("agg")
    from PIL import Image

    before, after = read_points(street), read_points(clean)
    normals = _stack(read_points(with_normals), "normal_")
    fig = plot_before_after(
        before.xyz,
        before.attributes["true_outlier"] == 1,
        after.xyz,
        after.attributes["true_outlier"] == 1,
        normals,
    )
    fig.axes[2].text(
        *(1.0, 0.0, _sides(normals, _stack(after, "true_normal_"))),
        **{"transform": fig.axes[2].transAxes, "ha": "right", "fontsize": 9, "color": "0.25"},
    )
    raw, small = io.BytesIO(), io.BytesIO()
    fig.savefig(raw, format="png", dpi=110)
    palette = Image.open(raw).convert("RGB").quantize(COLORS, dither=Image.Dither.NONE)
    palette.save(small, format="png", optimize=True)
    with replacing(path) as temporary:
        temporary.write_bytes(small.getvalue())


def _sides(normals, true_normals):
    """How many normals of upright faces look to the true side."""
    upright = np.abs(true_normals[:, 2]) < LEVEL  # NaN of outliers is not
    outward = np.einsum("ij,ij->i", normals, true_normals)[upright] > 0
    return (
        f"{100 * outward.mean():.0f} % of the normals of upright faces look outward, by\n"
        "chance: --orientation sensor or mst gives them a side"
    )


def _stack(cloud, prefix):
    return np.column_stack([cloud.attributes[f"{prefix}{axis}"] for axis in "xyz"])
