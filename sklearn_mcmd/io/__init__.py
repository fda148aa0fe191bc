"""Reading and writing of point clouds; the extension of a file chooses the format.

Where the sensor stood is told by some of the formats, and by trajectories.
"""

from sklearn_mcmd.io._files import read_points, write_points
from sklearn_mcmd.io._formats import FORMATS
from sklearn_mcmd.io._point_cloud import PointCloud, PointFileError
from sklearn_mcmd.io._sensor import sensor_origins
from sklearn_mcmd.io._trajectory import Trajectory, read_trajectory

__all__ = [
    "PointCloud",
    "PointFileError",
    "Trajectory",
    "read_points",
    "read_trajectory",
    "sensor_origins",
    "write_points",
]

ROWS = (f"{' '.join(one.extensions):20}{one.extra or 'no extra':10}{one.kept}" for one in FORMATS)
__doc__ = "\n".join([f"{__doc__}", *ROWS])
