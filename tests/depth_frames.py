"""A wall as a camera sees it that measures disparity, as the first depth cameras did."""

import numpy as np

GROWTH = 0.0029  # steps of the depth at 1 m


def turned_wall(degrees, depth, axis=2, noise=0.3):
    """Points of 160 x 160 pixels in meters, the camera at the origin, and the wall's normal.

    It is turned from facing the camera. The inverse of a depth is in whole steps, after a noise of
    so many. `axis` is the one that the camera looks along.
    """
    v, u = (np.indices((160, 160)).reshape(2, -1) - 80) / 525
    rays = np.column_stack([u, v, np.ones_like(u)])
    turn = np.radians(degrees)
    normal = np.array([np.sin(turn), 0.0, -np.cos(turn)])
    inverse = (rays @ normal) / (normal[2] * depth)
    steps = np.rint(inverse / GROWTH + np.random.default_rng(0).normal(0, noise, len(inverse)))
    points = rays * np.round(1 / (GROWTH * steps), 3)[:, None]
    return np.roll(points, axis - 2, axis=1), np.roll(normal, axis - 2)
