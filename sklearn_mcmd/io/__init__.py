"""Reading and writing of point clouds; the extension of a file chooses the format.

======================  ==============  ====================================================
extension               extra           what is kept
======================  ==============  ====================================================
``.las .laz``           ``las``         everything: attributes, extra dimensions, coordinate
                                        system, header, integer coordinates bit for bit
``.copc.laz``           ``las``         read only, like LAZ
``.ply``                ``formats``     vertex properties and comments; faces are dropped
``.pcd``                ``formats``     fields and viewpoint; organized clouds become a row
``.e57``                ``formats``     coordinates (float32 about the center), intensity,
                                        colors, grid indices; scans are merged by their poses
``.xyz .txt .csv``      none            columns of numbers, with or without a header line
``.npy .npz``           none            everything numeric
======================  ==============  ====================================================
"""

from sklearn_mcmd.io._files import read_points, supported_extensions, write_points
from sklearn_mcmd.io._point_cloud import PointCloud, PointFileError

__all__ = ["PointCloud", "PointFileError", "read_points", "supported_extensions", "write_points"]
