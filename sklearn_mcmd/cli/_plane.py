"""``mcmd plane``."""

import os
import warnings
from contextlib import ExitStack
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer

from sklearn_mcmd import __version__
from sklearn_mcmd._choices import Correction, EliminationRule, Surface, Test
from sklearn_mcmd._extras import import_extra
from sklearn_mcmd.cli import _files, _messages, _options
from sklearn_mcmd.cli._config import Config
from sklearn_mcmd.cli._large import is_several, large_catalog, outputs_of
from sklearn_mcmd.cli._progress_bar import progress
from sklearn_mcmd.cli._reporting import ReportFolder, write_report_of
from sklearn_mcmd.io import PointCloud, read_points
from sklearn_mcmd.io._files import replacing
from sklearn_mcmd.io._las import writing_parts
from sklearn_mcmd.io._las_joined import joined_cloud, joined_header
from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.planes._resolution import coordinate_step

__all__ = ["plane"]

FIGURE_EXTENSIONS = (".png", ".pdf", ".svg")
# Number of points that suffices to find the step of their coordinates.
MAX_LOOKED_AT = 20_000
N_WORST = 10  # points of the largest statistics that the reports list
# Figures that the terminal shows, as far as there are such.
SUMMARY = (
    "outliers",
    "normal",
    "point",
    "tilt",
    "residuals",
    "sigma0",
    "global test",
    "flatness",
    "outside",
    "zone",
    "against",
    "tilt between",
    "offset",
)

Method = Literal["baarda", "fuzzy"]
OutFiles = Annotated[
    Path | None,
    typer.Argument(
        metavar="OUT",
        help="Point file to write, of any format, or a folder for several files; may be IN. It "
        "may be left out: then the summary is all that is told.",
        show_default=False,
    ),
]


def plane(
    source: _options.InFiles,
    target: OutFiles = None,
    method: Annotated[
        Method,
        typer.Option(
            help="baarda: data snooping, which removes the worst point and adjusts again. fuzzy: "
            "one adjustment, and a limit between outliers and the rest. fuzzy is the weaker test "
            "at the same critical value."
        ),
    ] = "baarda",
    test: Annotated[
        Test,
        typer.Option(
            help="w: compare residuals with sigma0, or by tau if sigma0 is auto. tau, t: compare "
            "them with their own scale; without the robust start these find nothing above about "
            "5 % of outliers."
        ),
    ] = "w",
    alpha: Annotated[
        float,
        _options.number_option(
            "Level of the test of the whole cloud, between 0 and 1.",
            expected="a number between 0 and 1",
            fits=lambda alpha: 0 < alpha < 1,
        ),
    ] = 0.05,
    sigma0: Annotated[
        str,
        _options.length_option(
            "Standard deviation of a coordinate, in units of the file. Give it if you know it. "
            "auto: estimated from the points that pass; a rough surface then passes like a "
            "smooth one.",
            True,
            "auto",
            metavar="LENGTH|auto",
        ),
    ] = "auto",
    correction: Annotated[
        Correction | None,
        typer.Option(
            help="How the level of one point follows from alpha. sidak, bonferroni: so that alpha "
            "is the level of all together, exactly or at most. none: it is alpha, and that share "
            "of the good points is flagged. b-method: so too, and the level of the global test "
            "follows from it.",
            show_default="sidak, for fuzzy none",
        ),
    ] = None,
    elimination: Annotated[
        EliminationRule | None,
        typer.Option(
            help="For baarda only. single: remove the worst point of each round. all: remove all "
            "rejected points.",
            show_default="single",
        ),
    ] = None,
    surface: Annotated[
        Surface,
        typer.Option(
            help="orthogonal: residuals are distances from the plane, for any tilt. vertical: "
            "residuals are along z, for heights at exact positions; wrong for walls."
        ),
    ] = "orthogonal",
    robust_start: Annotated[
        bool | None,
        typer.Option(
            help="For baarda only. Start from the plane of the most coplanar half of the points, "
            "so that outliers at one edge do not tilt it. --no-robust-start is the paper's least "
            "squares.",
            show_default="robust-start",
        ),
    ] = None,
    against: Annotated[
        Path | None,
        typer.Option(
            metavar="B",
            help="Another point file, in the same coordinates. Its plane is tested likewise, and "
            "compared: same, moved, tilted? With the smallest difference that would be seen.",
        ),
    ] = None,
    tolerance: Annotated[
        float | None,
        _options.length_option(
            "Width of the zone that shall hold the points: a number in units of the file, or such "
            "as 5mm with --unit. Says how many are outside, and whether that is more than noise.",
            metavar="WIDTH",
        ),
    ] = None,
    text: Annotated[
        Path | None,
        typer.Option(
            help="Text report to write.", show_default="OUT, its extension replaced by _report.txt"
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            help="Figure to write: .png, .pdf or .svg.",
            show_default="OUT, its extension replaced by _report.png",
        ),
    ] = None,
    unit: _options.Unit = "",
    random_state: _options.RandomState = 0,
    report: ReportFolder = None,
    columns: _options.Columns = None,
    no_clobber: _options.NoClobber = False,
    allow_coarse: _options.AllowCoarse = False,
    config: Config = None,
    quiet: _options.Quiet = False,
) -> None:
    """Test one plane, such as a wall or a floor: mark its outliers and write a report.

    All points are kept. Outliers get class 7 (noise) in LAS and LAZ, elsewhere an attribute
    'outlier'. All points get a 'residual' (in units of the file) and a 'test_statistic', float32.
    The report, as text and as figure, shows the plane, its quality and the residuals. Points that
    determine no plane are refused: fewer than four distinct points, or points along a line.

    The files of a folder, or of an index .vpc, are tested as one plane. A folder OUT gets one file
    for each; an OUT that ends in .las or .laz gets all.
    """
    params = _detector_params(
        method, alpha, test, sigma0, correction, elimination, surface, robust_start
    )
    if method == "baarda":
        params["random_state"] = random_state
    if target is None and (text or plot or report):
        raise typer.BadParameter(
            "is missing. It can be left out if there are no --text, --plot and --report.",
            param_hint="OUT",
        )
    sheets = () if target is None else _choose_sheets(source, target, text, plot)
    with _messages.clear_exits(allow_coarse=allow_coarse):
        seconds = _messages.stopwatch()
        with progress("plane", quiet):
            catalog = large_catalog(source, 0, 0, columns=columns) if is_several(source) else None
            if target is not None:
                _files.refuse_existing(no_clobber, target, *sheets, report=report, catalog=catalog)
                sheets = _rehearse(target, catalog, sheets, plot)
            cloud = _read(source, target, catalog, columns)
            with _files.working(source, "plane"):
                _files.warn_if_coarse(cloud)
                detector = _test_plane(cloud.xyz, method, params)
            more = _further(detector, cloud, tolerance, against, method, params, columns)
            figures = _figures_of(detector, cloud, unit, more, lists_worst=target is not None)
            if target is not None:
                from sklearn_mcmd.report._plane_page import plane_contents

                title = f"Plane test of {source.name}"
                text = _text_of(title, figures, source, target, sheets)
                draw = partial(_draw, detector, cloud, title=title, unit=unit)
                _write_all(target, catalog, sheets, cloud, detector, text, draw)
                contents = partial(plane_contents, cloud, detector, figures, unit)
                write_report_of(report, source, target, seconds, contents)
        if not quiet:
            _summarize(source, target, sheets, detector, figures, seconds())


def _rehearse(target, catalog, sheets, plot_wanted):
    """The paths of text and figure after a trial; None for a figure that cannot be drawn."""
    if catalog is not None:
        outputs_of(catalog, target)
    text, plot = sheets
    for path in (text,) if catalog is not None else (target, text):
        with _files.standing_in(path):
            pass
    try:
        import_extra("matplotlib", "plot", "the figure")
    except (ImportError, OSError) as err:  # it refuses to be without any folder to write to
        if plot_wanted is not None:
            raise
        warnings.warn(f"{err}; the text alone is written", stacklevel=2)
        return text, None
    with _files.standing_in(plot):
        pass
    return text, plot


def _read(source, target, catalog, columns):
    """The points to test; of several files that are written one by one, the coordinates alone."""
    if target is None:
        return _files.read_all(source, columns)
    if catalog is not None:
        clouds = (_files.read(path, columns=columns) for path in catalog.paths)
        return PointCloud(np.concatenate([cloud.xyz for cloud in clouds]))
    cloud = _files.read(source, target, "results of a test", columns=columns)
    none = _files.blank(cloud)
    _files.rehearse(target, *_tested(cloud, none > 0, none, none))
    return cloud


def _detector_params(method, alpha, test, sigma0, correction, elimination, surface, robust_start):
    """Parameters of the detector; options that the method lacks are wrong usage."""
    params = {"alpha": alpha, "test": test, "sigma0": sigma0, "surface": surface}
    if correction is not None:
        params["correction"] = correction
    if method == "baarda":
        params["elimination"] = elimination or "single"
        params["robust_start"] = robust_start is not False
    elif elimination is not None:
        raise typer.BadParameter("--method fuzzy eliminates nothing.", param_hint="--elimination")
    elif robust_start:
        raise typer.BadParameter(
            "--method fuzzy is of one least-squares plane.", param_hint="--robust-start"
        )
    return params


def _choose_sheets(source, target, text, plot):
    """Paths of the text and the figure, which must not be those of the point files."""
    # Not OUT with .txt, which may be the name of a point file.
    text = text or target.with_name(f"{target.stem}_report.txt")
    plot = plot or target.with_name(f"{target.stem}_report.png")
    if plot.suffix.lower() not in FIGURE_EXTENSIONS:
        raise typer.BadParameter(
            f"{plot}: a figure ends in {', '.join(FIGURE_EXTENSIONS)}.", param_hint="--plot"
        )
    taken = {os.path.realpath(source): "IN", os.path.realpath(target): "OUT"}
    for option, path in (("--text", text), ("--plot", plot)):
        other = taken.setdefault(os.path.realpath(path), option)
        if other != option:
            raise typer.BadParameter(f"{path} is {other} as well.", param_hint=option)
    return text, plot


def _test_plane(xyz, method, params):
    """The fitted detector."""
    from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector

    detector = {"baarda": BaardaPlaneDetector, "fuzzy": FuzzyPlaneDetector}[method]
    with warnings.catch_warnings(record=True) as caught:
        fitted = detector(**params).fit(xyz)
    _check_width(fitted, xyz)  # what is refused needs no warning
    for one in caught:
        warnings.warn(one.message, stacklevel=2)
    if fitted.global_test_pvalue_ < fitted.global_test_level_:
        warnings.warn(
            f"the global test rejects this plane (p = {fitted.global_test_pvalue_:.2g}, level "
            f"{fitted.global_test_level_:.2g}): its points scatter more than --sigma0 "
            f"{fitted.sigma0:g} says, or their surface is no plane",
            stacklevel=2,
        )
    return fitted


def _further(detector, cloud, width, against, method, params, columns):
    """Results that are asked for: flatness, and the comparison with the plane of another file."""
    from sklearn_mcmd.adjustment import compare_planes, flatness

    further = {}
    if width is not None:
        further["flatness"] = flatness(detector, cloud.xyz, width)
    if against is not None:
        other = _files.read_all(against, columns)
        with _files.working(against, "the other plane"):
            fitted = _test_plane(other.xyz, method, params)
        further["comparison"] = compare_planes(detector, fitted)
    return further


def _check_width(detector, xyz):
    """Raise if the points that pass are no sheet, but lie around a line or a place."""
    from sklearn_mcmd.adjustment._determinacy import AS_THICK_AS_WIDE, normal_pvalue
    from sklearn_mcmd.adjustment._least_squares import adjust_plane

    retained = adjust_plane(xyz[detector.support_], surface="orthogonal")
    thick = np.sqrt(retained.sum_of_squares / retained.n_observations)
    # A file that rounds to millimeters, for example, turns a line into a narrow lattice.
    step = coordinate_step(xyz[:: len(xyz) // MAX_LOOKED_AT + 1])
    pvalue = normal_pvalue(retained, rounding=np.sqrt(xyz.shape[1]) / 2 * step)
    if pvalue > detector.alpha:
        raise ValueError(
            f"{AS_THICK_AS_WIDE} (rms {thick:.2g} from the plane of best fit; p = {pvalue:.2g} > "
            f"--alpha {detector.alpha:g} in a test of width against thickness). They determine no "
            "plane: take points beside that line."
        )


def _tested(cloud, is_outlier, statistic, residuals):
    """The cloud to write, and the points to mark in it."""
    results = {"test_statistic": statistic, "residual": residuals}
    results = {name: values.astype(np.float32) for name, values in results.items()}
    return with_results(cloud, results), is_outlier


def _figures_of(detector, cloud, unit, more, lists_worst):
    from sklearn_mcmd.adjustment._plane_figures import plane_figures

    n_worst = N_WORST if lists_worst else None
    return plane_figures(detector, cloud.xyz, unit, n_worst=n_worst, **more)


def _text_of(title, figures, source, target, sheets):
    """The text report, and as its last lines input, output, program and date."""
    from sklearn_mcmd.adjustment._text_report import figures_as_text, with_heading

    rows = {
        "input": source,
        "output": target,
        "figure": sheets[1] or "none",
        "program": f"sklearn-mcmd {__version__}, mcmd plane",
        "date": datetime.now().astimezone().isoformat(sep=" ", timespec="seconds"),
    }
    return figures_as_text(title, figures) + "\n".join(with_heading("Record", rows)) + "\n"


def _draw(detector, cloud, **options):
    from sklearn_mcmd.adjustment import plot_report

    return plot_report(detector, cloud.xyz, **options)


def _write_all(target, catalog, sheets, cloud, detector, text, draw):
    """Write the points and both sheets; no file is replaced before all are on the disk."""
    text_file, plot = sheets
    with ExitStack() as stack:
        temporary = stack.enter_context(replacing(text_file))
        with _files.naming(text_file):
            temporary.write_text(text, encoding="utf-8", errors="replace")
        if plot is not None:
            temporary = stack.enter_context(replacing(plot))
            figure = draw()
            with _files.naming(plot):
                figure.savefig(temporary, dpi=150)
        residuals = detector.residuals(cloud.xyz)
        results = (detector.labels_ == -1, detector.test_statistic_, residuals)
        if catalog is None:
            _files.write(target, *_tested(cloud, *results))
        else:
            _write_each(catalog, target, results)


def _write_each(catalog, target, results):
    """Write the points of each file with their results, or all into one file."""
    paths = outputs_of(catalog, target)
    ends = np.cumsum(catalog.counts)[:-1]
    parts = zip(*(np.split(values, ends) for values in results), strict=True)
    clouds = map(read_points, catalog.paths)
    if len(paths) == len(catalog):
        paths[0].parent.mkdir(exist_ok=True)
        for path, cloud, part in zip(paths, clouds, parts, strict=True):
            _files.write(path, *_tested(cloud, *part))
        return
    header = joined_header(catalog.paths)
    with replacing(target) as temporary, writing_parts(temporary) as put:
        for cloud, part in zip(clouds, parts, strict=True):
            put(*_tested(joined_cloud(cloud, header), *part))


def _summarize(source, target, sheets, detector, figures, seconds):
    known, is_outlier = figures.rows(), detector.labels_ == -1
    rows = {name: known[name] for name in SUMMARY if name in known}
    rows["outliers"] = _messages.count_and_share(is_outlier)
    if sheets:
        rows["report"] = ", ".join(str(path) for path in sheets if path is not None)
    _messages.print_summary(source, target, len(is_outlier), seconds, **rows)
