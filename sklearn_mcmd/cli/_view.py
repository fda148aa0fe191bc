"""``mcmd view``."""

import warnings
from pathlib import Path
from typing import Annotated

import typer

from sklearn_mcmd.cli._config import Config
from sklearn_mcmd.cli._files import read_all, refuse_existing, standing_in
from sklearn_mcmd.cli._messages import clear_exits, print_table, stopwatch
from sklearn_mcmd.cli._options import Columns, NoClobber, Quiet
from sklearn_mcmd.cli._progress_bar import progress
from sklearn_mcmd.runtime._interrupts import ignore_interrupts
from sklearn_mcmd.runtime._progress import progress_part

__all__ = ["view"]

LARGE_PAGE = 50_000_000  # bytes; browsers on phones take no larger ones


def view(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help="Point files to show, of any format, or folders of them; two compare.",
        ),
    ],
    page: Annotated[
        Path, typer.Option("--output", "-o", metavar="PAGE.html", help="The page to write.")
    ],
    color: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Attribute to color by at first.",
            show_default="the first of results, colors, class, intensity and height",
        ),
    ] = None,
    only: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,NAME...",
            help="Attributes to put into the page, for a smaller one.",
            show_default="all",
        ),
    ] = None,
    max_points: Annotated[
        int, typer.Option(min=1, help="Points in the page. Of more, so many are chosen at random.")
    ] = 5_000_000,
    title: Annotated[
        str | None, typer.Option(help="Title of the page.", show_default="names of the files")
    ] = None,
    columns: Columns = None,
    no_clobber: NoClobber = False,
    config: Config = None,
    quiet: Quiet = False,
) -> None:
    """Make one HTML page that shows point clouds in any browser, offline.

    Colors, classes, a threshold of scores, sections, distances, and all that is known of a point.
    Give two files, such as before and after, for a slider between them. The files of a folder, or
    of an index .vpc, are one cloud.
    """
    with clear_exits():
        seconds = stopwatch()
        refuse_existing(no_clobber, page)
        with progress("view", quiet):
            made = _make(
                sources, page, columns, only, color=color, max_points=max_points, title=title
            )
            with progress_part(0.97, 1.0, "writing"):
                made.save(page)
                ignore_interrupts()
        if not quiet:
            _report(sources, page, made, seconds())


def _make(sources, page, columns, only, **options):
    from sklearn_mcmd.view._page import check_suffix, cloud_page

    check_suffix(page)
    with standing_in(page) as stand_in:
        stand_in.touch()
    clouds = []
    for number, source in enumerate(sources):
        with progress_part(0.4 * number / len(sources), 0.4 * (number + 1) / len(sources)):
            clouds.append(read_all(source, columns))
    wanted = None if only is None else [name.strip() for name in only.split(",") if name.strip()]
    names = [source.name for source in sources]
    with progress_part(0.4, 0.97, "packing"):
        return cloud_page(clouds, names=names, only=wanted, **options)


def _report(sources, page, made, seconds):
    size = page.stat().st_size
    exact = "as in the file" if made.error == 0 else f"within {made.error:.2g}"
    print_table(
        f"{', '.join(map(str, sources))} -> {page}",
        points=f"{made.n_shown:,}",
        coordinates=f"{exact} (spacing {made.spacing:.3g})",
        size=f"{size / 1e6:.1f} MB",
        seconds=f"{seconds:.1f}",
    )
    if size > LARGE_PAGE:
        words = "--only or --max-points makes it smaller"
        warnings.warn(f"the page has {size / 1e6:.0f} MB; {words}", stacklevel=2)
