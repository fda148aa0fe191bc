"""Where the sensor stood: what files say of it, for each point; LAS by its scan angles."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sklearn_mcmd._errors import counted
from sklearn_mcmd.io._formats import SENSORS
from sklearn_mcmd.io._las_structure import ANGLE_STEP
from sklearn_mcmd.io._point_cloud import SETUPS, PointCloud, PointFileError
from sklearn_mcmd.io._trajectory import Trajectory, positions_at, trajectory_of

# Degrees (rms) by which directions may differ from scan angles. Rounding to whole degrees makes
# 0.29, and no single angle is wrong by more than half a degree.
MOST_OFF = 0.5
LEAST_POINTS = 100  # of a line, for its angles to tell anything
ROUNDS = 20  # of the adjustment; each changes the height by about relief over height less


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
        warning says so if they differ. None means that the file itself tells positions, by LAS's
        scan angles, PCD's VIEWPOINT, E57's poses or PTX's poses.

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

    *LAS.* Each flight line is taken as straight, level and of constant speed, with a scan across
    it. What the scan angles say of three unknowns, the line, its speed and height, is adjusted by
    least squares. If the directions to points differ from the angles by more than half a degree
    (rms), angles tell no position: those rounded to whole degrees differ by 0.29 degrees.

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
    if "las_header" in cloud.metadata:
        return positions_of_lines(cloud)
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


def positions_of_lines(cloud):
    """What scan angles, times and flight lines of LAS say of the sensor: `Stated`."""
    attributes = cloud.attributes
    angles = attributes.get("scan_angle_rank")
    if angles is None and "scan_angle" in attributes:
        angles = ANGLE_STEP * np.asarray(attributes["scan_angle"], float)
    if angles is None or not {"gps_time", "point_source_id"} <= attributes.keys():
        return Stated(
            None, "points have no scan angles with times; give a position or a trajectory"
        )
    angles, times = np.asarray(angles, float), np.asarray(attributes["gps_time"], float)
    if np.ptp(angles) == 0 or np.ptp(times) == 0:
        return Stated(None, "scan angles or times are all equal; give a position or a trajectory")
    lines = np.asarray(attributes["point_source_id"])
    positions, numbers = np.empty((len(cloud), 3)), np.unique(lines)
    for line in numbers:
        rows = lines == line
        flown, why = _adjusted(cloud.xyz[rows], times[rows], angles[rows])
        if flown is None:
            return Stated(None, f"of flight line {line}, {why}; give a trajectory")
        positions[rows] = flown
    words = "one flight line" if len(numbers) == 1 else f"{len(numbers)} lines"
    return Stated(positions, f"scan angles of {words}")


def _adjusted(xyz, times, angles):
    """Positions of the sensor on a straight and level line, or None and why.

    The plan of a point is that of the sensor, which moves by time, and a step across that is the
    height over the point times the tangent of its angle. Height and direction of the step are
    linear unknowns while the points' heights are corrected for with those of the round before.
    """
    if len(xyz) < LEAST_POINTS:
        return None, f"there are fewer than {LEAST_POINTS} points"
    # Step 1: the unknowns are a place, a way in the time of the line, and a step across.
    middle, tangents = xyz.mean(axis=0), np.tan(np.radians(angles))
    times = (times - times.mean()) / max(np.ptp(times), np.finfo(float).tiny)
    unknown = np.column_stack([np.ones(len(xyz)), times, tangents])
    if np.linalg.matrix_rank(unknown) < 3:
        return None, "scan angles or times are all equal"
    # Step 2: plan = place + way * time + across * (height - z) * tangent, by rounds for z.
    local, across, solve = xyz - middle, np.zeros(2), np.linalg.pinv(unknown)
    for _ in range(ROUNDS):
        plan = local[:, :2] + (local[:, 2] * tangents)[:, None] * across
        solved = solve @ plan
        height = np.linalg.norm(solved[2])
        if not height > 0:
            return None, "scan angles say nothing of its height"
        across = solved[2] / height
    # Step 3: what is left on the ground is an angle as seen from the height.
    off = np.linalg.norm(plan - unknown @ solved, axis=1)
    off = np.degrees(np.sqrt(np.mean(off**2)) / height)
    if off > MOST_OFF:
        return None, (
            f"directions to points differ from scan angles by {off:.2g} degrees (rms; "
            f"{MOST_OFF:g} are the most)"
        )
    if height <= local[:, 2].max():
        return None, "scan angles put the sensor below the highest of its points"
    flown = middle[:2] + unknown[:, :2] @ solved[:2]
    return np.column_stack([flown, np.full(len(xyz), middle[2] + height)]), ""
