"""The ``mcmd`` command. Each of its main verbs runs one estimator.

Exit codes: 0 done; 1 failed, with one line on stderr; 2 wrong usage; 130 interrupted.
"""

import time
from typing import Annotated

import typer

from sklearn_mcmd import __version__
from sklearn_mcmd.cli._demo import demo
from sklearn_mcmd.cli._denoise import denoise
from sklearn_mcmd.cli._edges import edges
from sklearn_mcmd.cli._info import info
from sklearn_mcmd.cli._messages import clear_exits, print_table, progress
from sklearn_mcmd.cli._normals import normals
from sklearn_mcmd.cli._options import Quiet, TypedCommand, config
from sklearn_mcmd.cli._plane import plan, plane
from sklearn_mcmd.cli._segment import segment
from sklearn_mcmd.cli._view import view
from sklearn_mcmd.io._formats import supported_extensions

# Libraries that take long to import, or are extras, are imported by the verb that needs them.

__all__ = ["app"]

app = typer.Typer(
    name="mcmd",
    help="Find outliers, normals, surfaces and edges of point clouds. The extension of a file "
    f"chooses its format: {' '.join(supported_extensions())}.",
    epilog="Exit codes: 0 done, 1 failed (one line on stderr says why), 2 wrong usage, "
    "130 interrupted. An output file appears only when it is complete. It may be the input file.",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(value: bool):
    if value:
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


def warm_up(quiet: Quiet = False) -> None:
    """Compile for this computer what denoise, normals, segment and edges need.

    Their first run then does not wait. The code is kept on disk until the package or Numba changes.
    """
    with clear_exits():
        import sklearn_mcmd
        from sklearn_mcmd.datasets import make_street

        begin = time.perf_counter()
        X = make_street(20_000, outlier_share=0.1, random_state=0).data
        estimators = (
            sklearn_mcmd.MCMDOutlierDetector,
            sklearn_mcmd.RobustNormalEstimator,
            sklearn_mcmd.RegionGrowing,
            sklearn_mcmd.SharpFeatureDetector,
        )
        with progress("warm-up", quiet) as part:
            for i, estimator in enumerate(estimators):
                with part(i / 4, (i + 1) / 4, estimator.__name__):
                    estimator(random_state=0).fit(X)
        if not quiet:
            print_table("Compiled", begin)


# Options that few need are not in the help of a verb; `mcmd config` has them all.
for verb in (denoise, normals, edges, segment, plane, plan, view):
    epilog = f"All settings and their defaults: mcmd config {verb.__name__}."
    app.command(cls=TypedCommand, epilog=epilog)(verb)
for other in (config, info, demo, warm_up):
    app.command()(other)
