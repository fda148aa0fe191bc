"""The page of clouds, from Python."""

import os
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from sklearn_mcmd.io import PointCloud
    from sklearn_mcmd.view import CloudPage


def view(
    *clouds: "PointCloud | ArrayLike | str | os.PathLike[str]",
    names: Sequence[str] | None = None,
    title: str | None = None,
    color: str | None = None,
    only: Collection[str] | None = None,
    max_points: int = 5_000_000,
    height: int = 640,
) -> "CloudPage":
    """Make one HTML page that shows clouds in a browser, offline, and itself in Jupyter.

    Parameters
    ----------
    *clouds : PointCloud, array-like of shape (n, 3), or path
        Clouds or files to show. A `PointCloud` brings attributes to color by. Of two clouds, such
        as before and after, a slider shows each on its side.
    names : sequence of str, default=None
        A name for each cloud. None takes the files' names.
    title : str, default=None
        Title of the page. None takes the names.
    color : str, default=None
        Attribute to color by at first, or ``"height"``, which is z unless the clouds have an
        attribute of that name; then z is ``"height (2)"``. None chooses a result, such as
        ``region``, else colors, class, intensity or height.
    only : collection of str, default=None
        Attributes to put into the page. None takes all.
    max_points : int, default=5_000_000
        Largest number of points in the page, at least one for each cloud. Of more, so many are
        chosen at random.
    height : int, default=640
        Height in Jupyter, in pixels.

    Returns
    -------
    CloudPage
        The page, with ``save(path)``.

    Warns
    -----
    UserWarning
        If points are left out, because there are too many or a coordinate is not finite; if
        attributes are left out, because they hold no numbers.

    See Also
    --------
    plot_cloud : A still picture.

    Notes
    -----
    Coordinates in the page are those of the cloud if these are multiples of a decimal step, such
    as a millimeter, of at least 1/256 of the spacing. Else they are off by at most a sixteenth of
    the spacing; ``CloudPage.error`` tells. Numbers have 16 bits, and normals are within 0.06
    degrees.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.io import PointCloud
    >>> from sklearn_mcmd.plotting import view
    >>> xyz = np.random.default_rng(0).uniform(size=(1000, 3)).round(3)
    >>> page = view(PointCloud(xyz, {"region": np.arange(1000) % 3}), title="A cube")
    >>> page.n_shown, page.error
    (1000, 0.0)
    """
    from sklearn_mcmd.view._page import cloud_page

    return cloud_page(
        clouds,
        names=names,
        title=title,
        color=color,
        only=only,
        max_points=max_points,
        height=height,
    )
