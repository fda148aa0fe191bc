"""Where the sensor stood, as options tell: a position, what the file says, or a trajectory."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

__all__ = [
    "SensorOrigin",
    "TrajectoryFile",
    "check_one_position",
    "path_of_options",
    "sensor_of_options",
    "work_of_options",
]

AUTO = "auto"


def _position(text):
    """auto, or three coordinates."""
    if text == AUTO:
        return AUTO
    try:
        position = tuple(float(part) for part in text.split(","))
    except ValueError:
        position = ()
    if len(position) != 3 or not np.isfinite(position).all():
        raise typer.BadParameter(f"{text} is not {AUTO} or a position, such as 0,0,0")
    return position


SensorOrigin = Annotated[
    tuple | None,
    typer.Option(
        "--sensor",
        parser=_position,
        metavar="X,Y,Z|auto",
        help="Where the sensor stood, in the coordinates of the file. auto: as the file says, by "
        "E57's poses, PCD's VIEWPOINT, or LAS's scan angles; mcmd info shows it.",
        show_default="not known",
    ),
]
TrajectoryFile = Annotated[
    Path | None,
    typer.Option(
        "--trajectory",
        metavar="FILE",
        help="Where a moving sensor was: CSV with the columns time (or gps_time), x, y, z. Points "
        "need times as well.",
    ),
]


def check_one_position(sensor, trajectory):
    """Wrong usage where a position is given twice."""
    if sensor is not None and trajectory is not None:
        raise typer.BadParameter("--sensor and --trajectory exclude each other: leave one out.")


def work_of_options(work, sensor, trajectory, *, rays):
    """The name of some work by tiles, as of `plan_run`, where the sensor may be known."""
    if rays and not (sensor is None and trajectory is None):
        work = f"{work}, rays"
    if trajectory is not None:
        return f"{work}, trajectory"
    return f"{work}, angles" if sensor == AUTO else work


def path_of_options(sensor, trajectory):
    """What `process_files` takes beside an estimator, which may have one position."""
    if trajectory is None:
        return sensor if sensor == AUTO else None
    from sklearn_mcmd.io import read_trajectory

    return read_trajectory(trajectory)


def sensor_of_options(source, cloud, sensor=None, trajectory=None):
    """Positions of the sensor: (3,), or (n, 3) for each point, or None if no option tells.

    The sensor is three floats or "auto"; errors name the source of the cloud.
    """
    if sensor is None and trajectory is None:
        return None
    if isinstance(sensor, tuple):
        return np.array(sensor)
    from sklearn_mcmd.io import read_trajectory, sensor_origins
    from sklearn_mcmd.io._files import one_clear_line
    from sklearn_mcmd.io._sensor import stated_positions

    path = None if trajectory is None else read_trajectory(trajectory)
    with one_clear_line(source, "read"):
        if path is None:
            positions = stated_positions(cloud).positions
            if positions is not None and len(positions) == 1:
                return positions[0]
        return sensor_origins(cloud, path)
