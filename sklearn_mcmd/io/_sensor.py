"""Where the sensor stood: what files say of it, for each point."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sklearn_mcmd._errors import counted
from sklearn_mcmd.io._formats import SENSORS
from sklearn_mcmd.io._point_cloud import SETUPS, PointCloud, PointFileError
from sklearn_mcmd.io._trajectory import Trajectory, positions_at, trajectory_of

LIGHTS = "intensity", "reflectance", "reflectivity"  # attributes that say how much came back


class Stated(NamedTuple):
    """What a file says of the sensor."""

    positions: np.ndarray | None  # (n, 3), or (1, 3) for all points; None if the file has none
    words: str  # where they are from, or why there are none
    setups: np.ndarray | None = None  # (n,), of points of several setups, their numbers


def place_words(positions, words):
    """Positions (m, 3) or (3,), or what bounds them, and in brackets what tells them."""
    low, high = (np.round(end(np.atleast_2d(positions), axis=0), 3) for end in (np.min, np.max))
    first, last = (", ".join(f"{value:.10g}" for value in place) for place in (low, high))
    return f"{first} ({words})" if first == last else f"from {first} to {last} ({words})"


def lights_in(attributes):
    """Those of the attributes of a cloud that say how much light came back, by their names."""
    arrays = {name.lower().removeprefix("scalar_"): a for name, a in attributes.items()}
    return {name: arrays[name] for name in LIGHTS if name in arrays and np.ndim(arrays[name]) == 1}


def rows_of_sensor(where, doubt, n_by_rays, surrounded=False):
    """What to tell of a sensor in a table: where it was, "" if that is not known or not used, what
    speaks against it, and the outliers that coordinates alone would keep. Or how to tell where it
    was, of a cloud that shows no position, though the origin is `surrounded` by it."""
    if where:
        by_rays = f"{counted(n_by_rays, 'outlier', 'are')} so by rays alone"
        return {"sensor": where, "by rays": by_rays} | ({"doubt": doubt} if doubt else {})
    if doubt:
        return {"sensor": "not used", "doubt": doubt}
    unseen = "no position is seen; if it was at the origin, which points surround: --sensor 0,0,0"
    return {"sensor": unseen} if surrounded else {}


def sensor_origins(
    cloud: PointCloud, trajectory: "Trajectory | tuple[ArrayLike, ArrayLike] | None" = None
) -> NDArray[np.float64]:
    """Where the sensor was when it measured each point.

    Parameters
    ----------
    cloud : PointCloud
        As it was read, with an attribute ``gps_time`` or ``time`` if there is a trajectory.
    trajectory : Trajectory, or tuple of times (m,) and positions (m, 3), default=None
        Positions between its times are interpolated linearly. Its times may be GPS seconds, the
        same less 1e9 as LAS has them, or seconds of the week, whatever those of points are; a
        warning says so if they differ. None means that the file itself tells positions, by PCD's
        VIEWPOINT, E57's poses or PTX's poses.

    Returns
    -------
    ndarray of shape (n, 3)

    Raises
    ------
    PointFileError
        If points have no times, or some were measured before or after the trajectory, or it is no
        pair, or the file tells no positions.

    Warns
    -----
    UserWarning
        If times begin elsewhere, or the trajectory is far away from all points.

    See Also
    --------
    read_trajectory : Reads one from a file.

    Notes
    -----
    Files may be wrong, and ``mcmd denoise`` asks the points whether they were measured from there.

    *E57, PTX.* The pose of a scan says where the scanner stood. A pose that moves nothing counts
    only if the scan has a grid of rows and columns: programs that merge scans write such a pose,
    too. In PTX each pose needs a grid, and one that moves nothing must not name another place.

    *PCD.* VIEWPOINT counts unless it is 0 0 0. That is what programs write who do not know it.

    Examples
    --------
    >>> from sklearn_mcmd.io import PointCloud, sensor_origins
    >>> cloud = PointCloud([[0, 5, 0], [4, 5, 0]], {"gps_time": [10.0, 10.5]})
    >>> sensor_origins(cloud, ([10, 11], [[0, 0, 2], [8, 0, 2]]))
    array([[0., 0., 2.],
           [4., 0., 2.]])
    """
    if trajectory is not None:
        try:
            times, positions = trajectory
        except (TypeError, ValueError):
            raise PointFileError(
                f"a trajectory is as read_trajectory gives it, got {type(trajectory).__name__}"
            ) from None
        return positions_at(cloud, trajectory_of(times, positions))
    stated = stated_positions(cloud)
    if stated.positions is None:
        raise PointFileError(f"no position of the sensor is known: {stated.words}")
    return np.array(np.broadcast_to(stated.positions, (len(cloud), 3)))


def stated_positions(cloud):
    """What the file of a cloud says of the sensor: `Stated`."""
    if SETUPS in cloud.metadata:
        return _of_setups(cloud)
    if "pcd_viewpoint" in cloud.metadata:
        viewpoint = np.array(cloud.metadata["pcd_viewpoint"], float)
        if not np.isfinite(viewpoint).all():
            return Stated(None, "PCD's VIEWPOINT has numbers that are not finite")
        if not viewpoint[:3].any():
            why = "PCD's VIEWPOINT is 0 0 0, which is also written where it is not known"
            return Stated(None, why)
        return Stated(viewpoint[None, :3], "PCD's VIEWPOINT")
    return Stated(None, f"only {SENSORS} tell it; give a position or a trajectory")


def _of_setups(cloud):
    positions, setups = np.asarray(cloud.metadata[SETUPS], float), None
    if len(positions) > 1:
        if "scan_index" not in cloud.attributes:
            return Stated(None, "points have lost the attribute scan_index")
        setups = np.asarray(cloud.attributes["scan_index"])
        positions = positions[setups]
    if not np.isfinite(positions).all():
        return Stated(None, "not all of the scans have a pose that says where the scanner stood")
    words = "pose of the scan" if setups is None else "poses of the scans"
    return Stated(positions, words, setups)
