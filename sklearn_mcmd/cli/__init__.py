"""The ``mcmd`` command. Each of its main verbs runs one estimator.

Exit codes: 0 done; 1 failed, with one line on stderr; 2 wrong usage; 130 interrupted.
"""

from functools import cached_property
from importlib import import_module
from inspect import getdoc
from typing import Annotated

import typer
from typer.core import TyperCommand

from sklearn_mcmd import __version__

__all__ = ["app"]

# What a verb does, in the first line of its help. Its module goes on.
VERBS = {
    "denoise": "Remove or mark the points that lie on no surface and stand apart from all else.",
    "normals": "Add normals, surface variation and eigenvalues, robust to outliers and edges.",
    "edges": "Mark edges and corners: points next to a line where two faces meet.",
    "segment": "Divide a cloud into surfaces: road, kerb and footpath, walls, signs, poles.",
    "change": "Say what has moved between two scans of one place, and how surely.",
    "plane": "Test one plane, such as a wall or a floor: mark its outliers and write a report.",
    "view": "Make one HTML page that shows point clouds in any browser, offline.",
    "info": "Show what a file holds: points, bounds, spacing, duplicates, attributes.",
    "demo": "Clean a simulated street scan whose truth is known, and show how well that went.",
}
TYPED = f"{__name__}.typed"  # where a context keeps what was typed after the verb


class Verb(TyperCommand):
    """A verb, whose module is loaded when more than its first line is needed."""

    name: str

    @cached_property
    def loaded(self):
        """The command that does the work."""
        module = import_module(f"{__name__}._{self.name}")
        work = getattr(module, self.name)
        help = f"{self.help}\n\n{getdoc(work)}"
        alone = typer.Typer(add_completion=False)
        alone.command(self.name, help=help)(work)
        return typer.main.get_command(alone)

    def make_context(self, info_name, args, *more, **settings):
        typed = list(args)  # which parsing takes away
        context = self.loaded.make_context(info_name, args, *more, **settings)
        context.meta[TYPED] = typed
        return context


app = typer.Typer(
    name="mcmd",
    help="Find outliers, normals, surfaces and edges of point clouds. The extension of a file "
    "chooses its format; mcmd info --help lists them.",
    epilog="Exit codes: 0 done, 1 failed (one line on stderr says why), 2 wrong usage, "
    "130 interrupted. An output file appears only when it is complete. "
    "It replaces a file of its name, and may be the input file.",
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


for verb, line in VERBS.items():
    app.command(verb, cls=Verb, help=line)(lambda: None)
