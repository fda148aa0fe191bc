"""Features of cleaned neighborhoods by name: shape, direction, accuracy and curvature.

Names and formulas are those of M. Weinmann, B. Jutzi, S. Hinz, C. Mallet, "Semantic point
cloud interpretation based on optimal neighborhoods, relevant features and efficient
classifiers", ISPRS Journal 105 (2015) 286-304. They use the eigenvalues l_0 <= l_1 <= l_2, which
are variances, and their shares e_i of the sum. Roughness is CloudCompare's, but for the plane
without outliers. jakteristics agrees except for units: its "omnivariance" and "eigenentropy" are
not divided by the eigenvalues' sum. pgeof takes the roots of the eigenvalues, standard deviations,
for all features but "Eigentropy" and "Verticality".

The shape index is that of J. J. Koenderink, A. J. van Doorn, "Surface shape and curvature scales",
Image and Vision Computing 10 (1992) 557-564.
"""

from collections.abc import Callable
from operator import attrgetter

import numpy as np
from scipy.special import entr


def roughness(planes, points):
    """Distance of the point to the plane of its cleaned neighborhood, in units of X."""
    return np.abs(np.einsum("ij,ij->i", points - planes.centroids, planes.normals))


def omnivariance(planes, points):
    """Geometric mean of the shares e_i: 1/3 in a ball."""
    # Take roots before the product, because the product of three small shares could underflow.
    shares = _shares(planes)
    return np.prod(shares ** (1.0 / shares.shape[1]), axis=1)


def shape_index(curvatures):
    """-1 in a cup, -0.5 in a rut, 0 on a saddle and on a plane, 0.5 on a ridge, 1 on a cap."""
    total = curvatures.max_curvature + curvatures.min_curvature
    difference = curvatures.max_curvature - curvatures.min_curvature
    return 0.0 - 2 / np.pi * np.arctan2(total, difference)


# Functions of Planes and their points (m, d).
OF_PLANES = {
    "linearity": lambda planes, points: _difference(planes, -1, -2),  # 1 on a line
    "planarity": lambda planes, points: _difference(planes, -2, -3),  # 1 on a disc
    "sphericity": lambda planes, points: _part(planes.eigenvalues[:, 0], planes),  # 1 in a ball
    "omnivariance": omnivariance,
    "anisotropy": lambda planes, points: _difference(planes, -1, 0),  # 0 in a ball
    # 0 on a line, ln 3 in a ball
    "eigenentropy": lambda planes, points: entr(_shares(planes)).sum(axis=1),
    # 0 on a floor, 1 on a wall
    "verticality": lambda planes, points: 1.0 - np.minimum(np.abs(planes.normals[:, -1]), 1.0),
    "roughness": roughness,
    "normal_error": lambda planes, points: planes.normal_error,
    "removed_fraction": lambda planes, points: 1.0 - planes.kept,
}
# Functions of Curvatures.
OF_CURVATURES: dict[str, Callable] = {
    "mean_curvature": lambda curvatures: (curvatures.max_curvature + curvatures.min_curvature) / 2,
    "gaussian_curvature": lambda curvatures: curvatures.max_curvature * curvatures.min_curvature,
    "max_curvature": attrgetter("max_curvature"),
    "min_curvature": attrgetter("min_curvature"),
    "shape_index": shape_index,
    "mean_curvature_error": attrgetter("mean_error"),
    "max_curvature_error": attrgetter("max_error"),
    "min_curvature_error": attrgetter("min_error"),
    "max_curvature_direction": attrgetter("max_direction"),
    "min_curvature_direction": attrgetter("min_direction"),
}
# In the order of "all".
FEATURES = (*OF_PLANES, *OF_CURVATURES)
VECTORS = ("max_curvature_direction", "min_curvature_direction")
# What features of curvatures are for a normal of the other side: a sign, and a feature of this one.
FLIPPED = {
    "mean_curvature": (-1, "mean_curvature"),
    "shape_index": (-1, "shape_index"),
    "max_curvature": (-1, "min_curvature"),
    "min_curvature": (-1, "max_curvature"),
    "max_curvature_error": (1, "min_curvature_error"),
    "min_curvature_error": (1, "max_curvature_error"),
    "max_curvature_direction": (1, "min_curvature_direction"),
    "min_curvature_direction": (1, "max_curvature_direction"),
}
# In 3D only. The first two add up to one with sphericity.
SPATIAL = ("linearity", "planarity", *OF_CURVATURES)


def check_features(names, d=3):
    """Check the names of features in d dimensions: a tuple of str.

    `names` is None, one name, a sequence of names, or "all" for all features that exist in d
    dimensions. A name that is unknown, given twice, or of a feature that only 3D has raises a
    ValueError.
    """
    if names is None:
        return ()
    if isinstance(names, str):
        if names == "all":
            return tuple(name for name in FEATURES if d == 3 or name not in SPATIAL)
        names = [names]
    names = tuple(names)
    for name in names:
        if not isinstance(name, str) or name not in FEATURES:
            raise ValueError(f"features={name!r} is not known: take {', '.join(FEATURES)}, or all.")
        if name in SPATIAL and d != 3:
            possible = ", ".join(check_features("all", d))
            raise ValueError(
                f"features={name!r} is defined in 3D only and X has {d} features: take {possible}."
            )
    if len(set(names)) < len(names):
        raise ValueError(f"features={list(names)!r} has a name twice; give each once.")
    return tuple(str(name) for name in names)


def feature_columns(names, coordinates):
    """Names of the columns of features: one each, or one for each coordinate of a vector."""
    return [
        column
        for name in names
        for column in (
            [f"{name}_{coordinate}" for coordinate in coordinates] if name in VECTORS else [name]
        )
    ]


def with_flipped(names):
    """The names of features, and of all that tell what these are for normals of the other side."""
    return tuple(dict.fromkeys([*names, *(FLIPPED[name][1] for name in names if name in FLIPPED)]))


def flip_columns(columns, names):
    """Columns (m, n) of normals, and of features by their names, for normals of the other side.

    Normals are the first three.
    """
    new = columns.copy()
    new[:, :3] = -columns[:, :3]
    for i, name in enumerate(names):
        base, end = name, ""
        if name[:-2] in VECTORS:
            base, end = name[:-2], name[-2:]
        if base in FLIPPED:
            sign, mirrored = FLIPPED[base]
            new[:, i] = sign * columns[:, names.index(mirrored + end)]
    return new


def needs_curvatures(names):
    """Whether any of the features is a function of curvatures."""
    return any(name in OF_CURVATURES for name in names)


def evaluate_features(names, planes, points, curvatures=None):
    """Columns (m, n_columns) of the features of points (m, d) and their planes.

    `curvatures` is None where no feature needs them.
    """
    columns = [np.empty((len(points), 0))]
    for name in names:
        if name in OF_CURVATURES:
            columns.append(OF_CURVATURES[name](curvatures))
        else:
            columns.append(OF_PLANES[name](planes, points))
    return np.column_stack(columns)


def _difference(planes, larger, smaller):
    """Difference of two eigenvalues, as part of the largest."""
    return _part(planes.eigenvalues[:, larger] - planes.eigenvalues[:, smaller], planes)


def _part(part, planes):
    """Part of the largest eigenvalue; 0 where all points coincide."""
    most = planes.eigenvalues[:, -1]
    return np.divide(part, most, out=np.zeros(len(part)), where=most > 0)


def _shares(planes):
    """Eigenvalues over their sum (e_i); 0 where all points coincide."""
    total = planes.eigenvalues.sum(axis=1, keepdims=True)
    zeros = np.zeros_like(planes.eigenvalues)
    return np.divide(planes.eigenvalues, total, out=zeros, where=total > 0)
