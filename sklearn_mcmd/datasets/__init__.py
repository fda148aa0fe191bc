"""Made-up clouds whose truth is known: labels, normals, edges and noise of every point."""

from sklearn_mcmd.datasets._contaminated_plane import make_contaminated_plane
from sklearn_mcmd.datasets._shapes import make_box, make_crown_roof
from sklearn_mcmd.datasets._street import make_street

__all__ = ["make_box", "make_contaminated_plane", "make_crown_roof", "make_street"]
