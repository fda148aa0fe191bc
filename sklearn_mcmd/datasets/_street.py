"""A simulated scan of a street, with the truth of every point."""

from collections.abc import Sequence
from functools import cache
from numbers import Real
from typing import Literal

import numpy as np
from sklearn.utils import Bunch

from sklearn_mcmd._sklearn import Interval, checked
from sklearn_mcmd.datasets._scan import SHARED_PARAMETERS, Scene, scan
from sklearn_mcmd.datasets._surfaces import Circle, Cylinder, Foliage, Patch

# Meters; x runs along the road, y across it, z up.
UP = np.array([0, 0, 1.0])
KERB_Y, PATH_Z = 3.0, 0.10
CROWN_RADIUS, CROWN_Z = 75.0, 0.03  # of the cambered road: a cylinder, and its top


# Meters.
_LENGTH = 5.0  # of the street
_WALL_Y, _WALL_TOP = 4.5, 2.7
# x and z, each from and to.
_WINDOW, _DOOR = (0.4, 1.6, 0.95, 2.15), (2.2, 3.1, PATH_Z, 2.1)
_WINDOW_DEPTH, _DOOR_DEPTH = 0.20, 0.12
_SIGN, _POLE, _TREE = (0.9, 3.4), (3.6, 3.45), (2.3, 3.55)  # x, y of their feet


@checked(
    **SHARED_PARAMETERS,
    noise_growth=[Interval(Real, 1, None, closed="left")],
    outlier_kinds=[list, tuple],
)
def make_street(
    n_samples: int = 100_000,
    *,
    noise: float = 0.005,
    noise_growth: float = 1.0,
    outlier_share: float = 0.1,
    outlier_kinds: Sequence[str] = ("gaussian", "uniform", "mixed_pixel", "ghost"),
    tree: bool = False,
    sampling: Literal["uniform", "scan_lines"] = "uniform",
    random_state: int | np.random.RandomState | None = None,
) -> Bunch:
    """Make a laser scan of a street whose truth is known at every point.

    The street has a cambered road, a 13 cm kerb, a footpath, a facade with a recessed window and
    door, a sign on a post, a lamp pole and, if asked for, a tree. x runs along the street, y across
    it, z up. It is 5 m long and is scanned from 2 m above its road, so the sign and the pole throw
    shadows. Surfaces, noise and outliers are known exactly. So the outliers, normals and edges that
    a method finds can be checked point by point.

    Parameters
    ----------
    n_samples : int, default=100_000
        Number of points, outliers included.
    noise : float, default=0.005
        Standard deviation of the noise, in meters on each axis, where the scanner is nearest.
    noise_growth : float, default=1.0
        Noise at the far end over that at the near end, at least 1. It grows linearly.
    outlier_share : float, default=0.1
        Share of outliers in [0, 1), rounded to a whole number of points.
    outlier_kinds : list or tuple of str
        Kinds of outliers, in (nearly) equal shares:

        - ``"gaussian"``: points of the surfaces, displaced by 0.2 m (one standard deviation) on
          each axis, the noise of the paper's Section 5.2.1;
        - ``"uniform"``: points anywhere in the bounding box;
        - ``"mixed_pixel"``: points on rays that pass an outline (sign, post, pole, window or
          door), between it and the background;
        - ``"ghost"``: dense balls of 10 to 60 points, 5 to 10 cm in radius, off the surfaces.
    tree : bool, default=False
        Whether there is a tree: a trunk and a ball of foliage. Foliage is regular, but has no
        normal and no edge.
    sampling : {"uniform", "scan_lines"}, default="uniform"
        Sampling of the surface that the scanner sees:

        - ``"uniform"``: independent draws of one density, with the same noise on each axis;
        - ``"scan_lines"``: the ends of rays that leave the scanner at equal steps of azimuth and
          elevation, down to 60 degrees below the horizon, in vertical lines. The spacing grows
          with the range and with the angle of incidence. Noise is along the ray, and some rays
          pass through foliage.
    random_state : int, RandomState instance or None, default=None
        Seed. The same seed gives the same cloud.

    Returns
    -------
    street : :class:`~sklearn.utils.Bunch`
        In meters, rows shuffled:

        - ``data``, float64 (n_samples, 3);
        - ``target``, int64 (n_samples,): +1 regular, -1 outlier;
        - ``true_points``, float64 (n_samples, 3): `data` without noise; NaN for outliers;
        - ``normals``, float64 (n_samples, 3): true unit normals, toward the seen side of the
          surface; NaN for foliage and outliers;
        - ``surface``, int64 (n_samples,): number of the surface in ``surface_names``, where every
          flat or round part has its own; -1 for outliers;
        - ``edge_distance``, float64 (n_samples,): distance of the true point to the nearest sharp
          edge of its surface; NaN for foliage and outliers;
        - ``outlier_kind``, int8 (n_samples,): number of the kind in ``outlier_kind_names``; 0,
          "regular", for no outlier;
        - ``noise_scale``, float64 (n_samples,): standard deviation, on each axis or along the ray,
          of the noise at that range, for outliers that of a regular point there;
        - ``surface_names``, ``outlier_kind_names``: lists of str;
        - ``sensor_origins``, float64 (n_samples, 3): where the scanner stood;
        - ``spacing``, float: mean point spacing in meters where the scanner is nearest (a square of
          that side holds one point on average), 2 cm for 100,000 points; of scan lines, the spacing
          of rays at the nearest surface.

    Raises
    ------
    ValueError
        If a kind of outlier is unknown or given twice, if no regular point is left, or if the noise
        is so large that no point in the bounding box is an outlier.

    See Also
    --------
    make_contaminated_plane : The single plane of the paper's Section 5.1.
    sklearn_mcmd.metrics.outlier_scores : Compares labels with ``target``.
    sklearn_mcmd.metrics.bias_angle : Compares normals with ``normals``.

    Notes
    -----
    Sharp edges are the lines where surfaces meet at an angle (the kerb's foot and top, the wall's
    foot, all sides of the reveals, the feet of pole, post and trunk) and the free ends of things
    (the sign's rim, the tops of pole, post and trunk). There is no edge where only the scene ends
    (the crown of the road, the top of the wall, both ends of the street).

    An outlier that falls within four noise standard deviations of a surface, or into foliage, is
    drawn anew, so no label is wrong. The points are independent draws unless
    ``sampling="scan_lines"``.

    Time is linear in `n_samples`, a few seconds for a million points.

    Examples
    --------
    >>> from sklearn_mcmd.datasets import make_street
    >>> street = make_street(20_000, random_state=0)
    >>> street.data.shape, int((street.target == -1).sum())
    ((20000, 3), 2000)
    >>> street.surface_names[:4]
    ['road', 'kerb', 'footpath', 'wall']
    >>> round(street.spacing, 3)
    0.045
    """
    return scan(
        _street(tree),
        n_samples,
        noise,
        outlier_share,
        random_state,
        outlier_kinds=outlier_kinds,
        noise_growth=noise_growth,
        on_lines=sampling == "scan_lines",
    )


@cache
def _street(tree):
    length, recess_y = _LENGTH, _WALL_Y + _DOOR_DEPTH
    along = np.array([length, 0, 0])
    beside_door = [
        (0.0, _DOOR[0], _WALL_Y - KERB_Y, recess_y - KERB_Y),
        (_DOOR[1], length, _WALL_Y - KERB_Y, recess_y - KERB_Y),
    ]
    things = [*_sign(_SIGN), pole("lamp_pole", _POLE, 0.09, 3.5)]
    if tree:
        things += [pole("trunk", _TREE, 0.12, 2.2), Foliage("foliage", (*_TREE, 2.4), 0.7)]
    parts = [
        *road_and_kerb(length),
        Patch(
            "footpath",
            (0, KERB_Y, PATH_Z),
            along,
            (0, recess_y - KERB_Y, 0),
            holes=beside_door,
            smooth=("u0", "u1"),
            circles=feet(things),
        ),
        Patch(
            "wall",
            (0, _WALL_Y, PATH_Z),
            along,
            (_WALL_TOP - PATH_Z) * UP,
            holes=[(x0, x1, z0 - PATH_Z, z1 - PATH_Z) for x0, x1, z0, z1 in (_WINDOW, _DOOR)],
            smooth=("u0", "u1", "v1"),
        ),
        *recess("window", _WALL_Y, _WINDOW, _WINDOW_DEPTH, sill=True),
        *recess("door", _WALL_Y, _DOOR, _DOOR_DEPTH, sill=False),
        *things,
    ]
    return Scene(parts, scanner=(length / 2, 1.0, 2.0))


def _sign(foot):
    """A plate of 0.5 m by 0.6 m, turned by 30 degrees, in front of its post."""
    along, toward = facing(np.radians(30))
    side = 0.5 * along
    corner = np.array([*foot, 1.9]) + 0.05 * toward - 0.5 * side
    return [Patch("sign", corner, side, (0, 0, 0.6)), pole("sign_post", foot, 0.03, 2.4)]


def road_and_kerb(length):
    """Half of a cambered road and a kerb of 13 cm."""
    gutter_angle = np.arcsin(KERB_Y / CROWN_RADIUS)
    gutter_z = CROWN_Z - CROWN_RADIUS * (1 - np.cos(gutter_angle))
    along = np.array([length, 0, 0])
    return [
        Cylinder(
            "road",
            (length, 0, CROWN_Z - CROWN_RADIUS),
            -along,  # right-handed around -x: from the crown towards the kerb
            CROWN_RADIUS,
            start=UP,
            arc=gutter_angle,
            sharp=("stop",),
        ),
        Patch("kerb", (0, KERB_Y, gutter_z), along, (PATH_Z - gutter_z) * UP, smooth=("u0", "u1")),
    ]


def pole(name, foot, radius, top):
    """A pole that stands on the footpath at (x, y)."""
    return Cylinder(name, (*foot, PATH_Z), (0, 0, top - PATH_Z), radius)


def feet(things):
    """The edges of poles on the footpath."""
    return [
        Circle(part.base, UP, part.radius)
        for part in things
        if isinstance(part, Cylinder) and part.base[2] == PATH_Z
    ]


def facing(turn):
    """Two directions of a plate: along it, to the right as seen from the road, and to the road."""
    return np.array([np.cos(turn), np.sin(turn), 0]), np.array([np.sin(turn), -np.cos(turn), 0])


def recess(name, wall_y, opening, depth, *, sill):
    """The back of an opening, by x and z from and to, in the wall at that y, and its reveals."""
    x0, x1, z0, z1 = opening
    x, y, z = (x1 - x0, 0, 0), (0, depth, 0), (0, 0, z1 - z0)
    parts = [
        Patch(f"{name}_back", (x0, wall_y + depth, z0), x, z),
        Patch(f"{name}_left", (x0, wall_y, z0), y, z),
        Patch(f"{name}_right", (x1, wall_y, z0), z, y),
        Patch(f"{name}_head", (x0, wall_y, z1), y, x),
    ]
    return [*parts, Patch(f"{name}_sill", (x0, wall_y, z0), x, y)] if sill else parts
