"""A window of glass: a room is seen through it, and beams come back from what is mirrored in it."""

import numpy as np

from sklearn_mcmd.datasets._outliers import CLEARANCE, draw_clear
from sklearn_mcmd.datasets._road import UP, Opening, recess
from sklearn_mcmd.datasets._surfaces import Patch, Soft, first_hits

__all__ = ["SHOP_WINDOW", "Pane", "glazed_opening", "reflection"]

# Meters.
SHOP_WINDOW = Opening(0.25, 2.0, 0.45, 2.3)
_DEPTH = 0.10  # of the pane behind the wall
_ROOM = Opening(0.05, 2.15, 0.30, 2.55)
_ROOM_DEPTH = 2.4
_TABLE = (0.5, 1.3, 0.8, 1.6, 1.05)  # x, y from the pane and height of its top


class Pane(Soft, Patch):
    """Flat rectangle of glass. Beams pass it, but for a few that end at dust on it."""

    #: Share of the beams that end at it.
    dust = 0.05

    def __init__(self, name, corner, u, v):
        Patch.__init__(self, name, corner, u, v)
        self.cell_areas *= self.dust
        self.area *= self.dust

    normals = Patch.normals
    edge_distance = Patch.edge_distance

    def scatter(self, origin, ends, rng):
        """Where dust stops segments: as `hit`, but by chance."""
        fraction = Patch.hit(self, origin, ends)
        return np.where(rng.random(len(ends)) < self.dust, fraction, np.inf)

    def mirror(self, points):
        """The mirror images of points (n, 3)."""
        normal = self.frame[:, 2]
        return points - 2 * ((points - self.corner) @ normal)[:, None] * normal


def glazed_opening(wall_y):
    """A shop window in the wall at that y, and the room behind: a box with a table."""
    pane_y = wall_y + _DEPTH
    _, *reveals = recess("window", wall_y, SHOP_WINDOW, _DEPTH, sill=True)
    x0, x1, z0, z1 = SHOP_WINDOW
    pane = Pane("window_pane", (x0, pane_y, z0), (x1 - x0, 0, 0), (z1 - z0) * UP)
    x0, x1, z0, z1 = _ROOM
    x, y, z = (x1 - x0, 0, 0), (0, _ROOM_DEPTH, 0), (z1 - z0) * UP
    near, far, left, right, top = _TABLE
    return [
        *reveals,
        pane,
        Patch("room_back", (x0, pane_y + _ROOM_DEPTH, z0), x, z),
        Patch("room_left", (x0, pane_y, z0), y, z),
        Patch("room_right", (x1, pane_y, z0), z, y),
        Patch("room_floor", (x0, pane_y, z0), x, y),
        Patch("room_ceiling", (x0, pane_y, z1), y, x),
        Patch("room_table", (near, pane_y + left, top), (far - near, 0, 0), (0, right - left, 0)),
    ]


def reflection(scene, n, clearance, rng):
    """Points that scanners see mirrored in panes of glass, with the noise of their ranges.

    The beam leaves the pane by the law of reflection and ends at a surface before it. The scanner
    knows only its range, and writes the point along the straight ray, behind the pane.
    """
    panes = [part for part in scene.parts if isinstance(part, Pane)]
    solid = [part for part in scene.parts if not isinstance(part, Pane)]
    reach = 2 * scene.farthest_range

    def propose(m):
        pane = panes[rng.integers(len(panes))]
        corners = pane.corner + np.outer([0, 1, 0, 1], pane.size[0] * pane.frame[:, 0])
        corners = corners + np.outer([0, 0, 1, 1], pane.size[1] * pane.frame[:, 1])
        azimuth, elevation = _angles(corners - scene.scanner)
        azimuth = rng.uniform(azimuth.min(), azimuth.max(), m)
        elevation = rng.uniform(elevation.min(), elevation.max(), m)
        flat = np.cos(elevation)
        ray = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
        ends = scene.scanner + reach * ray
        at_pane = Patch.hit(pane, scene.scanner, ends)
        met = np.isfinite(at_pane) & (scene.first_hit(ends) > at_pane)
        ray, at_pane, ends = ray[met], reach * at_pane[met, None], ends[met]
        start = scene.scanner + at_pane * ray
        onward, _ = first_hits(solid, start, pane.mirror(ends), rng)
        seen = np.isfinite(onward)
        start, ray, ends = start[seen], ray[seen], ends[seen]
        points = start + onward[seen, None] * (ends - start)
        points = scene.to_scene(points, rng.integers(scene.n_bays, size=len(points)))
        sigma = clearance(points) / CLEARANCE
        return points + (sigma * rng.standard_normal(len(points)))[:, None] * ray

    return draw_clear(scene.distance, n, clearance, propose)


def _angles(rays):
    """Azimuth and elevation."""
    return np.arctan2(rays[:, 1], rays[:, 0]), np.arctan2(
        rays[:, 2], np.linalg.norm(rays[:, :2], axis=1)
    )
