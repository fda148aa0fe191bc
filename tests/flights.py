"""Flight lines over hills, with scan angles and times."""

import numpy as np

from sklearn_mcmd.io import PointCloud


def flight(n=4_000, heading=0.7, height=800.0, angles=(-20, 5), step=1.0, start=0.0, seed=0):
    """Points of a flight line over hills of 60 m, and positions of its sensor."""
    rng = np.random.default_rng(seed)
    along = np.array([np.cos(heading), np.sin(heading), 0])
    across = np.array([along[1], -along[0], 0])
    times = np.sort(rng.uniform(0, 4, n))
    sensor = 60 * times[:, None] * along + [362_000, 5_157_000, height + 100]
    true = rng.uniform(*angles, n)
    down = height + rng.uniform(0, 60, n)
    xyz = sensor + (down * np.tan(np.radians(true)))[:, None] * across - down[:, None] * [0, 0, 1]
    rounded = np.round(true / step)
    name = "scan_angle_rank" if step == 1.0 else "scan_angle"
    return xyz, sensor, {name: rounded.astype(np.int16), "gps_time": times + start}


def of(xyz, attributes, line=1):
    return PointCloud(xyz, {**attributes, "point_source_id": np.full(len(xyz), line)})
