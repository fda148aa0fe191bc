"""``mcmd change``."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import sklearn_mcmd
from sklearn_mcmd._choices import ChangeCorrection
from sklearn_mcmd.cli import _files, _messages, _options
from sklearn_mcmd.cli._cloud_verb import BY_TILES, CloudVerb, tiles_row
from sklearn_mcmd.cli._options import command_of, length, made, option
from sklearn_mcmd.io._formats import TILED
from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.planes._resolution import in_own_precision

MOST_NAMED = 5  # surfaces that the summary names


@dataclass(kw_only=True)
class Change(CloudVerb):
    """BEFORE and AFTER are clouds of one place, in one coordinate system. OUT has the points of
    BEFORE, each with the 'distance' to the surface of AFTER along its normal, positive upward, and
    to +y or +x of what is steeper than 80 degrees; 'distance_error', its standard error;
    'level_of_detection', beyond which one distance alone is significant; 'pvalue'; 'significant';
    and 'reason', why there is no distance: 1 nothing within reach, 2 no surface, 3 another surface.
    mcmd view OUT shows the distance.
    """

    source: Annotated[
        Path, typer.Argument(metavar="BEFORE", help=f"First scan. {_options.SOURCES}")
    ]
    target: Annotated[
        Path, typer.Argument(metavar="OUT", help="Point file to write, or a folder; may be BEFORE.")
    ]
    other: Annotated[Path, typer.Argument(metavar="AFTER", help="Second scan, likewise.")]
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

    results = "distances"

    @property
    def inputs(self):
        return [self.source, self.other]

    def estimator(self):
        return made(self, sklearn_mcmd.CloudChange)

    def check_options(self, catalog):
        if os.path.realpath(self.target) == os.path.realpath(self.other):
            raise ValueError(f"{self.target}: is AFTER, whose points OUT does not have")
        if catalog is None and all(path.suffix.lower() in TILED for path in self.inputs):
            from sklearn_mcmd.tiling import Catalog

            Catalog(self.inputs)  # refuses several coordinate systems

    def tile_options(self):
        return {"second": self.other}

    def find(self, cloud, estimator):
        from sklearn_mcmd.change._comparison import Summary

        after = _files.read(self.other, columns=self.columns)
        estimator.fit(in_own_precision(cloud.xyz))
        with _files.working(self.other):
            changes = estimator.compare(in_own_precision(after.xyz))
        return {"changes": changes, "change": Summary.of(changes).stored()}

    def written(self, cloud, outcome=None):
        from sklearn_mcmd.change._comparison import Changes, columns_of

        blank = Changes(*np.zeros((6, len(cloud))))
        changes = blank if outcome is None else outcome.changes
        return _files.Output(with_results(cloud, columns_of(changes)))

    def rows(self, outcome):
        from sklearn_mcmd.change._comparison import REASONS, Summary

        told, unit = Summary.read(outcome.change), f" {self.unit}" if self.unit else ""
        n_compared, *others = told.reasons
        rows = {"compared": _messages.number_and_share(n_compared, outcome.n_points)}
        for words, count in zip(REASONS[1:], others, strict=True):
            if count:
                rows[words] = _messages.number_and_share(count, outcome.n_points)
        rows["significant"] = _messages.number_and_share(told.n_significant, max(n_compared, 1))
        if n_compared:
            level = f"{told.level_of_detection:.3g}{unit}"
            rows["level of detection"] = f"{level} of one point alone, median"
            rows["distance"] = f"{told.distance:.3g}{unit}, median"
            times = f"errors {np.sqrt(told.alike):.3g} times as large"
            rows["noise alike nearby"] = times if told.alike > 1 else "none"
            if np.isnan(told.alike):
                rows["noise alike nearby"] = "not looked for: the first scan is too small"
        bodies = {} if told.bodies is None else _body_rows(told.bodies, unit)
        return tiles_row(outcome) | rows | bodies

    def contents(self, cloud, outcome):
        from sklearn_mcmd.report._shown import Shown

        written = self.written(cloud, outcome).cloud.attributes
        names = ("distance", "significant", "reason")
        columns = {name: written[name] for name in names}
        return self._contents(Shown.of_memory(cloud, 0, None, **columns), outcome)

    def tile_contents(self, catalog, run):
        return self._contents(self.shown(catalog, run, ["distance", "significant", "reason"]), run)

    def _contents(self, shown, outcome):
        from sklearn_mcmd.change._comparison import Summary
        from sklearn_mcmd.report._change_page import change_contents

        told, rows = Summary.read(outcome.change), self.rows(outcome)
        rows.pop("tiles", None)  # which reports tell of all verbs
        return change_contents(shown, told, rows, self.unit)


change = command_of(Change, more=BY_TILES)


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
