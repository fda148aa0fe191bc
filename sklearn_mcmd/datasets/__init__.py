"""Made-up clouds whose truth is known: labels, normals, edges and noise of every point."""

from sklearn_mcmd.datasets._plane import make_contaminated_plane
from sklearn_mcmd.datasets._street import make_street

__all__ = ["make_contaminated_plane", "make_street"]
