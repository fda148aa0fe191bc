"""The ``mcmd`` command: verbs that map one to one to estimators.

Exit codes: 0 done; 1 failed, with one line on stderr; 2 wrong usage; 130 interrupted.
"""

import os
import tempfile
import time
import warnings
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

# Whatever takes long to import, or is an extra, is imported by the verb that needs it.

__all__ = ["app"]

app = typer.Typer(
    name="mcmd",
    help="Outliers, normals and curvature of point clouds: LAS, LAZ, PLY, PCD, E57, XYZ, TXT, CSV, "
    "NPY, NPZ, chosen by the extension.",
    epilog="Exit codes: 0 done, 1 failed (one line on stderr says why), 2 wrong usage, "
    "130 interrupted. An output file appears only when it is whole; it may be the input.",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


class Mode(StrEnum):
    drop = "drop"
    mark = "mark"


class OutlierMethod(StrEnum):
    mcmd_z = "mcmd_z"
    mcmd_md = "mcmd_md"


class NormalMethod(StrEnum):
    mcmd_z = "mcmd_z"
    mcmd_md = "mcmd_md"
    pca = "pca"


class Orientation(StrEnum):
    none = "none"
    up = "up"
    viewpoint = "viewpoint"
    mst = "mst"


InFile = Annotated[Path, typer.Argument(metavar="IN", help="Point file to read.")]
OutFile = Annotated[
    Path, typer.Argument(metavar="OUT", help="Point file to write, of any format; may be IN.")
]
NNeighbors = Annotated[
    int,
    typer.Option(
        min=4, help="Points in a neighborhood, the point itself included. More is smoother."
    ),
]
Cutoff = Annotated[
    float | None,
    typer.Option(
        help="Distance beyond which a point is an outlier, in robust standard deviations.",
        show_default="2.5, for mcmd_md 3.06",
    ),
]
OutlierRate = Annotated[
    float,
    typer.Option(
        min=0.0,
        max=0.99,
        help="Largest share of outliers in a neighborhood to be prepared for; sets the number of "
        "trials, not the share that is removed.",
    ),
]
RandomState = Annotated[
    int, typer.Option(min=0, max=2**32 - 1, help="Seed; the same seed gives the same file.")
]
NJobs = Annotated[int, typer.Option(help="Threads; -1 is one a processor.")]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="No progress bar and no summary; warnings stay.")
]


def _show_version(value: bool):
    if value:
        from sklearn_mcmd import __version__

        typer.echo(f"mcmd {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version."),
    ] = False,
):
    pass


@app.command()
def denoise(
    source: InFile,
    target: OutFile,
    mode: Annotated[
        Mode,
        typer.Option(
            help="drop: leave outliers out. mark: keep all points, outliers as class 7 (noise) in "
            "LAS and LAZ, as attribute 'outlier' elsewhere, beside an 'outlier_score'."
        ),
    ] = Mode.drop,
    n_neighbors: NNeighbors = 50,
    method: Annotated[
        OutlierMethod,
        typer.Option(
            help="mcmd_z: distance to the plane. mcmd_md: distance within the plane counts as well."
        ),
    ] = OutlierMethod.mcmd_z,
    cutoff: Cutoff = None,
    outlier_rate: OutlierRate = 0.5,
    random_state: RandomState = 0,
    n_jobs: NJobs = -1,
    quiet: Quiet = False,
):
    """Remove or mark the points that lie off the plane of their neighborhood."""
    with _clear_exits():
        seconds = _stopwatch()
        cloud = _read(source, target)
        mark = mode is Mode.mark
        blank = np.zeros(len(cloud))
        _rehearse(target, *_denoised(cloud, blank > 0, blank, mark))
        is_outlier, score = _find_outliers(
            cloud.xyz,
            quiet,
            n_neighbors=n_neighbors,
            method=str(method),
            cutoff=cutoff,
            outlier_rate=outlier_rate,
            random_state=random_state,
            n_jobs=n_jobs,
        )
        _warn_if_without_scale(score)
        _write(target, *_denoised(cloud, is_outlier, score, mark))
        if not quiet:
            n_outliers = int(np.count_nonzero(is_outlier))
            verb = "marked" if mark else "removed"
            _print_table(
                f"{source} -> {target}",
                points=f"{len(cloud):,}",
                **{verb: f"{n_outliers:,} ({100 * n_outliers / len(cloud):.2f} %)"},
                seconds=f"{seconds():.1f}",
            )


@app.command()
def normals(
    source: InFile,
    target: OutFile,
    n_neighbors: NNeighbors = 50,
    method: Annotated[
        NormalMethod,
        typer.Option(
            help="How outliers of a neighborhood are found before its plane is fitted; pca: not "
            "at all."
        ),
    ] = NormalMethod.mcmd_z,
    radius: Annotated[
        float | None,
        typer.Option(help="Largest distance of a neighbor, in units of the file.", min=0.0),
    ] = None,
    orientation: Annotated[
        Orientation,
        typer.Option(
            help="Which of two opposite normals. none, up: the one with positive z. viewpoint: the "
            "one to the scanner. mst: neighbors agree."
        ),
    ] = Orientation.none,
    viewpoint: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="The scanner, for --orientation viewpoint."),
    ] = None,
    features: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,...",
            help="More attributes, or all: linearity, planarity, sphericity, omnivariance, "
            "anisotropy, eigenentropy, verticality, roughness, normal_error (degrees; the true "
            "normal is within 1.73 of them with 95 % confidence).",
        ),
    ] = None,
    cutoff: Cutoff = None,
    outlier_rate: OutlierRate = 0.5,
    random_state: RandomState = 0,
    n_jobs: NJobs = -1,
    quiet: Quiet = False,
):
    """Add normals, curvature and eigenvalues, robust to outliers and edges.

    All points are kept. New attributes, float32: normal_x, normal_y, normal_z, surface_variation
    (curvature: 0 on a plane, at most 1/3), eigenvalue_0 to eigenvalue_2 (ascending), and
    removed_fraction, the share of the neighborhood that was left out; and the --features.
    """
    viewpoint = _parse_viewpoint(orientation, viewpoint)
    features = _parse_features(features)
    with _clear_exits():
        seconds = _stopwatch()
        if target.suffix.lower() == ".e57":
            raise ValueError(f"{target}: E57 has no place for normals; write another format")
        cloud = _read(source, target)
        columns = (*_NORMAL_COLUMNS, *features)
        _rehearse(target, _with_results(cloud, dict.fromkeys(columns, _blank(cloud))))
        results = _find_normals(
            cloud.xyz,
            quiet,
            n_neighbors=n_neighbors,
            method=str(method),
            radius=radius,
            orientation={"none": None, "up": [0.0, 0.0, 1.0]}.get(orientation, str(orientation)),
            viewpoint=viewpoint,
            features=features,
            cutoff=cutoff,
            outlier_rate=outlier_rate,
            random_state=random_state,
            n_jobs=n_jobs,
        )
        _write(target, _with_results(cloud, results))
        if not quiet:
            removed = float(results["removed_fraction"].mean(dtype=np.float64))
            _print_table(
                f"{source} -> {target}",
                points=f"{len(cloud):,}",
                removed=f"{100 * removed:.2f} % of an average neighborhood",
                curvature=f"{np.median(results['surface_variation']):.2g} (median)",
                seconds=f"{seconds():.1f}",
            )


@app.command()
def info(source: InFile):
    """Show what a file holds: points, bounds, spacing, duplicates, attributes."""
    with _clear_exits():
        from sklearn_mcmd._file_summary import summarize

        _print_table(str(source), **summarize(source, _read(source)))


@app.command()
def demo(
    folder: Annotated[
        Path, typer.Argument(metavar="[DIR]", help="Where to; made if need be.")
    ] = Path("mcmd-demo"),
    n_jobs: NJobs = -1,
    quiet: Quiet = False,
):
    """Clean a made-up street scan whose truth is known, and show how well that went.

    Writes street.laz (with outliers, and the truth as attributes), clean.laz, normals.laz and
    demo.png, and prints the accuracy.
    """
    with _clear_exits():
        seconds = _stopwatch()
        from sklearn_mcmd import _demo

        street, clean, with_normals = (
            folder / f"{name}.laz" for name in ("street", "clean", "normals")
        )
        _demo.write_street(street)
        denoise(street, clean, n_jobs=n_jobs, quiet=quiet)
        normals(clean, with_normals, n_jobs=n_jobs, quiet=quiet)
        with _progress_bar("Accuracy", quiet):
            angles = _demo.normal_errors(street, n_jobs)
        rates = _demo.outlier_rates(street, clean)
        _demo.draw(street, clean, with_normals, folder / "demo.png")
        if not quiet:
            _print_table(
                "Outliers, against the truth",
                **{name: f"{100 * rate:.1f} %" for name, rate in rates.items()},
            )
            _print_table(
                f"Normals of {street}, outliers and all: angle to the truth",
                **{
                    method: f"median {median:.2f}, 95 % below {high:.1f} degrees"
                    for method, (median, high) in angles.items()
                },
            )
            typer.echo(f"Picture: {folder / 'demo.png'}; {seconds():.1f} seconds in all.")


# ---- what the verbs do ----------------------------------------------------------------------

_NORMAL_COLUMNS = (
    *("normal_x", "normal_y", "normal_z", "surface_variation"),
    *("eigenvalue_0", "eigenvalue_1", "eigenvalue_2", "removed_fraction"),
)


# Standard deviations that no measured noise leads to, only the rounding of floats.
EXACT_PLANE_SCORE = 1e6


def _find_outliers(xyz, quiet, **params):
    """Whether each point is an outlier, and its robust distance to its plane."""
    from sklearn_mcmd import MCMDOutlierDetector

    with _progress_bar("Outliers", quiet):
        detector = MCMDOutlierDetector(**params).fit(xyz)
        scores = detector.score_samples(xyz)
    return scores < detector.offset_, -scores


def _warn_if_without_scale(score):
    """Say so where exact planes, which have no noise to measure by, made many outliers."""
    share = np.count_nonzero(score > EXACT_PLANE_SCORE) / len(score)
    if share >= 0.01:
        warnings.warn(
            f"{100 * share:.1f} % of the points are outliers only because most of their neighbors "
            "lie exactly in one plane, as where coordinates are rounded more coarsely than the "
            "noise; check these before they are dropped (--mode mark)",
            stacklevel=2,
        )


def _find_normals(xyz, quiet, **params):
    """The columns `_NORMAL_COLUMNS`, and those of `features`."""
    from sklearn_mcmd import RobustNormalEstimator

    with _progress_bar("Normals", quiet):
        fitted = RobustNormalEstimator(**params).fit(xyz)
    columns = np.column_stack(
        [
            fitted.normals_,
            fitted.surface_variation_,
            fitted.eigenvalues_,
            fitted.removed_fraction_,
            fitted.features_,
        ]
    )
    names = (*_NORMAL_COLUMNS, *params.get("features", ()))
    return dict(zip(names, columns.astype(np.float32).T.copy(), strict=True))


def _denoised(cloud, is_outlier, score, mark):
    """The cloud to write, and the points to mark in it."""
    if not mark:
        return cloud.subset(~is_outlier), None
    return _with_results(cloud, {"outlier_score": score.astype(np.float32)}), is_outlier


def _with_results(cloud, results):
    """The cloud with results, which replace input attributes written under the same names."""
    from sklearn_mcmd.io import PointCloud
    from sklearn_mcmd.io._point_cloud import flat_columns

    kept, replaced = {}, []
    for name, values in cloud.attributes.items():
        if name not in results and not flat_columns({name: values}).keys().isdisjoint(results):
            replaced.append(name)
        else:
            kept[name] = values
    if replaced:
        warnings.warn(
            f"the results replace what the input calls {', '.join(replaced)}", stacklevel=2
        )
    return PointCloud(cloud.xyz, {**kept, **results}, dict(cloud.metadata), cloud.n_dropped)


def _blank(cloud):
    return np.zeros(len(cloud), dtype=np.float32)


def _read(source, target=None):
    """Read a cloud; a `target` that cannot be written is refused before."""
    from sklearn_mcmd.io import PointCloud, read_points

    if target is not None:
        _rehearse(target, PointCloud(np.zeros((1, 3))))
    cloud = read_points(source)
    if cloud.n_dropped:
        warnings.warn(
            f"{source}: {cloud.n_dropped:,} points without finite coordinates are left out",
            stacklevel=2,
        )
    return cloud


def _write(target, cloud, noise=None):
    from sklearn_mcmd.io import write_points

    write_points(target, cloud, noise=noise)


def _rehearse(target, cloud, noise=None):
    """Write one point beside `target`, so that what must fail does so before the long work."""
    real = Path(os.path.realpath(target))
    if real.is_dir():
        raise ValueError(f"{target}: is a folder; name a file in it")
    if not real.parent.is_dir():
        raise ValueError(f"{target}: the folder {real.parent} does not exist")
    if real.exists() and not os.access(real, os.W_OK):
        raise ValueError(f"{target}: the file is write-protected")
    try:
        with (
            tempfile.TemporaryDirectory(prefix=".mcmd-", dir=real.parent) as folder,
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("ignore")  # the performance itself will give them
            stand_in = Path(folder) / target.name
            try:
                _write(stand_in, cloud.subset(slice(0, 1)), None if noise is None else noise[:1])
            except ValueError as err:
                raise ValueError(str(err).replace(str(stand_in), str(target))) from err
    except OSError as err:
        raise ValueError(
            f"{target}: cannot be written: {(err.strerror or str(err)).lower()}; check the "
            f"permissions of {real.parent}"
        ) from err


def _parse_viewpoint(orientation, text):
    """Three numbers, or None; whatever is wrong is wrong usage."""
    if (text is not None) != (orientation is Orientation.viewpoint):
        raise typer.BadParameter("--orientation viewpoint and --viewpoint X,Y,Z go together.")
    if text is None:
        return None
    try:
        position = [float(part) for part in text.split(",")]
    except ValueError:
        position = []
    if len(position) != 3 or not np.isfinite(position).all():
        raise typer.BadParameter(
            f"{text!r} is not three numbers separated by commas, such as 2.5,1,2.",
            param_hint="--viewpoint",
        )
    return position


def _parse_features(text):
    """Names of features; whatever is wrong is wrong usage."""
    from sklearn_mcmd._features import settle_features

    names = [part.strip() for part in (text or "").split(",") if part.strip()]
    try:
        return list(settle_features("all" if names == ["all"] else names))
    except ValueError as err:
        raise typer.BadParameter(str(err), param_hint="--features") from err


# ---- how the verbs speak --------------------------------------------------------------------


@contextmanager
def _clear_exits():
    """One line on stderr and an exit code for whatever a user can run into."""
    try:
        with _plain_warnings():
            yield
    except KeyboardInterrupt:
        _fail("interrupted, nothing was written", 130)
    except BrokenPipeError:
        raise
    except MemoryError:
        _fail("not enough memory; take fewer points or a smaller --n-neighbors")
    except (ValueError, OSError, ImportError) as err:
        _fail(str(err) or type(err).__name__)


def _fail(message, code=1):
    typer.echo(f"mcmd: error: {' '.join(message.split())}", err=True)
    raise typer.Exit(code)


@contextmanager
def _plain_warnings():
    """Show each warning meant for users once, in one line."""
    shown = set()

    def show(message, category, *args, **kwargs):
        text = " ".join(str(message).split())
        if text not in shown:
            shown.add(text)
            typer.echo(f"mcmd: warning: {text}", err=True)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = show
        yield


@contextmanager
def _progress_bar(title, quiet):
    """A bar on stderr, if that is a terminal, that follows the fits within."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn
    from rich.progress import TimeRemainingColumn as TimeLeft

    from sklearn_mcmd._progress import listen_to_progress

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeLeft())
    hidden = quiet or not console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=hidden) as bar:
        task = bar.add_task(title, total=None)  # pulses while code is compiled, on the first run

        def show(n_done, n_total):
            bar.update(task, completed=n_done, total=n_total)

        with listen_to_progress(show):
            yield


def _print_table(title, **rows):
    """A title and aligned lines of names and values."""
    typer.echo(title)
    width = max(map(len, rows))
    for name, value in rows.items():
        typer.echo(f"  {name:<{width}}  {value}")


def _stopwatch():
    start = time.perf_counter()
    return lambda: time.perf_counter() - start
