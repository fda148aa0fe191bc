"""Outliers of clouds larger than memory: in sweeps over cells, with the scores of memory."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from sklearn.base import clone

from sklearn_mcmd._choices import Mode, choices_of
from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd._validation import is_auto
from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._classes import LOW_NOISE, Choice, classes_of_noise, ground_in
from sklearn_mcmd.io._ground import NONE_JUDGED, Ground, GroundLimits, HeightRange
from sklearn_mcmd.io._las import is_denoised, read_header
from sklearn_mcmd.io._point_cloud import denoised_before, with_results, without_outliers
from sklearn_mcmd.io._sensor import place_words, rows_of_sensor
from sklearn_mcmd.outliers import MCMDOutlierDetector
from sklearn_mcmd.outliers._calibration import calibrated_cutoff, check_rate
from sklearn_mcmd.outliers._detector import EXACT_PLANE_SCORE, judged_cloud, share_to_flag
from sklearn_mcmd.outliers._groups import group_depths
from sklearn_mcmd.outliers._lowest_points import LowestPoints
from sklearn_mcmd.outliers._model import JudgedCloud, n_by_rays
from sklearn_mcmd.outliers._surfaces import are_usable, surface_width
from sklearn_mcmd.planes._around import quantile_of
from sklearn_mcmd.planes._explaining import measure_farthest
from sklearn_mcmd.planes._nearest import COMPILE_FROM
from sklearn_mcmd.report._volumes import losses_of
from sklearn_mcmd.runtime._chunks import ahead, slices
from sklearn_mcmd.runtime._progress import listen_to_progress
from sklearn_mcmd.tiling._catalog import parts_of
from sklearn_mcmd.tiling._cells import GROUND, Cells, flat
from sklearn_mcmd.tiling._memory import check_groups_below, most_neighbors, work_of
from sklearn_mcmd.tiling._result_files import Results, fit_together, scores_of
from sklearn_mcmd.tiling._run import TiledVerb, check_estimator, warm_up
from sklearn_mcmd.tiling._sensor_origins import recognized, sensor_path, stored_origins
from sklearn_mcmd.tiling._stored_columns import ALL, StoredColumns
from sklearn_mcmd.tiling._stored_index import (
    CHUNK,
    SLACK,
    StoredIndex,
    by_distance,
    find_index,
    near_box,
    within_reach,
)
from sklearn_mcmd.tiling._stored_light import rank_light
from sklearn_mcmd.tiling._stored_offers import FACES, find_offers, offer_steps, settle
from sklearn_mcmd.tiling._sweeps import Job, warn_if_coarse
from sklearn_mcmd.tiling._tiled_judging import RAY_STEPS, STEPS, judge_in_cells
from sklearn_mcmd.tiling._tiled_rays import RAYS, origins_of

SOURCES = {"angles": "scan angles", "trajectory": "trajectory", "positions": "given", None: "given"}


class TiledOutliers(TiledVerb):
    """Outliers, in sweeps; points without scores are kept."""

    options = (
        *("mode", "ignore_classes", "only_classes", "above", "below", "low_groups"),
        *("sensor_origin", "intensity"),
    )
    last_sweep = "planes"

    def __init__(
        self, estimator, mode, ignore_classes, only_classes, sensor_origin, intensity, **heights
    ):
        if mode not in choices_of(Mode):
            raise ValueError(f"mode={mode!r} must be 'drop' or 'mark'.")
        check_estimator(estimator, MCMDOutlierDetector)
        estimator._check_choices(None, True if intensity else None)
        choice = Choice(ignore_classes, only_classes)
        self.mode, self.limits = mode, HeightRange.of(**heights)
        content = f"{mode} {choice} {self.limits} {intensity}"
        super().__init__(estimator, content, choice)
        self.needs_ground, self.needs_light = self.limits is not None, intensity
        self.asked = "intensity" if intensity else ""
        self.sensor = sensor_path(estimator, sensor_origin)

    def prepare(self, catalog):
        for path in catalog.paths:
            if is_denoised(read_header(path)):
                warn_caller(denoised_before(path))
        most = most_neighbors(catalog.n_points, self.estimator)
        self.detector, self.seen_as = recognized(self.estimator, catalog, self.choice)
        if self.sensor is not None:  # any position will do; those of angles are doubted
            origin = "auto" if self.sensor.kind == "angles" else "origin"
            self.detector = clone(self.detector).set_params(sensor_origin=origin)
        self.cutoff = cutoff_of(self.detector)
        work = "outliers" if self.limits is None else "heights"
        return work_of(work, None, self.detector, self.sensor, self.needs_light), 0, most

    def find(self, run):
        self.n_used = self.n_judged = int(run.cells.counts.sum())
        self.scored = run.folder.columns
        job, steps = OutlierJob.of(run, self.detector), outlier_steps(self.detector)
        by_height = self.limits is not None
        sweeps = run.sweeps(["heights", *steps, "verdicts"] if by_height else steps)
        if by_height:
            heights = Heights(run, self.limits, sweeps)
            self.n_judged = heights.find()
        self.cutoff = judge_cells(job, sweeps, self.cutoff, run.memory)
        if by_height:
            heights.find_verdicts()
            self.scored = heights.columns

    def results(self, run):
        if self.mode == "mark":
            self.lowest = self._lowest(run)
        return Results(self.scored, run.cells)

    def make(self, cloud, values, xyz):
        scores, depths = _judged(values)
        is_outlier = scores > self.cutoff
        if self.mode == "drop":
            return without_outliers(cloud, ~is_outlier), None
        classes = np.zeros(len(cloud), np.uint8)
        classes[is_outlier] = classes_of_noise(self.lowest, xyz[is_outlier])
        classes[depths > self.cutoff] = LOW_NOISE
        return with_results(cloud, {"outlier_score": scores.astype(np.float32)}), classes

    def measure(self, values):
        """Outliers, and those of them that have no scale, see `EXACT_PLANE_SCORE`."""
        scores, _ = _judged(values)
        limits = self.cutoff, max(self.cutoff, EXACT_PLANE_SCORE)
        return np.array([np.count_nonzero(scores > limit) for limit in limits])

    def report(self, run, total):
        n_outliers, n_exact = map(int, total)
        return {
            "together": losses_of(self.estimator, lambda: ahead(self._removed(run)), self.n_used),
            "n_outliers": n_outliers,
            "n_exact": n_exact,
            "removed_fraction": n_outliers / run.catalog.n_points,
            "n_judged": self.n_judged,
            "n_used": self.n_used,
            "sensor": self._sensor_rows(run),
        }

    def _sensor_rows(self, run):
        """The rows of a report on the sensor."""
        columns, positions = run.folder.columns, stored_origins(run.folder.cells)
        if not columns.is_done(ALL, RAYS):
            return {}
        words = self.seen_as or SOURCES[self.sensor and self.sensor.kind]
        if positions is None:
            positions = origins_of(np.full((1, 3), np.nan), self.detector)
        report, cells = columns.report(ALL, RAYS), range(len(run.cells))
        raised = (columns.read(cell, "raised") for cell in cells if report["used"])
        n = sum(n_by_rays(part, self.cutoff) for part in raised)
        where = place_words(positions, words) if report["used"] else ""
        return rows_of_sensor(where, report["doubt"], n)

    def _lowest(self, run):
        """The `LowestPoints` of the ground without outliers; of all kept points if it is little."""
        results, k, first = Results(self.scored, run.cells), self.estimator.n_neighbors, 0
        lowest = LowestPoints(run.catalog.n_points, k)
        for _, cloud, _ in parts_of(run.catalog.paths):
            scores = results.take(first, len(cloud))[:, 0]
            first += len(cloud)
            lowest.add(cloud.xyz[ground_in(cloud) & ~(scores > self.cutoff)])
        if lowest.n_points < k:
            lowest = LowestPoints(self.n_used, k)
            for cell, scores in enumerate(scores_of(self.scored, run.cells)):
                lowest.add(run.xyz(cell)[scores <= self.cutoff])
        return lowest

    def _removed(self, run):
        """Points, and which are outliers, but for groups below the ground, tile by tile."""
        for cell in range(len(run.cells)):
            scores, depths = _judged(self.scored.read(cell, "results"))
            yield run.xyz(cell), (scores > self.cutoff) & ~(depths > self.cutoff)


def _judged(values):
    """Scores, NaN of points that are not judged, and the depths of groups below the ground."""
    scores = values[:, 0]
    if values.shape[1] == 1:
        return scores, np.zeros(len(scores))
    depths = values[:, 1]
    return np.where(np.isnan(depths), np.nan, scores), depths


@dataclass(frozen=True)
class OutlierJob(Job):
    """A job whose estimator is an `MCMDOutlierDetector`."""

    n_explained: int = 0  # places that surfaces explain, once these are known
    by_rays: bool = False  # whether rays are followed

    def model(self):
        """The `LocalPlaneModel` of all places."""
        return self.model_on(StoredIndex(self.whole()))

    def judged(self, index, n_jobs=1, **known):
        """The places of an index, as the detector judges them; what is `known` as `JudgedCloud`."""
        known = {**known, "doubted": is_auto(self.estimator.sensor_origin)}
        settings = self.estimator._settings() | {"n_jobs": n_jobs}
        return JudgedCloud(self.model_on(index), **settings, **known)

    def planes(self):
        """The planes of all places, with the noise by which distances are measured."""
        whole = self.whole()
        planes = whole.planes()
        return planes._replace(scale=whole.open("noise")) if whole.has("noise") else planes

    def stored_columns(self):
        """What the sweeps fill: names and dtypes."""
        detector = self.estimator
        if detector._one_plane:
            return {}
        names = ["radius", "spacing", "other_spacing", "distances", "farthest", "owner_scale"]
        names += ["noise"] * (detector.noise_scale is not None)
        return {**FACES, "usable": bool, **dict.fromkeys(names, float)}


def cutoff_of(estimator):
    """The cutoff, where the cloud has no part in it; compiled code is then on disk for all."""
    check_rate(estimator.false_positive_rate)
    detector = clone(estimator)
    if is_auto(detector.sensor_origin):  # which would see nothing in other points
        detector.set_params(sensor_origin="origin")
    if detector.cutoff is None and share_to_flag(detector) is None:
        detector.set_params(false_positive_rate=None)  # it takes long, and is found later
    return -warm_up(detector).offset_


def outlier_steps(detector):
    """The steps of `judge_cells` in their order, as of `Sweeps`."""
    last = STEPS if detector.sensor_origin is None else RAY_STEPS
    last = () if detector._one_plane else last
    return "places", "neighbors", *offer_steps(detector), "planes", *last


def judge_cells(job, sweeps, cutoff, memory):
    """Write the scores of all points; returns the score beyond which points are outliers."""
    cells, columns, sweep = job.cells, job.columns, partial(sweeps, cells=job.cells, job=job)
    detector, n_jobs = job.estimator, sweeps.n_workers * job.n_threads
    least = max(COMPILE_FROM, detector.n_neighbors + 1)
    whole = find_index(sweep, job, detector.n_neighbors, least)
    if whole is None:
        fitted = fit_together(job, detector, cells, lambda fitted: -fitted.scores_)
        _keep_rays(columns, len(cells), judged_cloud(fitted))
        return -fitted.offset_
    if not columns.all_have(len(cells), "results"):
        whole.make(counts=np.int32)
        for cell in np.flatnonzero(cells.counts):
            whole.put(cell, counts=np.bincount(columns.read(cell, "place_of")))
        warn_if_coarse(job.constants, StoredIndex(whole))
        if detector.false_positive_rate is not None:
            columns.once("cutoff", partial(_calibrate, job))
        find_offers(sweep, job)
        whole.make(**job.stored_columns())
        sweep("planes", _find_planes)
        if not detector._one_plane:
            sweep("planes-settled", settle)
        whole.remove("asks")
        rank_light(job, memory)
        if not detector._one_plane:
            job = replace(job, by_rays=detector.sensor_origin is not None)
            judge_in_cells(sweep, job, memory, n_jobs)
    if detector.false_positive_rate is not None:
        return columns.report(ALL, "cutoff")["cutoff"]
    share = share_to_flag(detector)
    if share is not None:
        return -float(quantile_of(lambda: map(np.negative, scores_of(columns, cells)), share))
    return cutoff


def _calibrate(job):
    """The cutoff by which the false positive rate is met."""
    detector = job.estimator
    with listen_to_progress(None):
        known = job.model(), detector._settings(), detector.false_positive_rate
        return {"cutoff": calibrated_cutoff(*known)}


def _find_planes(cell, job):
    """Find the columns of a cell that `OutlierJob.stored_columns` names."""
    whole = job.whole()
    own, index = whole.rows(cell), StoredIndex(whole)
    judged, points = job.judged(index, job.n_threads), index.points[own]
    if judged.own_planes_only:
        model, distances = judged.model, []
        for rows in slices(own.stop, CHUNK, own.start):
            around = index.query_own(rows)
            found = model.evaluate_neighborhoods(index.points[rows], around)
            distances.append(judged.paper_scores(*found))
        return {"results": np.concatenate(distances)[job.columns.read(cell, "place_of"), None]}
    judged.counts = whole.open("counts")
    planes, spacing, other_spacing = judged.measure_planes(own)
    measured, farthest = judged.measured(planes), np.empty(len(points))
    measure_farthest(index, surface_width(index), own, farthest, job.n_threads)
    distances = judged.from_own_planes(points, measured)
    whole.change(cell, **{name: getattr(planes, name) for name in FACES})
    return {
        "radius": planes.radius,
        "spacing": spacing,
        "other_spacing": other_spacing,
        "farthest": farthest,
        "distances": distances,
        "usable": are_usable(planes, distances),
        **({"noise": measured.scale} if whole.has("noise") else {}),
    }


def _keep_rays(columns, n_cells, judged):
    """Keep what a `JudgedCloud` found by rays, where it knew of any."""
    if judged.rays is not None or judged.ray_doubt:
        for cell, part in enumerate(np.array_split(judged.raised, n_cells)):
            columns.write(cell, raised=part)
        columns.finish(ALL, RAYS, used=judged.rays is not None, doubt=judged.ray_doubt)


class Heights:
    """What heights over the ground tell in a run, beside the scores, which depend on none."""

    def __init__(self, run, limits, sweeps):
        self.run, self.limits = run, limits
        # Other limits have another folder.
        found = run.folder.results / "heights {} {} {}".format(*limits)
        found.mkdir(exist_ok=True)
        job = replace(Job.of(run, None), found=found)
        known = {"scored": run.folder.columns, "limits": limits}
        self.columns, self._sweep = job.columns, partial(sweeps, cells=run.cells, job=job, **known)

    def find(self):
        """Find which points are judged, and groups below the ground; returns how many are."""
        self._sweep("heights", _find_heights)
        cells = range(len(self.run.cells))
        n_judged = sum(self.columns.report(cell, "heights")["n_judged"] for cell in cells)
        if not n_judged:
            raise PointFileError(f"{self.run.catalog.paths[0]}: {NONE_JUDGED}")
        if self.limits.low_groups:
            self.columns.once("groups", partial(self._find_groups, cells))
        return n_judged

    def find_verdicts(self):
        """Find what heights say of each score, as results of their own."""
        self._sweep("verdicts", _find_verdicts)

    def _find_groups(self, cells):
        """Write how deep the groups of points below the ground lie; all are in memory at once."""
        columns = self.columns
        n_below = sum(len(columns.mapped(cell, "below")) for cell in cells)
        check_groups_below(n_below, self.run.memory)
        below = columns.gather(cells, "below")
        depths = group_depths(below[:, :3], below[:, 3], below[:, 4])
        columns.share(cells, "below", depths=depths)


def _find_heights(cell, job, scored, limits):
    """Find which points of a cell are judged, and those that lie below the ground.

    Columns: judged, of all points; below_rows, and below: coordinates, how deep, and the distance
    in plan of the third nearest ground point.
    """
    cells = job.cells
    xyz = np.ascontiguousarray(StoredColumns(scored, len(cells)).xyz(cells, cell))
    away, near = _nearest_ground(Cells(job.points / GROUND), xyz)
    judged = limits.judged(xyz[:, 2] - near.mean(axis=1))
    found = {"judged": judged, "n_judged": int(np.count_nonzero(judged))}
    if limits.low_groups:
        depth, away = near.min(axis=1) - xyz[:, 2], away[:, -1]
        rows = np.flatnonzero(judged & (depth > away))
        below = np.column_stack([xyz[rows], depth[rows], away[rows]])
        found |= {"below_rows": rows, "below": below}
    return found


def _find_verdicts(cell, job, scored, limits):
    """Find the scores of a cell's points, or depths below the ground if these are more."""
    results, columns = scored.read(cell, "results"), job.columns
    scores, depths = results[:, 0], np.zeros(len(results))
    if limits.low_groups:
        depths[columns.read(cell, "below_rows")] = columns.read(cell, "depths")
        scores = np.maximum(scores, depths)
    depths[~columns.read(cell, "judged")] = np.nan
    return {"results": np.column_stack([scores, depths])}


def _nearest_ground(cells, xyz):
    """What `Ground.nearest` returns, of all points of the ground."""
    plan, n_nearest = flat(xyz), GroundLimits().n_nearest
    found = np.full((2, len(xyz), n_nearest), np.inf)
    own = cells.of(plan)

    def nearest_in(cell, asked):
        ground, reach = cells.points(cell), SLACK * found[0, asked, -1]
        ground[:, 2] = cells.rows(cell)  # heights
        if np.isfinite(reach).all():
            ground = ground[near_box(flat(ground), plan[asked], reach)]
        return np.array(Ground(ground).nearest(xyz[asked]))

    for cell in np.unique(own):
        asked = np.flatnonzero(own == cell)
        found[:, asked] = nearest_in(cell, asked)
    for cell in by_distance(cells, plan, SLACK * found[0, :, -1]):
        asked = within_reach(cells, cell, plan, SLACK * found[0, :, -1])
        asked = asked[own[asked] != cell]
        if len(asked):
            both = np.concatenate([found[:, asked], nearest_in(cell, asked)], axis=2)
            nearest = np.lexsort(both[::-1])[:, :n_nearest]  # of equally distant ones the lowest
            found[:, asked] = np.take_along_axis(both, nearest[None], axis=2)
    return found
