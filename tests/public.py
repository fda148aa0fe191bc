"""Every public estimator, and what its results do when the cloud is moved: one table for all.

Estimators are found in the package, so a new one is tested as soon as it is public. What an
attribute does follows from its name; one that is not in the table below must stay the same.
"""

from dataclasses import dataclass
from functools import cache
from importlib import import_module

import numpy as np
from scipy.spatial.transform import Rotation
from sklearn.base import BaseEstimator, clone

import sklearn_mcmd
from sklearn_mcmd import (
    BaardaPlaneDetector,
    MCMDOutlierDetector,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.baselines import PlaneOutlierDetector

NOISE = 0.004  # standard deviation of both clouds, in their unit
# Parameters with the unit of the cloud.
LENGTH_PARAMETERS = {"sigma0", "noise_scale", "radius", "max_distance", "max_gap"}
# What is a length, an area, a direction (of either sign) or a place. All else has no unit.
LENGTHS = {"plane_offset_", "plane_scale_", "region_errors_", "sigma0_"}
LENGTHS |= {"form_.noise", "form_.bow"}
AREAS = {"eigenvalues_", "variance_factor_", "variance_factor_initial_"}
DIRECTIONS = {"normals_", "normal_", "region_normals_"}
PLACES = {"region_centroids_"}
# Numbers of rows: they follow the order of rows.
ROW_NUMBERS = {"plane_index_"}
# Numbers of groups in the order of rows, and what depends on axes or the origin.
LEFT_OUT = {"group_index_", "coef_", "distance_", "intercept_", "features_", "regions_"}
# Strips lie across the level line and the line of fall.
LEFT_OUT |= {"form_.alike_deviation", "form_.alike_dof"}


def public_names():
    """Dotted names of all that the package and its subpackages list as public."""
    found = {}
    for room in sorted(sklearn_mcmd._ROOMS):
        module = import_module(f"sklearn_mcmd.{room}")
        for name in getattr(module, "__all__", ()):
            found[f"{room}.{name}"] = getattr(module, name)
    return found


def _default(cls):
    """An estimator of a public class that gives the same results each time."""
    estimator = cls()
    known = estimator.get_params(deep=False)
    if "random_state" in known:
        estimator.set_params(random_state=0)
    if "sigma0" in known:
        estimator.set_params(sigma0=NOISE)
    return estimator


ESTIMATORS = [
    *(
        _default(thing)
        for thing in public_names().values()
        if isinstance(thing, type) and issubclass(thing, BaseEstimator)
    ),
    MCMDOutlierDetector(strictness="surfaces", random_state=0),
    MCMDOutlierDetector(strictness=None, method="mcmd_md", random_state=0),
    MCMDOutlierDetector(None, random_state=0),
    MCMDOutlierDetector(strictness="isolated", noise_scale=NOISE, random_state=0),
    RobustNormalEstimator("auto", orientation="mst", random_state=0),
    RobustNormalEstimator(20, method="pca", radius=0.3),
    PlaneOutlierDetector(20, method="pca"),
    SharpFeatureDetector(criterion="surface_variation", random_state=0),
    BaardaPlaneDetector(sigma0="auto", surface="orthogonal", test="tau"),
]
ESTIMATORS = {repr(estimator): estimator for estimator in ESTIMATORS}


def corner(n):
    """A floor, a wall and stray points before them."""
    rng = np.random.default_rng(3)
    n_stray = n // 20
    n_floor = (n - n_stray) // 2
    floor = rng.uniform(0, 2, (n_floor, 3)) * [1, 1, 0]
    wall = rng.uniform(0, 2, (n - n_stray - n_floor, 3)) * [1, 0, 1]
    surfaces = np.vstack([floor, wall])
    surfaces += rng.normal(0, NOISE, surfaces.shape)
    return np.vstack([surfaces, rng.uniform(0.3, 1.7, (n_stray, 3))])


def plate(n):
    """A tilted plane of which 1 point in 20 is off."""
    rng = np.random.default_rng(4)
    X = np.column_stack([rng.uniform(-1, 1, (n, 2)), rng.normal(0, NOISE, n)])
    X[: n // 20, 2] += rng.uniform(5, 30, n // 20) * NOISE
    return X @ Rotation.from_euler("xy", [20, -15], degrees=True).as_matrix().T


CLOUDS = {"small": 300, "compiled": 1_200}


@cache
def cloud_for(name, size="small"):
    """The cloud that an estimator is tested with: of one plane for tests of a plane."""
    cloud = plate if hasattr(ESTIMATORS[name], "surface") else corner
    X = np.ascontiguousarray(cloud(CLOUDS[size]))
    X.flags.writeable = False
    return X


def fitted(estimator, X, unit=1.0):
    """A fitted clone, with lengths among its parameters in a unit."""
    estimator = clone(estimator)
    for name, value in estimator.get_params(deep=False).items():
        if name in LENGTH_PARAMETERS and isinstance(value, float):
            estimator.set_params(**{name: unit * value})
    return estimator.fit(X)


def results(estimator, X, new=None):
    """Arrays by name: attributes of an estimator that is fitted to X, labels, and new points."""
    found = {
        name: np.asarray(value)
        for name, value in vars(estimator).items()
        if name.endswith("_") and not name.startswith("_") and name not in LEFT_OUT
    }
    if "form_" in found:  # a record of numbers of several kinds
        del found["form_"]
        form = estimator.form_._asdict().items()
        form = {f"form_.{name}": np.asarray(value) for name, value in form}
        found |= {name: value for name, value in form.items() if name not in LEFT_OUT}
    if hasattr(estimator, "score_samples"):
        found["predicted"] = estimator.predict(X)
    if new is not None:
        for method in ("score_samples", "transform"):
            if hasattr(estimator, method):
                found[method] = np.asarray(getattr(estimator, method)(new))
    return {name: value for name, value in found.items() if value.dtype.kind in "fiub"}


@cache
def expected_results(name, size):
    """Results of an estimator with its own cloud."""
    X = cloud_for(name, size)
    return results(fitted(ESTIMATORS[name], X), X)


@dataclass(frozen=True)
class Motion:
    """``scale * (X @ rotation.T + shift)[order]``."""

    rotation: np.ndarray
    shift: np.ndarray
    scale: float
    order: np.ndarray

    def of(self, X):
        return np.ascontiguousarray((self.scale * (X @ self.rotation.T + self.shift))[self.order])

    def expected(self, name, value):
        if name in PLACES:
            return self.scale * (value @ self.rotation.T + self.shift)
        if value.ndim and len(value) == len(self.order):
            value = value[self.order]
        if name in ROW_NUMBERS:
            return np.argsort(self.order)[value]
        if name in DIRECTIONS:
            return value @ self.rotation.T
        return value * self.scale ** ((name in LENGTHS) + 2 * (name in AREAS))


def row_order(n, order):
    """Nothing but another order of n rows."""
    return Motion(np.eye(3), np.zeros(3), 1.0, np.asarray(order))


def assert_same(found, expected, motion, tolerance):
    """That results are those of the cloud before the motion, but for rounding.

    Whole numbers are the same; labels may differ where the score is within rounding of the limit.
    The other numbers agree to the tolerance: relative, or of the largest of them.
    """
    assert found.keys() == expected.keys()
    for name in found:
        ours, theirs = found[name], motion.expected(name, expected[name])
        assert ours.shape == theirs.shape, name
        if ours.dtype.kind in "iub":
            wrong = ours != theirs
            if name in ("labels_", "predicted") and "scores_" in found:
                wrong &= np.abs(found["scores_"] - found["offset_"]) > tolerance
            # Of two points with the same neighbors either may lend its plane.
            allowed = 0.05 * wrong.size if name == "plane_index_" else 0
            assert wrong.sum() <= allowed, f"{name} differs in {wrong.sum()} of {wrong.size}"
            continue
        if name == "plane_offset_":  # its sign is that of a normal
            ours, theirs = np.abs(ours), np.abs(theirs)
        if name in DIRECTIONS:
            signs = np.sign(np.sum(ours * theirs, axis=-1, keepdims=True))
            ours = ours * signs
        largest = np.abs(theirs[np.isfinite(theirs)]).max(initial=0.0)
        np.testing.assert_allclose(
            ours, theirs, rtol=tolerance, atol=tolerance * largest, err_msg=name
        )
