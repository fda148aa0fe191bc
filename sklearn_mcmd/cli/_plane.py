"""``mcmd plane``."""

import time
import warnings
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer

from sklearn_mcmd._choices import Correction, EliminationRule, Surface, Test
from sklearn_mcmd.cli import _files, _messages, _options, _sensor
from sklearn_mcmd.cli._files import ReportFolder, write_report_of
from sklearn_mcmd.cli._messages import progress
from sklearn_mcmd.cli._options import command_of, length, made, option
from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.io._rehearsal import rehearse
from sklearn_mcmd.planes._resolution import coordinate_steps

# Number of points that suffices to find the step of their coordinates.
MAX_LOOKED_AT = 20_000
ONE_PLANE = 0.2  # share of outliers; from here on those at one edge tilt a plane of least squares
N_WORST = 10  # points of the largest statistics that the report lists
# Figures that the terminal shows, as far as there are such.
SUMMARY = (
    *("outliers", "normal", "point", "dip", "dip direction", "errors", "lack of fit"),
    *("bow", "residuals", "sigma0", "variance ratio", "global test", "flatness", "form", "outside"),
    *("by range", "instrument", "zone", "against", "compared at", "registration"),
    *("tilt between", "offset"),
)


@dataclass
class Plane:
    """All points are kept. Outliers get class 7 (noise) in LAS and LAZ, elsewhere an attribute
    'outlier'. All points get a 'residual' (in units of the file) and a 'test_statistic', float32.
    Points that determine no plane are refused: fewer than four distinct points, or points along a
    line. --report shows the plane, its quality and the residuals.

    The files of a folder, or of an index .vpc, are tested as one plane, and written as one cloud.
    """

    source: _options.InFiles
    target: Annotated[
        Path | None,
        typer.Argument(
            metavar="OUT",
            help="Point file to write; may be IN. Without it the summary is all.",
            show_default=False,
        ),
    ] = None
    method: Literal["baarda", "fuzzy"] = option(
        "baarda",
        "baarda: data snooping, which removes the worst point and adjusts again. fuzzy: one "
        "adjustment, and a limit between outliers and the rest; the weaker test.",
    )
    test: Test = option(
        "w",
        "w: compare residuals with sigma0, or by tau if sigma0 is auto. tau, t: compare them with "
        "their own scale; without the robust start these find nothing above about 5 % of outliers.",
    )
    alpha: float = option(0.05, "Level of the test of the whole cloud, between 0 and 1.")
    sigma0: str = length(
        "auto",
        "Standard deviation of a coordinate. Give it if you know it. auto: estimated from the "
        "points that pass; a rough surface then passes like a smooth one.",
        "auto",
        metavar="LENGTH|auto",
    )
    correction: Correction | None = option(
        None,
        "How the level of one point follows from alpha. sidak, bonferroni: so that alpha is the "
        "level of all together, exactly or at most. none: it is alpha.",
        show_default="sidak, for fuzzy none",
    )
    elimination: EliminationRule | None = option(
        None,
        "For baarda only. single: remove the worst point of each round. all: remove all rejected.",
        show_default="single",
    )
    surface: Surface = option(
        "orthogonal",
        "orthogonal: residuals are distances from the plane, for any tilt. vertical: residuals are "
        "along z, for heights at exact positions; wrong for walls.",
    )
    toward: tuple | None = _sensor.position_option(
        "A place to whose side the normal points, such as where the scanner stood. Residuals are "
        "positive there.",
        name="--toward",
        show_default="up; of walls to +y, or to +x if they go along y",
    )
    robust_start: bool | None = option(
        None,
        "For baarda only. Start from the plane of the most coplanar half of the points. "
        "--no-robust-start is the paper's least squares.",
        show_default="true, for fuzzy false",
    )
    against: Path | None = option(
        None,
        "Another point file, in the same coordinates. Its plane is tested likewise, and compared: "
        "same, moved, tilted? With the smallest difference that would be seen.",
        metavar="B",
    )
    registration: float | None = length(
        None,
        "With --against: standard error of the registration of both clouds, such as 2mm. It enters "
        "the offset, and the tilt by a turn that takes the rims of the plane off as far.",
    )
    tolerance: float | None = length(
        None,
        "Width of the zone that shall hold the points, such as 0.005, or 5mm with --unit. Says how "
        "many are outside, and whether that is more than noise.",
        metavar="WIDTH",
    )
    weights_from: tuple | None = _sensor.position_option(
        "Where the scanner stood, also for --against. Points then have weights by the errors of "
        "its ranges and angles, which grow with the range and the angle of incidence; and the "
        "summary says by range whether these hold.",
        name="--weights-from",
    )
    range_error: float | None = length(
        None, "With --weights-from: standard deviation of a range, such as 2mm."
    )
    angle_error: float | None = option(
        None, "With --weights-from: standard deviation of a direction, in degrees.", min=0.0
    )
    range_ppm: float = option(
        0.0, "With --weights-from: what that of a range grows by, in millionths of it.", min=0.0
    )
    unit: _options.Unit = ""
    random_state: _options.RandomState = 0
    report: ReportFolder = None
    columns: _options.Columns = None
    allow_coarse: _options.AllowCoarse = False
    help_all: _options.HelpAll = False
    quiet: _options.Quiet = False

    def __post_init__(self):
        for name, value in (("elimination", self.elimination), ("robust-start", self.robust_start)):
            if self.method == "fuzzy" and value:
                raise typer.BadParameter("is for --method baarda.", param_hint=f"--{name}")
        if self.registration is not None and self.against is None:
            raise typer.BadParameter(
                "is of two clouds: name the other by --against.", param_hint="--registration"
            )
        instrument = {
            "--weights-from": self.weights_from,
            "--range-error": self.range_error,
            "--angle-error": self.angle_error,
        }
        if self.range_ppm or any(value is not None for value in instrument.values()):
            missing = [name for name, value in instrument.items() if value is None]
            if missing:
                words = "is missing: weights of a scan take a position and both errors."
                raise typer.BadParameter(words, param_hint=missing[0])
        if self.target is None and self.report is not None:
            raise typer.BadParameter("is missing, which --report needs.", param_hint="OUT")

    def run(self):
        from sklearn_mcmd._sklearn import check_parameters
        from sklearn_mcmd.adjustment._plane_figures import plane_figures

        begin = time.perf_counter()
        check_parameters(self.detector())
        with progress("plane", self.quiet):
            cloud = self._read()
            with _files.working(self.source, "plane"):
                _files.warn_if_coarse(cloud)
                scan = self._scan_weights(cloud.xyz)
                detector = self.tested(cloud.xyz, scan)
            more = self._further(detector, cloud, scan)
            more["n_worst"] = N_WORST if self.report else None
            figures = plane_figures(detector, cloud.xyz, self.unit, **more)
            if self.target is not None:
                from sklearn_mcmd.report._plane_page import plane_contents

                _files.write(self.target, _results(cloud, detector))
                contents = partial(plane_contents, cloud, detector, figures, self.unit)
                write_report_of(self, begin, contents)
        if not self.quiet:
            self._print_summary(detector.labels_ == -1, figures.rows(), begin)

    def detector(self):
        """The detector, with its parameters as options tell them."""
        from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector

        if self.method == "fuzzy":
            return made(self, FuzzyPlaneDetector)
        return made(self, BaardaPlaneDetector, robust_start=self.robust_start is not False)

    def tested(self, xyz, scan=None):
        """The fitted detector, of points that may have `ScanWeights`."""
        with warnings.catch_warnings(record=True) as caught:
            fitted = self.detector().fit(xyz, weights=None if scan is None else scan.weights)
        _check_width(fitted, xyz)  # what is refused needs no warning
        for one in caught:
            warnings.warn(one.message, stacklevel=2)
        share = np.mean(fitted.labels_ == -1)
        if share >= ONE_PLANE:
            warnings.warn(
                f"{100 * share:.1f} % of the {len(xyz):,} points are outliers: is it one plane? "
                "Find the planes with 'mcmd segment' first, and test each",
                stacklevel=2,
            )
        if fitted.global_test_pvalue_ < fitted.alpha:
            warnings.warn(
                f"the global test rejects this plane (p = {fitted.global_test_pvalue_:.2g}, level "
                f"{fitted.alpha:.2g}): its points scatter more than --sigma0 "
                f"{fitted.sigma0:g} says, or their surface is no plane",
                stacklevel=2,
            )
        return fitted

    def _scan_weights(self, xyz):
        """`ScanWeights` by the errors of the instrument, None where these are not given."""
        if self.weights_from is None:
            return None
        from sklearn_mcmd.adjustment import scan_weights

        return scan_weights(
            xyz,
            self.weights_from,
            range_error=self.range_error,
            angle_error=self.angle_error,
            range_ppm=self.range_ppm,
            normal=[0, 0, 1] if self.surface == "vertical" else None,
        )

    def _read(self):
        """The points to test; before, what cannot be written is refused."""
        if self.target is not None:
            _files.check_output(self.target, "results of a test")
        cloud = _files.read_all(self.source, self.columns)
        if self.target is not None:
            blank = _results(cloud)
            rehearse(self.target, blank.cloud, blank.noise)
        return cloud

    def _further(self, detector, cloud, scan):
        """Results that are asked for: flatness, and the comparison with another file's plane."""
        from sklearn_mcmd.adjustment import compare_planes, flatness, variance_components

        further: dict = {}
        if scan is not None:
            ranges = np.linalg.norm(cloud.xyz - self.weights_from, axis=1)
            components = variance_components(detector, cloud.xyz, ranges, sigma0=scan.sigma0)
            further["by_range"] = components
        if self.tolerance is not None:
            further["flatness"] = flatness(detector, cloud.xyz, self.tolerance)
        if self.against is not None:
            other = _files.read_all(self.against, self.columns)
            with _files.working(self.against, "the other plane"):
                fitted = self.tested(other.xyz, self._scan_weights(other.xyz))
            error = self.registration or 0.0
            further["comparison"] = compare_planes(detector, fitted, registration_error=error)
        return further

    def _print_summary(self, is_outlier, figures, begin):
        rows = {"points": f"{len(is_outlier):,}"}
        rows |= {name: figures[name] for name in SUMMARY if name in figures}
        rows["outliers"] = _messages.number_and_share(is_outlier.sum(), len(is_outlier))
        title = self.source if self.target is None else f"{self.source} -> {self.target}"
        _messages.print_table(title, begin, **rows)


plane = command_of(Plane)


def _check_width(detector, xyz):
    """Raise if the points that pass are no sheet, but lie around a line or a place."""
    from sklearn_mcmd.adjustment._determinacy import AS_THICK_AS_WIDE, normal_pvalue
    from sklearn_mcmd.adjustment._least_squares import adjust_plane

    retained = adjust_plane(xyz[detector.support_], surface="orthogonal")
    thick = np.sqrt(retained.sum_of_squares / retained.n_observations)
    # A file that rounds to millimeters, for example, turns a line into a narrow lattice.
    step = coordinate_steps(xyz[:: len(xyz) // MAX_LOOKED_AT + 1]).lattice
    pvalue = normal_pvalue(retained, rounding=np.sqrt(xyz.shape[1]) / 2 * step)
    if pvalue > detector.alpha:
        raise ValueError(
            f"{AS_THICK_AS_WIDE} (rms {thick:.2g} from the plane of best fit; p = {pvalue:.2g} > "
            f"--alpha {detector.alpha:g} in a test of width against thickness). They determine no "
            "plane: take points beside that line."
        )


def _results(cloud, detector=None):
    """The `Output` of a cloud with what a test says of its points; zeros without a detector."""
    columns = dict.fromkeys(("test_statistic", "residual"), np.zeros(len(cloud)))
    is_outlier = np.zeros(len(cloud), bool)
    if detector is not None:
        residuals, is_outlier = detector.residuals(cloud.xyz), detector.labels_ == -1
        columns = {"test_statistic": detector.test_statistic_, "residual": residuals}
    columns = {name: values.astype(np.float32) for name, values in columns.items()}
    return _files.Output(with_results(cloud, columns), is_outlier)
