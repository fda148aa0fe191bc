"""``mcmd change``."""

import os
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import sklearn_mcmd
from sklearn_mcmd._choices import ChangeCorrection
from sklearn_mcmd.cli import _files, _messages, _options
from sklearn_mcmd.cli._files import ReportFolder, write_report_of
from sklearn_mcmd.cli._messages import progress
from sklearn_mcmd.cli._options import command_of, length, made, option
from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.io._rehearsal import rehearse
from sklearn_mcmd.planes._resolution import in_own_precision

MOST_NAMED = 5  # surfaces that the summary names


@dataclass
class Change:
    """BEFORE and AFTER are clouds of one place, in one coordinate system. OUT has the points of
    BEFORE, each with the 'distance' to the surface of AFTER along its normal, positive upward, and
    to +y or +x of what is steeper than 80 degrees; 'distance_error', its standard error;
    'level_of_detection', beyond which one distance alone is significant; 'pvalue'; 'significant';
    and 'reason', why there is no distance: 1 nothing within reach, 2 no surface, 3 another surface.
    mcmd view OUT shows the distance.
    """

    source: Annotated[
        Path,
        typer.Argument(metavar="BEFORE", help="Point file of the first scan, or a folder of them."),
    ]
    other: Annotated[
        Path,
        typer.Argument(metavar="AFTER", help="Point file of the second scan, or a folder of them."),
    ]
    target: Annotated[Path, typer.Argument(metavar="OUT", help="Point file to write.")]
    registration: str | None = length(
        None,
        "Standard error of the registration of both scans, such as 3mm. auto: by the motion that "
        "most flat surfaces have in common; the summary then says which of them moved.",
        "auto",
        metavar="LENGTH|auto",
    )
    alpha: float = option(0.05, "Level of the tests, between 0 and 1.")
    correction: ChangeCorrection = option(
        "fdr",
        "What --alpha is. fdr: of the points called significant, the share that did not move. "
        "sidak: the chance that there is any such point. none: of the points that did not move, "
        "the share called significant.",
    )
    reach: float | None = length(
        None,
        "Largest distance from a point to the second scan.",
        show_default="ten radii of a neighborhood",
    )
    n_neighbors: _options.NNeighbors = 50
    unit: _options.Unit = ""
    random_state: _options.RandomState = 0
    n_jobs: _options.NJobs = -1
    report: ReportFolder = None
    columns: _options.Columns = None
    allow_coarse: _options.AllowCoarse = False
    help_all: _options.HelpAll = False
    quiet: _options.Quiet = False

    def run(self):
        from sklearn_mcmd._sklearn import check_parameters

        begin, estimator = time.perf_counter(), made(self, sklearn_mcmd.CloudChange)
        check_parameters(estimator)
        with progress("change", self.quiet):
            if os.path.realpath(self.target) == os.path.realpath(self.other):
                raise ValueError(f"{self.target}: is AFTER, whose points OUT does not have")
            _files.check_results(self.target, "distances")
            rehearse(self.target, self._blank())
            before = _files.read_all(self.source, self.columns)
            after = _files.read_all(self.other, self.columns)
            with _files.working(self.source, "change"):
                estimator.fit(in_own_precision(before.xyz))
            with _files.working(self.other, "change"):
                changes = estimator.compare(in_own_precision(after.xyz))
            cloud = with_results(before, columns_of(changes))
            _files.write(self.target, _files.Output(cloud))
            write_report_of(self, begin, partial(self._contents, before, changes))
        if not self.quiet:
            rows = {"points": f"{len(before):,} and {len(after):,}"}
            title = f"{self.source}, {self.other} -> {self.target}"
            _messages.print_table(title, begin, **rows, **self._rows(changes))

    def _blank(self):
        """One point with what is written, for a trial."""
        from sklearn_mcmd.io import PointCloud

        names = ("distance", "distance_error", "level_of_detection", "pvalue")
        values = {name: np.zeros(1, np.float32) for name in names}
        values |= {name: np.zeros(1, np.uint8) for name in ("significant", "reason")}
        return PointCloud(np.zeros((1, 3)), values)

    def _rows(self, changes):
        """Rows of the summary, and of a report."""
        from sklearn_mcmd.change._estimator import REASONS

        unit = f" {self.unit}" if self.unit else ""
        compared = changes.reason == 0
        n, n_compared = len(compared), np.count_nonzero(compared)
        rows = {"compared": _messages.number_and_share(n_compared, n)}
        for number, words in enumerate(REASONS[1:], 1):
            if count := np.count_nonzero(changes.reason == number):
                rows[words] = _messages.number_and_share(count, n)
        n_moved = np.count_nonzero(changes.significant)
        rows["significant"] = _messages.number_and_share(n_moved, max(n_compared, 1))
        if n_compared:
            level, distance = changes.level_of_detection[compared], changes.distance[compared]
            rows["level of detection"] = f"{np.median(level):.3g}{unit} of one point alone, median"
            rows["distance"] = f"{np.median(distance):.3g}{unit}, median"
            rows["noise alike nearby"] = f"errors {np.sqrt(changes.alike):.3g} times as large"
            if np.isnan(changes.alike):
                rows["noise alike nearby"] = "not looked for: the first scan is too small"
        return rows | ({} if changes.bodies is None else _body_rows(changes.bodies, unit))

    def _contents(self, cloud, changes):
        from sklearn_mcmd.report._change_page import change_contents

        return change_contents(cloud, columns_of(changes), changes, self._rows(changes), self.unit)


change = command_of(Change)


def _body_rows(bodies, unit):
    """The motion that flat surfaces share, and those that moved against it."""
    from sklearn_mcmd.report._change_page import place_digits

    shift, turn = (np.linalg.norm(bodies.motion[part]) for part in (slice(3), slice(3, 6)))
    moved = np.flatnonzero(bodies.moved)
    n_open = np.count_nonzero(np.isnan(bodies.pvalue))
    rows = {
        "flat surfaces": f"{len(bodies.moved)} in both, {len(moved)} moved against the others"
        + (f", {n_open} controlled by no other" if n_open else ""),
        "common motion": f"{shift:.3g}{unit}, and {np.degrees(turn):.2g} degrees",
    }
    digits = place_digits(bodies.place)
    for number, k in enumerate(moved[np.argsort(bodies.pvalue[moved], kind="stable")], 1):
        place = " ".join(f"{value:.{digits}f}" for value in bodies.place[k])
        words = f"{bodies.offset[k]:.3g} ± {bodies.offset_error[k]:.2g}{unit}"
        if number <= MOST_NAMED:
            rows[f"moved {number}"] = f"{words}, at {place}"
    return rows


def columns_of(changes):
    """What is written of each point."""
    names = ("distance", "distance_error", "level_of_detection", "pvalue")
    columns = {name: getattr(changes, name).astype(np.float32) for name in names}
    return columns | {
        "significant": changes.significant.astype(np.uint8),
        "reason": changes.reason,
    }
