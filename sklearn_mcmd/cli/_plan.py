"""``mcmd plan``."""

from typing import Annotated

import typer

from sklearn_mcmd.cli import _messages, _options
from sklearn_mcmd.cli._config import Config

__all__ = ["plan"]


def _share(help, least=1e-300, below=1.0):
    return _options.number_option(
        help,
        expected=f"a number {'above' if least else 'from'} 0 and below {below:g}",
        fits=lambda share: least <= share < below,
    )


def plan(
    points: Annotated[int, typer.Option(min=5, help="Points on the plane.")] = 100,
    sigma0: Annotated[float, _options.length_option("Standard deviation of a point.")] = 1.0,
    width: Annotated[
        float, _options.length_option("Of the plane, in the unit of sigma0, for the normal.")
    ] = 1.0,
    height: Annotated[float, _options.length_option("The other side of the plane.")] = 1.0,
    alpha: Annotated[float, _share("Level of the test of all points.")] = 0.05,
    outlier_rate: Annotated[
        float, _share("Share of outliers; there is at least one.", least=0.0, below=0.5)
    ] = 0.0,
    power: Annotated[float, _share("Share of the outliers that shall be found.")] = 0.8,
    robust_start: Annotated[
        bool, typer.Option(help="Start from the plane of the most coplanar half of the points.")
    ] = True,
    repetitions: Annotated[
        int, typer.Option(min=100, help="Simulated planes of each size of bias.")
    ] = 10_000,
    unit: _options.Unit = "",
    random_state: _options.RandomState = 0,
    config: Config = None,
) -> None:
    """Say before a measurement which errors of a plane its tests will find.

    Planes with outliers on one side are simulated, and tested as mcmd plane does with a given
    sigma0. Rates come with their standard errors.
    """
    with _messages.clear_exits():
        from sklearn_mcmd.adjustment import plan_plane
        from sklearn_mcmd.adjustment._plane_figures import plan_rows

        seconds = _messages.stopwatch()
        made = plan_plane(
            points, sigma0=sigma0, extent=(width, height), alpha=alpha, outlier_rate=outlier_rate,
            power=power, robust_start=robust_start, n_repetitions=repetitions,
            random_state=random_state,
        )  # fmt: skip
        rows = plan_rows(made, unit)
        _messages.print_table(f"{points} points", **rows, seconds=f"{seconds():.1f}")
