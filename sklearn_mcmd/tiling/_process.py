"""Files of any size through an estimator: what `sklearn_mcmd.tiling` offers."""

import os
from collections.abc import Iterable
from inspect import signature
from reprlib import repr as shorter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, clone

from sklearn_mcmd._choices import Mode
from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd._sklearn import check_parameters
from sklearn_mcmd.change import CloudChange
from sklearn_mcmd.edges import SharpFeatureDetector
from sklearn_mcmd.io import Trajectory
from sklearn_mcmd.io._classes import class_numbers
from sklearn_mcmd.outliers import MCMDOutlierDetector
from sklearn_mcmd.planes._base import BaseLocalPlanes
from sklearn_mcmd.segmentation import RegionGrowing
from sklearn_mcmd.tiling._catalog import Catalog
from sklearn_mcmd.tiling._change import TiledChange
from sklearn_mcmd.tiling._outliers import TiledOutliers
from sklearn_mcmd.tiling._regions import TiledRegions
from sklearn_mcmd.tiling._run import RunReport, run_by_tiles
from sklearn_mcmd.tiling._verbs import TiledEdges, TiledNormals

# What an estimator of each class does to files; the first that fits counts.
VERBS: dict[Any, Any] = {
    MCMDOutlierDetector: TiledOutliers,
    RegionGrowing: TiledRegions,
    SharpFeatureDetector: TiledEdges,
    CloudChange: TiledChange,
    BaseLocalPlanes: TiledNormals,
}


def process_files(
    source: Catalog | str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    target: str | os.PathLike[str],
    estimator: BaseEstimator,
    *,
    second: Catalog | str | os.PathLike[str] | Iterable[str | os.PathLike[str]] | None = None,
    mode: Mode = "drop",
    ignore_classes: Iterable[int] = (),
    only_classes: Iterable[int] = (),
    sensor_origin: "Trajectory | ArrayLike | None" = None,
    intensity: bool = False,
    colors: bool | None = None,
    regions: str | os.PathLike[str] | None = None,
    memory: str | float | None = None,
    n_jobs: int | None = None,
    tile_size: int | None = None,
    restart: bool = False,
) -> RunReport:
    """Write what an estimator finds in files larger than memory.

    All points are read once and divided into tiles. The estimator is fitted to each tile and the
    points around it, which are the neighbors of its points, their neighbors, and so on. One tile
    has the results of ``estimator.fit`` on all points, to the last bit. Of several, a few points
    where tiles meet may have others, and a region may be divided or joined in another place;
    `n_proven` of the report counts the points whose normals are those of memory for certain. The
    output is the same for any number of threads, processes and workers.

    Parameters
    ----------
    source : Catalog, or what it takes
        Files, a folder, or an index.
    target : str or os.PathLike
        A LAS or LAZ file for one file; a folder where `source` is several files, or a folder.
        Outputs have the names of their inputs, all attributes, and the order of the points. They
        may replace the inputs.
    estimator : estimator
        What is done, with an int as `random_state` and no None as `n_neighbors`:

        - :class:`~sklearn_mcmd.MCMDOutlierDetector` removes outliers, or marks them: see `mode`;
        - :class:`~sklearn_mcmd.RobustNormalEstimator` adds normals and what else it finds;
        - :class:`~sklearn_mcmd.RegionGrowing` adds an attribute ``region``. It takes
          ``normals="estimate"``. Regions of two tiles that share enough points are one;
        - :class:`~sklearn_mcmd.SharpFeatureDetector` adds ``edge``, 1 or 0, and ``edge_score``: the
          distance to the nearest crease in spacings, or the value of another criterion. It takes
          ``normals="estimate"``, and no detector but the first;
        - :class:`~sklearn_mcmd.CloudChange` adds what :class:`~sklearn_mcmd.change.Changes` has of
          each point, beside the `second` cloud. P-values are rounded up by less than 1 / 2,000,
          and 250,000 points of each cloud tell the motion of ``registration="auto"``.
    second : Catalog, or what it takes, default=None
        Of a :class:`~sklearn_mcmd.CloudChange`: the second cloud.
    mode : {"drop", "mark"}, default="drop"
        Of outliers. "drop" leaves them out; a file of nothing else becomes one without points.
        "mark" keeps all points, gives outliers the classification 7 (low noise) or 18 (high noise),
        and adds an attribute ``outlier_score``. An outlier is low if it lies lower than all ground
        (class 2) around it in plan, or if there is no ground, than all kept points: those in the
        smallest square that has at least `n_neighbors` of them, of squares whose sides are powers
        of two. Point formats 0 to 5 define no high noise: there it is 7, too.
    ignore_classes : iterable of int, default=()
        Of outliers. Points of these classes are neither judged nor used to judge others; their
        score is NaN. They are kept as they are. So are points that are marked withheld, always.
    only_classes : iterable of int, default=()
        If there are any, points of all other classes are left out in the same way.
    sensor_origin : Trajectory, or array-like of shape (n, 3), default=None
        Of outliers, and of normals with ``orientation="sensor"``: where the sensor was when it
        measured each point, if it had more than one position; an estimator's own parameter has
        one. A trajectory is read at the times of the points, see
        :func:`~sklearn_mcmd.io.sensor_origins`; positions are in the order of the inputs. One
        process has 24 bytes of each point for positions, and 30 for a trajectory.
    intensity : bool, default=False
        Of outliers: whether the intensity of the points is evidence, see :ref:`intensity`; or their
        reflectance or reflectivity, if that is the same everywhere.
    colors : bool, default=None
        Of regions and edges: whether to paint them. None paints files that have no colors.
    regions : str or os.PathLike, default=None
        Of regions: where to write the table ``regions_``, as ``.csv`` or ``.geojson``.
    memory : str or float, default=None
        What the run may take, such as "2GB" or a number of bytes. None is half of the machine's.
    n_jobs : int, default=None
        Processes. None means 1 unless in a :obj:`joblib.parallel_config` context, and -1 means all
        processors; fewer, where the memory asks for it.
    tile_size : int, default=None
        Largest number of points in a tile. None is 1,000,000, halved until a tile and what is
        around it fit into the memory, however many processes there are.
    restart : bool, default=False
        Whether to forget what an earlier run has left. By default a run with the same inputs and
        parameters goes on where the earlier one ended.

    Returns
    -------
    RunReport

    Raises
    ------
    PointFileError
        If a file cannot be read or written.
    TilingError
        If some tiles failed, or the run ended in another way after all points were read, and the
        same run may go on. Temporary files are then kept, and the message names them.
    ValueError
        If inputs make tiles fail, the estimator makes the whole cloud one neighborhood, an option
        has no meaning for it, a class is no whole number from 0 to 255, or the memory is too
        little.

    Warns
    -----
    UserWarning
        If an input was denoised before; if an output has no points, because all were outliers; or
        if hundreds of outliers, or 8 % of a small cloud, lie together, as a thing does that is
        sparser than what is around it.

    See Also
    --------
    Catalog : What files hold.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from sklearn_mcmd import MCMDOutlierDetector
    >>> from sklearn_mcmd.datasets import make_street
    >>> from sklearn_mcmd.io import read_points, write_points
    >>> from sklearn_mcmd.tiling import process_files
    >>> street = make_street(8_000, outlier_share=0.01, random_state=0).data
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     a, b = Path(folder) / "a.las", Path(folder) / "b.las"
    ...     write_points(a, street)
    ...     report = process_files(a, b, MCMDOutlierDetector(random_state=0), tile_size=3_000)
    ...     print(report.n_tiles, "tiles;", len(read_points(b)) + report.n_outliers, "points")
    4 tiles; 8000 points
    """
    given = {
        "second": second,
        "mode": mode,
        "ignore_classes": _classes("ignore_classes", ignore_classes),
        "only_classes": _classes("only_classes", only_classes),
        "colors": colors,
        "regions": regions,
        "sensor_origin": sensor_origin,
        "intensity": intensity,
    }
    verb = next((verb for kind, verb in VERBS.items() if isinstance(estimator, kind)), None)
    if verb is None:
        raise ValueError(
            f"{type(estimator).__name__} cannot work by tiles: give an MCMDOutlierDetector, a "
            "RobustNormalEstimator, a RegionGrowing, a SharpFeatureDetector or a CloudChange."
        )
    parameters, taken = signature(process_files).parameters, signature(verb).parameters
    for name, value in given.items():
        idle = parameters[name].default
        if name not in taken and repr(value) != repr(idle):
            raise ValueError(
                f"{name}={shorter(value)} has no meaning for {type(estimator).__name__}: leave it "
                f"{idle!r}."
            )
    if getattr(estimator, "normals", "estimate") != "estimate":
        raise ValueError(
            f"normals={estimator.normals!r} cannot work by tiles, which hold coordinates only: "
            "take normals='estimate'."
        )
    params = estimator.get_params()
    # The folder of a run knows parameters by their repr, and that of NumPy's numbers is no literal.
    own = {name: value.item() for name, value in params.items() if isinstance(value, np.generic)}
    own |= {name: 1 for name in params if name.endswith("n_jobs")}  # tiles have processes
    check_parameters(clone(estimator).set_params(**own | {"n_jobs": n_jobs}))
    estimator = clone(estimator).set_params(**own)
    options = {name: given[name] for name in taken if name in given}
    verb = verb(estimator, **options)
    # Positions and files have keys of their own.
    others = options.keys() - {"sensor_origin", "second"}
    verb.content = [f"{name}={options[name]}" for name in options if name in others]
    report = run_by_tiles(verb, source, target, memory, n_jobs, tile_size, restart)
    if report.together:
        warn_caller(report.together)
    return report


def _classes(name, given):
    try:
        return class_numbers(given)
    except ValueError as err:
        raise ValueError(f"{name}={shorter(given)} {err}, such as [6, 9].") from err
