"""What options tell of the sensor: where it stood, by itself, file or trajectory; and intensity."""

import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.cli._options import option, parsed
from sklearn_mcmd.io import PointCloud, PointFileError, read_trajectory, sensor_origins
from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.io._sensor import lights_in, place_words, stated_positions

AUTO, NONE = "auto", "none"
MOST = 10  # numbers of scans in a message


def position_option(help, *words, name="--sensor", **settings):
    """An option that takes one of these words, or three coordinates."""

    def parse(text):
        if text in words:
            return text
        position = tuple(float(part) for part in text.split(","))
        if len(position) != 3 or not np.isfinite(position).all():
            raise ValueError
        return position

    form = " or ".join((*words, "a position, such as 0,0,0"))
    metavar = "|".join(("X,Y,Z", *words[:1]))
    return option(None, help, name, parser=parsed(parse, form), metavar=metavar, **settings)


def trajectory_option():
    return option(None, "Where a moving sensor was: CSV with time, x, y, z.", metavar="FILE")


class Asked(NamedTuple):
    """What options tell of the sensor of a file."""

    source: Path
    sensor: tuple[float, float, float] | str | None  # typed, "auto", or not told
    trajectory: Path | None
    recognize: bool = False  # whether the file may tell it with no option, or the points show it

    def may_be_known(self, catalog):
        """Whether the sensor is told, or a file may have been taken from the origin: its bounds do
        not tell that this is far away. What it shows is known when it is read."""
        if self.sensor is not None or self.trajectory is not None:
            return True
        if not self.recognize:
            return False
        from sklearn_mcmd.sensors._rays import one_far_position

        bounds = np.array([catalog.low, catalog.high])
        return not catalog.is_many and not one_far_position(bounds, np.zeros((1, 3)))

    def path(self):
        """What `process_files` takes beside an estimator, which may have one position."""
        if self.sensor == AUTO:
            why = stated_positions(PointCloud(np.empty((0, 3)))).words
            raise PointFileError(f"{self.source}: no position of the sensor is known: {why}")
        return None if self.trajectory is None else read_trajectory(self.trajectory)

    def of_normals(self, cloud):
        """Positions for all points, (3,) or (n, 3), and a row of the summary on them; or None, {}.

        A position that is doubted is an error: normals to another side than asked are wrong.
        """
        positions, words, doubt = self._positions(cloud, slice(None))
        if doubt:
            remedy = "give --sensor X,Y,Z where it stood, or --orientation up or mst"
            raise PointFileError(f"{self.source}: {doubt}. It is not used; {remedy}")
        if positions is None:
            return None, {}
        return positions, {"sensor": place_words(positions, words)}

    def of_rays(self, cloud, used):
        """Positions for the points that are used, or None; where they are, in words; and what
        speaks against those that the file states, which is warned of."""
        from sklearn_mcmd.sensors._recognition import view_from_origin

        positions, words, doubt = self._positions(cloud, used)
        if doubt:
            remedy = "give --sensor X,Y,Z if it is right; --sensor none is silent"
            warnings.warn(f"{self.source}: {doubt}. It is not used; {remedy}", stacklevel=2)
        if positions is None and self.recognize:
            words = view_from_origin(lambda: [cloud.xyz[used]])
            positions = np.zeros(3) if words else None
        return positions, "" if positions is None else place_words(positions, words), doubt

    def _positions(self, cloud, used):
        """Positions for the used points, (3,) or (m, 3), or None; in words what tells them; and
        what speaks against those that the file states, which are not given then.

        What the file states is taken with no option if `recognize`.
        """
        if isinstance(self.sensor, tuple):
            return np.array(self.sensor), "given", ""
        if self.trajectory is not None:
            path = read_trajectory(self.trajectory)
            with one_clear_line(self.source, "read"):
                return sensor_origins(cloud, path)[used], "trajectory", ""
        if not (self.sensor == AUTO or self.recognize):
            return None, "", ""
        with one_clear_line(self.source, "read"):
            stated, words, setups = stated_positions(cloud)
            if stated is None and self.sensor == AUTO:
                sensor_origins(cloud)  # which says why
        if stated is None:
            return None, "", ""
        stated = stated if len(stated) == 1 else stated[used]
        setups = setups if setups is None else setups[used]
        doubt = _doubt(cloud.xyz[used], stated, words, setups)
        return None if doubt else stated[0] if len(stated) == 1 else stated, words, doubt


def _doubt(xyz, positions, words, setups):
    """What speaks against positions that a file states, "" if nothing does."""
    from sklearn_mcmd.sensors._recognition import views_from_setups

    seen = views_from_setups(xyz, positions, setups)
    if False in seen:
        which = ""
        if setups is not None:
            bad = np.unique(setups)[[view is False for view in seen]] + 1
            more = f" and {len(bad) - MOST:,} more" if len(bad) > MOST else ""
            which = f"of scan{'s' * (len(bad) > 1)} {', '.join(map(str, bad[:MOST]))}{more} "
        why = f"points {which}do not look as if measured from there; that may be a local origin"
    elif True in seen:  # setups that cannot be asked have no vote
        return ""
    else:
        why = "that is too far away to be asked" if "far" in seen else "too few points can be asked"
    place = place_words(positions, words)
    at = "" if place.startswith("from") else "at "
    return f"the file says that the sensor was {at}{place}, but {why}"


def intensity_of(source, cloud):
    """The intensity of each point, as files name it; of four columns without names the last."""
    columns = cloud.attributes
    for values in (columns if list(columns) == ["column_4"] else lights_in(columns)).values():
        if (values != values[:1]).any():  # LAS has 0 where there is none
            return values
    raise ValueError(f"{source}: --intensity: the file has none, or the same at all points")
