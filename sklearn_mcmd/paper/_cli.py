"""``python -m sklearn_mcmd.paper``: one command for each table or figure."""

from inspect import signature
from pathlib import Path
from typing import Annotated

import typer

from sklearn_mcmd._extras import import_extra
from sklearn_mcmd.cli._speech import clear_exits, print_table, stopwatch
from sklearn_mcmd.cli._waiting import progress
from sklearn_mcmd.io._files import replacing
from sklearn_mcmd.paper import EXPERIMENTS

__all__ = ["app"]

app = typer.Typer(
    help="Reproduce the first paper's tables and figures: its printed numbers beside the numbers "
    "of this package, with Monte-Carlo errors.",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Runs = Annotated[
    int | None,
    typer.Option("--runs", "-n", min=2, help="Simulated clouds. [default: the paper's number]"),
]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of clouds and trials.")]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out", "-o", metavar="DIR", help="Folder to write the plot NAME.png and NAME.txt to."
    ),
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress bar.")]


@app.command("list")
def show_list():
    """List the tables and figures."""
    print_table(
        "Tables and figures", **{name: _summary(function) for name, function in EXPERIMENTS.items()}
    )


@app.command("all")
def run_all(runs: Runs = None, seed: Seed = 0, out: Out = None, quiet: Quiet = False):
    """Reproduce all tables and figures, one after the other."""
    for name in EXPERIMENTS:
        _reproduce(name, runs, seed, out, quiet)
        typer.echo()


def _command(name):
    def command(runs: Runs = None, seed: Seed = 0, out: Out = None, quiet: Quiet = False):
        _reproduce(name, runs, seed, out, quiet)

    return command


for _name, _experiment in EXPERIMENTS.items():
    app.command(
        _name, help=(_experiment.__doc__ or _name).splitlines()[0]
    )(_command(_name))  # fmt: skip


def _reproduce(name, runs, seed, out, quiet):
    with clear_exits():
        experiment = EXPERIMENTS[name]
        if runs is None:
            runs = signature(experiment).parameters["runs"].default
        if out is not None:
            _use_agg()
            out.mkdir(parents=True, exist_ok=True)
        seconds = stopwatch()
        with progress(name, quiet):
            report = experiment(runs, seed=seed)
        typer.echo(str(report))
        typer.echo(f"\n{seconds():.1f} seconds, seed {seed}")
        if out is not None:
            typer.echo(f"Plot: {_save(report, out)}")


def _save(report, folder):
    """Write the report's text and plot, each completely or not at all; the plot's path."""
    figure = report.plot()
    with replacing(folder / f"{report.name}.txt") as temporary:
        temporary.write_text(f"{report}\n", encoding="utf-8")
    path = folder / f"{report.name}.png"
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)
    import matplotlib.pyplot as plt

    plt.close(figure)
    return path


def _use_agg():
    """Draw without windows. If Matplotlib is missing, fail before hours of work."""
    import_extra("matplotlib", "plot", "--out").use("agg")


def _summary(function):
    """The first line of a docstring, without the name at its start."""
    return (function.__doc__ or "").splitlines()[0].partition(": ")[2].rstrip(".")
