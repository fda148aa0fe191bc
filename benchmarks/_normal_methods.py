"""Normals of a cloud by PCA, jets, Open3D and this package, and how far they are off."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

PCA_NEIGHBORS = (8, 18, 50, 112, 160, 250)
# The two oracles choose among these as well.
ORACLE_NEIGHBORS = (8, 12, 18, 32, 50, 80, 112, 160, 250, 360, 500)
JET_NEIGHBORS = (18, 50, 112)
OPEN3D_NEIGHBORS = 30  # what Open3D takes by itself
OUR_FORMS = {  # the largest neighborhoods first: the others reuse their search
    "ours, k = 112": {"n_neighbors": 112},
    "ours, default": {},
    "ours, neighbor_planes=False": {"neighbor_planes": False},
    "ours, auto": {"n_neighbors": "auto"},
}
# Singular values of a jet's equations below this share of the largest are zero.
JET_RCOND = 1e-12


class Estimate(NamedTuple):
    """Angles between the normals that a method finds and the true ones.

    method : its name in tables
    n_neighbors : members of a neighborhood; None where each point has its own
    angles : float64 (m,), in degrees, 0 ... 90
    """

    method: str
    n_neighbors: int | None
    angles: np.ndarray


class Errors(NamedTuple):
    """Errors of the normals of a cloud: degrees, then shares in percent."""

    rmse: float
    within_5: float
    within_10: float
    within_20: float
    beyond_45: float


def estimates(points, normals, rows, n_threads=1):
    """What each method finds.

    Parameters
    ----------
    points, normals : ndarray of shape (n, 3)
        A cloud and its true unit normals.
    rows : ndarray of int of shape (m,)
        Points that are judged.
    n_threads : int

    Returns
    -------
    list of Estimate
        Open3D is missing if it cannot be imported.
    """
    truth = normals[rows]
    most = min(max(ORACLE_NEIGHBORS), len(points))
    _, neighbors = cKDTree(points).query(points[rows], most, workers=n_threads)
    members = points[neighbors] - points[rows][:, None]  # one search serves all sizes

    by_size = {
        k: unoriented_angles(pca_normals(members[:, :k]), truth)
        for k in sorted({*PCA_NEIGHBORS, *ORACLE_NEIGHBORS})
    }
    found = [Estimate(f"PCA, k = {k}", k, by_size[k]) for k in PCA_NEIGHBORS]
    best = min(by_size, key=lambda k: errors(by_size[k]).rmse)
    found.append(Estimate("PCA, best k of the cloud", best, by_size[best]))
    least = np.min(list(by_size.values()), axis=0)
    found.append(Estimate("PCA, best k of each point", None, least))

    for k in JET_NEIGHBORS:
        angles = unoriented_angles(jet_normals(members[:, :k]), truth)
        found.append(Estimate(f"jet, k = {k}", k, angles))
    by_open3d = open3d_normals(points)
    if by_open3d is not None:
        angles = unoriented_angles(by_open3d[rows], truth)
        found.append(Estimate(f"Open3D, k = {OPEN3D_NEIGHBORS}", OPEN3D_NEIGHBORS, angles))
    for name, estimator in our_estimators(points, n_threads).items():
        angles = unoriented_angles(estimator.normals_[rows], truth)
        k = estimator.n_neighbors
        found.append(Estimate(name, None if k == "auto" else k, angles))
    return found


def unoriented_angles(found, truth):
    """Angles in degrees between two arrays of unit normals, 90 at most."""
    cosines = np.abs(np.einsum("nd,nd->n", found, truth))
    return np.degrees(np.arccos(np.minimum(cosines, 1.0)))


def errors(angles):
    """Errors by angles in degrees."""
    within = (100 * float(np.mean(angles <= limit)) for limit in (5, 10, 20))
    rmse = float(np.sqrt(np.mean(np.square(angles))))
    return Errors(rmse, *within, 100 * float(np.mean(angles > 45)))


def pca_normals(members):
    """Normals by least squares of neighborhoods (m, k, 3)."""
    return principal_axes(members)[:, :, 0]


def jet_normals(members):
    """Normals at the origin of the quadric that fits each neighborhood (m, k, 3) best.

    The quadric is a height over the plane of least squares (Cazals and Pouget's jet of order 2).
    """
    axes = principal_axes(members)
    places = members @ axes
    places /= np.abs(places).max(axis=(1, 2), keepdims=True) + np.finfo(float).tiny
    height, u, v = np.moveaxis(places, 2, 0)
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=2)
    transposed = terms.transpose(0, 2, 1)
    inverse = np.linalg.pinv(transposed @ terms, rcond=JET_RCOND, hermitian=True)
    coefficients = (inverse @ transposed @ height[:, :, None])[:, :, 0]
    upright = np.column_stack([np.ones(len(axes)), -coefficients[:, 1], -coefficients[:, 2]])
    upright /= np.linalg.norm(upright, axis=1, keepdims=True)
    return np.einsum("nij,nj->ni", axes, upright)


def principal_axes(members):
    """Axes of each neighborhood in columns, the normal first."""
    centered = members - members.mean(axis=1, keepdims=True)
    return np.linalg.eigh(centered.transpose(0, 2, 1) @ centered)[1]


def open3d_normals(points):
    """Normals of all points by Open3D; None if it cannot be imported."""
    try:
        import open3d
    except (ImportError, OSError):  # the second one without libusb
        return None
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(OPEN3D_NEIGHBORS))
    return np.asarray(cloud.normals)


def our_estimators(points, n_threads):
    """Fitted estimators by name. They share one search, since all of them live."""
    from sklearn_mcmd import RobustNormalEstimator

    return {
        name: RobustNormalEstimator(random_state=0, n_jobs=n_threads, **form).fit(points)
        for name, form in OUR_FORMS.items()
    }
