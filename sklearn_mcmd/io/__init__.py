"""Reading and writing of point clouds; the extension of a file chooses the format.

======================  ==============  ====================================================
extension               extra           what is kept
======================  ==============  ====================================================
``.las .laz``           ``las``         everything: attributes, extra dimensions, coordinate
                                        system, header, integer coordinates bit for bit
``.copc.laz``           ``las``         read only, like LAZ
``.ply``                ``formats``     vertex properties and comments; faces are dropped
``.pcd``                ``formats``     fields and viewpoint; organized clouds become a row
``.e57``                ``formats``     coordinates, intensity, colors, grid indices; scans are
                                        merged by their poses
``.xyz .txt .csv``      none            columns of numbers, with or without a header line
``.asc``                none            the same; no grids of Esri
``.pts``                none            intensity and colors of 8 bits; counts begin scans
``.xyzn .xyzrgb``       none            normals, or colors of 8 bits
``.npy .npz``           none            everything numeric
======================  ==============  ====================================================

Where the sensor stood is told by E57, PCD, LAS with scan angles, and trajectories.
"""

from sklearn_mcmd.io._files import read_points, write_points
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
