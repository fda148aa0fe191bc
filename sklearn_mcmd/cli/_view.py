"""``mcmd view``."""

import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from sklearn_mcmd.cli import _files, _messages, _options
from sklearn_mcmd.cli._messages import progress
from sklearn_mcmd.cli._options import command_of, option
from sklearn_mcmd.io._rehearsal import standing_in
from sklearn_mcmd.runtime._interrupts import ignore_interrupts
from sklearn_mcmd.runtime._progress import progress_part

LARGE_PAGE = 50_000_000  # bytes; browsers on phones take no larger ones


@dataclass
class View:
    """Colors, classes, a threshold of scores, sections, distances, and all that is known of a
    point. Give two files, such as before and after, for a slider between them. The files of a
    folder, or of an index .vpc, are one cloud.
    """

    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help="Point files to show, of any format, or folders of them; two compare.",
        ),
    ]
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="PAGE.html", help="The page to write.")
    ]
    color: str | None = option(
        None,
        "Attribute to color by at first.",
        metavar="NAME",
        show_default="the first of results, colors, class, intensity and height",
    )
    only: str | None = option(
        None,
        "Attributes to put into the page, for a smaller one.",
        metavar="NAME,NAME...",
        show_default="all",
    )
    max_points: int = option(
        5_000_000, "Points in the page. Of more, so many are chosen at random.", min=1
    )
    title: str | None = option(None, "Title of the page.", show_default="names of the files")
    columns: _options.Columns = None
    quiet: _options.Quiet = False

    def run(self):
        begin = time.perf_counter()
        with progress("view", self.quiet):
            made = self._make()
            with progress_part(0.97, 1.0, "writing"):
                made.save(self.output)
                ignore_interrupts()
        if not self.quiet:
            self._report(made, begin)

    def _make(self):
        from sklearn_mcmd.view._page import check_suffix
        from sklearn_mcmd.view._page import view as make_page

        check_suffix(self.output)
        with standing_in(self.output) as stand_in:
            stand_in.touch()
        clouds, n = [], len(self.sources)
        for number, source in enumerate(self.sources):
            with progress_part(0.4 * number / n, 0.4 * (number + 1) / n):
                clouds.append(_files.read_all(source, self.columns))
        only = self.only and [name.strip() for name in self.only.split(",") if name.strip()]
        names = [source.name for source in self.sources]
        shown: dict[str, Any] = {"names": names, "only": only, "max_points": self.max_points}
        with progress_part(0.4, 0.97, "packing"):
            return make_page(*clouds, color=self.color, title=self.title, **shown)

    def _report(self, made, begin):
        size = self.output.stat().st_size
        exact = "as in the file" if made.error == 0 else f"within {made.error:.2g}"
        _messages.print_table(
            f"{', '.join(map(str, self.sources))} -> {self.output}",
            begin,
            points=f"{made.n_shown:,}",
            coordinates=f"{exact} (spacing {made.spacing:.3g})",
            size=f"{size / 1e6:.1f} MB",
        )
        if size > LARGE_PAGE:
            words = "--only or --max-points makes it smaller"
            warnings.warn(f"the page has {size / 1e6:.0f} MB; {words}", stacklevel=2)


view = command_of(View)
