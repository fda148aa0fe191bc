"""``mcmd plan``."""

from dataclasses import dataclass

from sklearn_mcmd.cli import _messages, _options
from sklearn_mcmd.cli._config import Config
from sklearn_mcmd.cli._options import command_of, length, option


@dataclass
class Plan:
    """Say before a measurement which errors of a plane its tests will find.

    Planes with outliers on one side are simulated, and tested as mcmd plane does with a given
    sigma0. Rates come with their standard errors.
    """

    points: int = option(100, "Points on the plane.", min=5)
    sigma0: float = length(1.0, "Standard deviation of a point.")
    width: float = length(1.0, "Of the plane, in the unit of sigma0, for the normal.")
    height: float = length(1.0, "The other side of the plane.")
    alpha: float = option(0.05, "Level of the test of all points.")
    outlier_rate: float = option(0.0, "Share of outliers; there is at least one.")
    power: float = option(0.8, "Share of the outliers that shall be found.")
    robust_start: bool = option(
        True, "Start from the plane of the most coplanar half of the points."
    )
    repetitions: int = option(10_000, "Simulated planes of each size of bias.", min=100)
    unit: _options.Unit = ""
    random_state: _options.RandomState = 0
    config: Config = None

    def run(self):
        from sklearn_mcmd.adjustment import plan_plane
        from sklearn_mcmd.adjustment._plane_figures import plan_rows

        seconds = _messages.stopwatch()
        same = "sigma0", "alpha", "outlier_rate", "power", "robust_start", "random_state"
        made = plan_plane(
            self.points,
            extent=(self.width, self.height),
            n_repetitions=self.repetitions,
            **{name: getattr(self, name) for name in same},
        )
        rows = plan_rows(made, self.unit)
        _messages.print_table(f"{self.points} points", **rows, seconds=f"{seconds():.1f}")


plan = command_of(Plan)
