"""The columns that tell of edges in a file."""

import numpy as np

__all__ = ["EDGE_COLOR", "SURFACE_COLOR", "edge_columns"]

# Red, green, blue of surfaces and of edges.
SURFACE_COLOR, EDGE_COLOR = (170, 170, 170), (215, 30, 30)
COLORS = ("red", "green", "blue")


def edge_columns(is_edge, score, brightest=None):
    """Labels and scores of points (n,), with colors up to `brightest` if that is a number."""
    columns = {"edge": is_edge.astype(np.uint8), "edge_score": score.astype(np.float32)}
    if brightest is not None:
        paint = np.where(is_edge[:, None], EDGE_COLOR, SURFACE_COLOR) * (brightest // 255)
        paint = paint.astype(np.min_scalar_type(brightest))
        columns |= dict(zip(COLORS, paint.T.copy(), strict=True))
    return columns
