"""The columns that tell of edges in a file."""

import numpy as np

__all__ = ["EDGE_COLOR", "SURFACE_COLOR", "edge_columns"]

# Red, green, blue of surfaces and of edges.
SURFACE_COLOR, EDGE_COLOR = (170, 170, 170), (215, 30, 30)
COLORS = ("red", "green", "blue")


def edge_columns(is_edge, score, paints):
    """Labels and scores of points (n,), and colors of 8 bits if it `paints`."""
    columns = {"edge": is_edge.astype(np.uint8), "edge_score": score.astype(np.float32)}
    if paints:
        paint = np.where(is_edge[:, None], EDGE_COLOR, SURFACE_COLOR).astype(np.uint8)
        columns |= dict(zip(COLORS, paint.T.copy(), strict=True))
    return columns
