"""What options tell of the sensor: where it stood, by itself, file or trajectory; and intensity."""

import warnings
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from sklearn_mcmd.io import PointFileError, read_trajectory, sensor_origins
from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.io._formats import SENSORS, TILED
from sklearn_mcmd.io._las import read_header
from sklearn_mcmd.io._sensor import place_words, stated_positions

__all__ = [
    "Intensity",
    "SensorOrView",
    "SensorOrigin",
    "TrajectoryFile",
    "check_one_position",
    "intensity_of",
    "path_of_options",
    "sensor_of_normals",
    "sensor_of_options",
    "sensor_of_rays",
    "work_if_seen",
    "work_of_options",
]

AUTO, NONE = "auto", "none"
MOST = 10  # numbers of scans in a message
NAMES = "intensity", "reflectance", "reflectivity"


def _position(text, words=(AUTO,)):
    """One of these words, or three coordinates."""
    if text in words:
        return text
    try:
        position = tuple(float(part) for part in text.split(","))
    except ValueError:
        position = ()
    if len(position) != 3 or not np.isfinite(position).all():
        choices = ", ".join(words)
        raise typer.BadParameter(f"{text} is neither {choices} nor a position, such as 0,0,0")
    return position


def _position_or_none(text):
    return _position(text, (AUTO, NONE))


SensorOrigin = Annotated[
    tuple | None,
    typer.Option(
        "--sensor",
        parser=_position,
        metavar="X,Y,Z|auto",
        help="Where the sensor stood, in the coordinates of the file. auto: as the file says, by "
        f"{SENSORS}, if the cloud looks as if it was measured from there; mcmd info shows it.",
        show_default="not known",
    ),
]
SensorOrView = Annotated[
    tuple | None,
    typer.Option(
        "--sensor",
        parser=_position_or_none,
        metavar="X,Y,Z|auto|none",
        help="Where the sensor stood, in the coordinates of the file. auto: as the file states, by "
        f"{SENSORS}; mcmd info shows it. It is used if the cloud looks as if it was measured from "
        "there. none: not known.",
        show_default="auto, but by no scan angles; else the origin if the cloud shows that it was "
        "taken from there",
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

Intensity = Annotated[
    bool,
    typer.Option("--intensity", help="Take the file's intensity as evidence, too.", hidden=True),
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


def work_if_seen(work, source):
    """The same work with rays if a LAS may be recognized, which is known when it is read: unless
    its bounds tell that the origin is far away."""
    from sklearn_mcmd.sensors._rays import one_far_position

    if "rays" in work or not source.is_file() or source.suffix.lower() not in TILED:
        return work
    try:
        header = read_header(source)
    except PointFileError:  # the reading tells
        return work
    bounds = np.array([header.mins, header.maxs])
    return work if one_far_position(bounds, np.zeros((1, 3))) else f"{work}, rays"


def path_of_options(sensor, trajectory):
    """What `process_files` takes beside an estimator, which may have one position."""
    if trajectory is None:
        return sensor if sensor == AUTO else None
    return read_trajectory(trajectory)


def intensity_of(source, cloud):
    """The intensity of each point, as files name it; of four columns without names the last."""
    given = {name.lower().removeprefix("scalar_"): a for name, a in cloud.attributes.items()}
    for name in given if list(given) == ["column_4"] else NAMES:
        values = given.get(name)
        if np.ndim(values) == 1 and (values != values[:1]).any():  # LAS has 0 where there is none
            return values
    raise ValueError(f"{source}: --intensity: the file has none, or the same at all points")


def sensor_of_options(source, cloud, sensor, trajectory, used=slice(None), recognize=False):
    """Positions for the used points, (3,) or (m, 3), or None if no option tells them; in words
    what tells them; and what speaks against those that the file states, which are not given then.

    The sensor is three floats, "auto", or None. What is typed is taken as it is; what the file
    states is asked, and is taken with no option as well if `recognize`, unless it is scan angles,
    which take long and tell of aircraft. A sensor that moves has no even steps to be asked for.
    """
    if isinstance(sensor, tuple):
        return np.array(sensor), "given", ""
    if trajectory is not None:
        path = read_trajectory(trajectory)
        with one_clear_line(source, "read"):
            return sensor_origins(cloud, path)[used], "trajectory", ""
    if not (sensor == AUTO or (recognize and "las_header" not in cloud.metadata)):
        return None, "", ""
    with one_clear_line(source, "read"):
        told, words, setups = stated_positions(cloud)
        if told is None and sensor == AUTO:
            sensor_origins(cloud)  # which says why
    if told is None:
        return None, "", ""
    told = told if len(told) == 1 else told[used]
    doubt = ""
    if len(told) == 1 or setups is not None:
        doubt = _doubt(cloud.xyz[used], told, words, setups if setups is None else setups[used])
    return None if doubt else told[0] if len(told) == 1 else told, words, doubt


def _doubt(xyz, positions, words, setups):
    """What speaks against positions that a file states, "" if nothing does."""
    from sklearn_mcmd.sensors._recognition import views_from_setups

    seen = views_from_setups(xyz, positions, setups)
    if False in seen:
        which = "" if setups is None else _scans(np.unique(setups)[[s is False for s in seen]] + 1)
        why = f"points {which}do not look as if measured from there; that may be a local origin"
    elif True in seen:  # setups that cannot be asked have no vote
        return ""
    else:
        why = "that is too far away to be asked" if "far" in seen else "too few points can be asked"
    place = place_words(positions, words)
    at = "" if place.startswith("from") else "at "
    return f"the file says that the sensor was {at}{place}, but {why}"


def _scans(numbers):
    """Numbers of scans in words, the first ten of many."""
    more = f" and {len(numbers) - MOST:,} more" if len(numbers) > MOST else ""
    return f"of scan{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers[:MOST]))}{more} "


def sensor_of_normals(source, cloud, sensor, trajectory):
    """Positions for all points, (3,) or (n, 3), and the row of the summary on them; or None, {}.

    A position that is doubted is an error: normals to another side than asked are wrong results.
    """
    told, words, doubt = sensor_of_options(source, cloud, sensor, trajectory)
    if doubt:
        remedy = "give --sensor X,Y,Z where it stood, or --orientation up or mst"
        raise PointFileError(f"{source}: {doubt}. It is not used; {remedy}")
    return (None, {}) if told is None else (told, {"sensor": place_words(told, words)})


def sensor_of_rays(source, cloud, used, sensor=None, trajectory=None, recognize=False):
    """As `sensor_of_options`, but in words where positions are. What speaks against them is warned
    of; and if `recognize`, the points may have been taken from the origin."""
    from sklearn_mcmd.sensors._recognition import view_from_origin

    told, words, doubt = sensor_of_options(source, cloud, sensor, trajectory, used, recognize)
    if doubt:
        remedy = "give --sensor X,Y,Z if it is right; --sensor none is silent"
        warnings.warn(f"{source}: {doubt}. It is not used; {remedy}", stacklevel=2)
    if told is None and recognize and (words := view_from_origin(lambda: [cloud.xyz[used]])):
        told = np.zeros(3)
    return told, "" if told is None else place_words(told, words), doubt
