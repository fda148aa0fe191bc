"""Two shapes with sharp edges: simulated counterparts of the paper's box-like and crown data."""

from numbers import Real

import numpy as np
from sklearn.utils import Bunch

from sklearn_mcmd._sklearn import Interval, checked
from sklearn_mcmd.datasets._bilinear import Bilinear
from sklearn_mcmd.datasets._scan import SHARED_PARAMETERS, Scene, scan
from sklearn_mcmd.datasets._surfaces import Patch


@checked(**SHARED_PARAMETERS, outlier_scale=[Interval(Real, 0, None, closed="neither")])
def make_box(
    n_samples: int = 3339,
    *,
    noise: float = 0.002,
    outlier_share: float = 0.0,
    outlier_scale: float = 0.1,
    random_state: int | np.random.RandomState | None = None,
) -> Bunch:
    """Make the corner of a box: three faces, three edges, one corner (Fig. 11).

    The faces are squares of 1 m at right angles, seen from outside. Their outer sides are no edges:
    only the cloud ends there.

    Parameters
    ----------
    n_samples : int, default=3339
        Number of points, outliers included. The default is that of the paper's data set.
    noise : float, default=0.002
        Standard deviation of the noise, in meters on each axis.
    outlier_share : float, default=0.0
        Share of outliers in [0, 1): points of the faces, displaced. The paper adds 20 % to the
        points: a share of 1/6.
    outlier_scale : float, default=0.1
        Standard deviation of the displacement of outliers on each axis, in meters.
    random_state : int, RandomState instance or None, default=None
        Seed. The same seed gives the same cloud.

    Returns
    -------
    box : :class:`~sklearn.utils.Bunch`
        With the arrays of :func:`make_street`, in meters. ``edge_distance`` is the distance to the
        nearest of the three edges.

    Raises
    ------
    ValueError
        As :func:`make_street`.

    See Also
    --------
    make_crown_roof : Edges between surfaces that are not flat.

    Examples
    --------
    >>> from sklearn_mcmd.datasets import make_box
    >>> box = make_box(random_state=0)
    >>> box.data.shape, box.surface_names
    ((3339, 3), ['front', 'side', 'top'])
    """
    scene = box_scene(outlier_scale)
    return scan(scene, n_samples, noise, outlier_share, random_state, outlier_kinds=("gaussian",))


@checked(**SHARED_PARAMETERS)
def make_crown_roof(
    n_samples: int = 3017,
    *,
    noise: float = 0.002,
    outlier_share: float = 0.0,
    random_state: int | np.random.RandomState | None = None,
) -> Bunch:
    """Make a roof of four bilinear surfaces: edges whose angle varies (Fig. 13).

    The roof covers a square of 2 m. Its corners are lowest; the middles of the sides are 0.6 m
    higher and the center is 0.9 m higher. Four ridges lead from the center to the middles of the
    sides. Along each ridge the angle between the surfaces' normals grows from 32 degrees at the
    center to 60 at the gable.

    Parameters
    ----------
    n_samples : int, default=3017
        Number of points, outliers included. The default is that of the paper's data set.
    noise, outlier_share, random_state
        As of :func:`make_box`; outliers are displaced by 0.1 m (one standard deviation).

    Returns
    -------
    roof : :class:`~sklearn.utils.Bunch`
        As of :func:`make_box`. The eaves are no edges: only the cloud ends there.

    See Also
    --------
    make_box : Edges between flat faces.

    Examples
    --------
    >>> from sklearn_mcmd.datasets import make_crown_roof
    >>> roof = make_crown_roof(random_state=0)
    >>> roof.data.shape, len(roof.surface_names)
    ((3017, 3), 4)
    """
    scene = crown_roof_scene()
    return scan(scene, n_samples, noise, outlier_share, random_state, outlier_kinds=("gaussian",))


def box_scene(displacement):
    x, y, z = np.eye(3)
    parts = [
        Patch("front", (0, 1, 0), x, z, smooth=("u0", "v0")),
        Patch("side", (1, 0, 0), y, z, smooth=("u0", "v0")),
        Patch("top", (0, 0, 1), x, y, smooth=("u0", "v0")),
    ]
    return Scene(parts, scanner=(3.0, 3.4, 3.2), displacement=displacement)


def crown_roof_scene():
    center = np.array([1.0, 1.0, 0.9])
    eaves = [np.array([x, y, 0.0]) for x, y in ((0, 0), (2, 0), (2, 2), (0, 2))]
    gables = [np.array([x, y, 0.6]) for x, y in ((1, 0), (2, 1), (1, 2), (0, 1))]
    parts = [
        # Corners: at the eaves, a gable, the center and the other gable.
        Bilinear(name, [eaves[i], gables[i], center, gables[i - 1]], smooth=(0, 3))
        for i, name in enumerate(("south_west", "south_east", "north_east", "north_west"))
    ]
    return Scene(parts, scanner=(1.3, -3.0, 5.0), displacement=0.1)
