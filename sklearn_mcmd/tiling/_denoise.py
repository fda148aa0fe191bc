"""Outliers of clouds larger than memory: in sweeps over cells, with the scores of memory."""

import os
import time
import warnings
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from sklearn.base import clone

from sklearn_mcmd.io._classes import Choice
from sklearn_mcmd.outliers import MCMDOutlierDetector
from sklearn_mcmd.outliers._calibration import calibrated_cutoff, sample_step
from sklearn_mcmd.planes._around import ratio
from sklearn_mcmd.planes._indexed_cloud import COMPILE_FROM
from sklearn_mcmd.planes._progress import listen_to_progress, progress_part
from sklearn_mcmd.tiling._catalog import Catalog
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._columns import Columns
from sklearn_mcmd.tiling._joining import join_parts
from sklearn_mcmd.tiling._lowest import lowest_points
from sklearn_mcmd.tiling._memory import check_division, parse_memory, plan_run, usual_memory
from sklearn_mcmd.tiling._outputs import (
    SCORED,
    content_of,
    has_scores,
    scores_in_parts,
    targets_of,
    write_denoised_outputs,
)
from sklearn_mcmd.tiling._ranks import evenly_along_x, exceeded_by
from sklearn_mcmd.tiling._rest import find_groups, find_isolation, find_scores
from sklearn_mcmd.tiling._run import (
    COMPUTED,
    SCATTERED,
    RunReport,
    check_seed,
    finish,
    finished_before,
    kept,
    scattered,
)
from sklearn_mcmd.tiling._surfaces import (
    RADIUS,
    SCALE,
    Job,
    find_explained,
    find_links,
    find_places,
    find_planes,
    fit_planes,
)
from sklearn_mcmd.tiling._tile import tile_files, write_whole
from sklearn_mcmd.tiling._work import compute_cells

__all__ = ["check_detector", "cutoff_of", "judge_cells", "write_denoised"]

WARM_UP = 3_000  # points that make this process load or compile the code once, for all others
# Points at so few places that compiled code does not judge them.
MOST_COPIES = 1_000_000
# The end of each sweep, as a share of the time.
ENDS = {
    "places": 0.02,
    "planes": 0.7,
    "links": 0.78,
    "explained": 0.83,
    "isolation": 0.95,
    "groups": 0.97,
    "scores": 1.0,
}
# What no sweep asks for when all are done that did.
DONE_WITH = {
    "explained": (
        *("planes", "distances", "usable", "farthest", "surface_labels", "surface_sizes"),
        *("surface_links", "surface_whole", "surface_others"),
    ),
    "isolation": ("spacing", "other_spacing"),
    "groups": ("rest_reach",),
}


def write_denoised(
    source: Catalog | str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    target: str | os.PathLike[str],
    estimator: MCMDOutlierDetector | None = None,
    *,
    mode: Literal["drop", "mark"] = "drop",
    ignore_classes: Iterable[int] = (),
    only_classes: Iterable[int] = (),
    memory: str | float | None = None,
    n_jobs: int | None = None,
    tile_size: int | None = None,
    cut: float = 0.5,
    as_folder: bool | None = None,
    restart: bool = False,
) -> RunReport:
    """Large files without their outliers, judged as all points together are in memory.

    All points are read once and divided into tiles. What the detector asks of the cloud is found
    in sweeps over the tiles: planes, surfaces, what these explain, and the company of all other
    points. Neighbors are searched for in other tiles wherever these may hold nearer ones, and
    surfaces and groups are joined across tiles. So the scores are those of ``estimator.fit`` on all
    points together, to the last bit, whatever the tiles are.

    Parameters
    ----------
    source : Catalog, or what it takes
        Files, a folder, or an index.
    target : str or os.PathLike
        A LAS or LAZ file, or a folder, as of `write_normals`.
    estimator : MCMDOutlierDetector, default=None
        With an int as `random_state` and as `n_neighbors`. None is
        ``MCMDOutlierDetector(random_state=0)``.
    mode : {"drop", "mark"}, default="drop"
        "drop" leaves out outliers; a file of nothing else becomes one without points. "mark" keeps
        all points, gives outliers the classification 7 (low noise) or 18 (high noise), and adds an
        attribute ``outlier_score``. An outlier is low if it lies lower than all ground (class 2)
        around it in plan, or if there is no ground, than all kept points: those in the smallest
        square that has at least `n_neighbors` of them, of squares whose sides are powers of two.
        Point formats 0 to 5 define no high noise: there it is 7, too.
    ignore_classes : iterable of int, default=()
        Points of these classes are neither judged nor used to judge others; their score is NaN.
        They are kept as they are. So are points that are marked withheld, always.
    only_classes : iterable of int, default=()
        If there are any, points of all other classes are left out in the same way.
    memory, n_jobs, tile_size, cut, as_folder, restart
        As of `write_normals`.

    Returns
    -------
    RunReport

    Raises
    ------
    PointFileError
        If a file cannot be read or written.
    TilingError
        If some tiles failed, or the run ended in another way after all points were read. Temporary
        files are then kept, and the message names them.
    ValueError
        If the estimator cannot work by tiles, or the memory is too little.

    Warns
    -----
    UserWarning
        If an output has no points, because all were outliers.

    See Also
    --------
    Catalog : What files hold.
    write_normals : Normals of such files.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from sklearn_mcmd.datasets import make_street
    >>> from sklearn_mcmd.io import read_points, write_points
    >>> from sklearn_mcmd.tiling import write_denoised
    >>> street = make_street(8_000, outlier_share=0.01, random_state=0).data
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     a, b = Path(folder) / "a.las", Path(folder) / "b.las"
    ...     write_points(a, street)
    ...     report = write_denoised(a, b, tile_size=3_000)
    ...     print(report.n_tiles, "tiles;", len(read_points(b)) + report.n_outliers, "points")
    4 tiles; 8000 points
    """
    begin = time.perf_counter()
    if mode not in ("drop", "mark"):
        raise ValueError(f"mode={mode!r} must be 'drop' or 'mark'.")
    if estimator is None:
        estimator = MCMDOutlierDetector(random_state=0)
    check_detector(estimator)
    check_division(tile_size, cut)
    memory = usual_memory() if memory is None else parse_memory(memory)
    catalog = source if isinstance(source, Catalog) else Catalog(source)
    targets = targets_of(catalog, Path(target), as_folder)
    estimator = clone(estimator).set_params(n_jobs=1)
    choice = Choice(tuple(sorted(ignore_classes)), tuple(sorted(only_classes)))
    content = content_of(mode, choice)
    if not restart and (report := finished_before(catalog, target, targets, estimator, content)):
        return report
    cutoff = cutoff_of(estimator)
    plan = plan_run(catalog.n_points, memory, n_jobs, tile_size=tile_size, work="outliers")
    folder = scattered(catalog, target, estimator, plan, cut, restart, choice)
    with kept(folder):
        for path in targets:
            path.parent.mkdir(exist_ok=True)
        cells, columns = Cells(folder.cells), Columns(folder.results)
        n_judged = int(cells.counts.sum())
        n_resumed = sum(columns.is_done(cell, "planes") for cell in range(len(cells)))
        job = Job(folder.cells, folder.results, estimator, folder.constants, n_judged)
        with progress_part(SCATTERED, COMPUTED):
            cutoff = judge_cells(job, cells, columns, plan.n_workers, cutoff)
        with progress_part(COMPUTED, 1.0, "writing"):
            lowest = None
            if mode == "mark":
                lowest = lowest_points(catalog, folder, cells, estimator.n_neighbors, cutoff)
            n_outliers, n_exact = write_denoised_outputs(
                catalog, targets, folder, mode, cutoff, choice, lowest
            )
        if columns.is_done(0, "planes"):
            n_proved = columns.total(len(cells), "planes", "n_proved")
        else:
            n_proved = n_judged
        report = RunReport(
            catalog.n_points, len(cells), plan.n_workers, n_resumed, int(n_proved),
            n_outliers / catalog.n_points, time.perf_counter() - begin, n_outliers, n_exact,
            n_judged=n_judged,
        )  # fmt: skip
        finish(folder, catalog, targets, estimator, report, content)
    return report


def check_detector(estimator):
    """Raise if a detector cannot work by tiles."""
    if not isinstance(estimator, MCMDOutlierDetector):
        raise ValueError(
            f"{type(estimator).__name__} cannot work by tiles: outliers are found by "
            "MCMDOutlierDetector."
        )
    if estimator.n_neighbors is None:
        raise ValueError(
            "n_neighbors=None cannot work by tiles: the whole cloud is one neighborhood."
        )
    if estimator.sensor_origin is not None or estimator.reflections:
        raise ValueError(
            "sensor_origin cannot work by tiles yet: beams that are next to each other lie in "
            "different tiles. Leave it None, or denoise the points in memory."
        )
    check_seed(estimator)


def cutoff_of(estimator):
    """The cutoff, where the cloud has no part in it; compiled code is then on disk for all."""
    points = np.random.default_rng(0).uniform(size=(WARM_UP, 3)) * [1, 1, 0.01]
    points[: WARM_UP // 2, 2] *= 100
    detector = clone(estimator)
    if detector.cutoff is None and detector.contamination is None:
        detector.set_params(false_positive_rate=None)  # it takes long, and is found later
    with warnings.catch_warnings(), progress_part(0.0, 0.0):
        warnings.simplefilter("ignore")
        return -detector.fit(points).offset_


def judge_cells(job, cells, columns, n_workers, cutoff):
    """Find the scores of all points, which are written as results beside the columns.

    Parameters
    ----------
    job : Job
    cells : Cells
    columns : Columns
    n_workers : int
    cutoff : float
        By `cutoff_of`.

    Returns
    -------
    cutoff : float
        The score beyond which points are outliers.
    """
    n_cells, begin = len(cells), 0.0

    def sweep(name, work, is_done=None):
        nonlocal begin
        is_done = is_done or partial(columns.is_done, sweep=name)
        todo = [cell for cell in range(n_cells) if not is_done(cell)]
        with progress_part(begin, ENDS[name], name):
            compute_cells(partial(work, job=job), cells, todo, n_workers)
        begin = ENDS[name]
        columns.remove(n_cells, *DONE_WITH.get(name, ()))

    def joined(name, least):
        if not columns.is_done("all", name):
            columns.finish("all", name, largest=join_parts(columns, n_cells, name, least))

    sweep("places", find_places)
    job = job._replace(n_places=columns.total(n_cells, "places", "n_places"))
    if job.n_places < max(COMPILE_FROM, job.detector.n_neighbors + 1):
        return _judge_together(job, cells, cutoff)
    sweep("planes", find_planes)
    if job.detector.false_positive_rate is not None:
        cutoff = _simulated_cutoff(job, columns, n_cells)
    if not job.paper:
        sweep("links", find_links)
        joined("surface", 0.0)
        sweep("explained", find_explained)
        n_explained = columns.total(n_cells, "explained", "n_explained")
        job = job._replace(n_explained=n_explained)
        sweep("isolation", find_isolation)
        if job.detector.strictness != "isolated":
            sweep("groups", find_groups)
            joined("group", job.least[1])
            job = job._replace(largest=columns.report("all", "group")["largest"])
    write = partial(_write, job.columns)
    sweep("scores", partial(find_scores, target=write), lambda cell: has_scores(job.columns, cell))
    if job.detector.contamination is not None:
        parts = partial(scores_in_parts, job.columns, n_cells)
        return exceeded_by(parts, job.detector.contamination)
    return cutoff


def _judge_together(job, cells, cutoff):
    """Scores of a cloud of few places, which other code judges than tiles."""
    if job.n_points > MOST_COPIES:
        raise ValueError(
            f"{job.n_points:,} points at {job.n_places:,} places are no cloud to be judged by tiles"
        )
    records = [cells.read(cell) for cell in range(len(cells))]
    rows, points = (np.concatenate([part[name] for part in records]) for name in ("row", "xyz"))
    order = np.argsort(rows)
    detector = clone(job.detector).fit(points[order].astype(job.constants.dtype))
    for cell, part in enumerate(records):
        places = np.searchsorted(rows, part["row"], sorter=order)
        _write(job.columns, cell, part["row"], -detector.scores_[places])
    return -detector.offset_


def _simulated_cutoff(job, columns, n_cells):
    """The cutoff of a false-positive rate, for planes as rough as those of the cloud."""
    if columns.is_done("all", "cutoff"):
        return columns.report("all", "cutoff")["cutoff"]
    roughness = []
    for cell, rows in evenly_along_x(
        lambda cell: columns.read(cell, "points", mmap=True), n_cells, job.n_places,
        sample_step(job.n_places),
    ):  # fmt: skip
        planes = columns.read(cell, "planes", mmap=True)[rows]
        roughness.append(ratio(planes[:, SCALE], planes[:, RADIUS]))
    points = np.random.default_rng(0).uniform(size=(WARM_UP, 3))
    settings = {
        "strictness": job.detector.strictness,
        "noise_scale": job.detector.noise_scale,
        "n_jobs": 1,
    }
    with listen_to_progress(None):
        cutoff = calibrated_cutoff(
            fit_planes(job._replace(constants=job.constants._replace(dtype="float64")), points),
            settings,
            job.detector.false_positive_rate,
            roughness=float(np.median(np.concatenate(roughness))),
        )
    columns.finish("all", "cutoff", cutoff=cutoff)
    return cutoff


def _write(folder, cell, rows, scores):
    """Write the scores of a tile under a temporary name, which they leave when they are whole."""
    results = np.empty(len(rows), SCORED)
    results["row"], results["values"][:, 0] = rows, scores
    write_whole(tile_files(folder, cell)[0], results)
