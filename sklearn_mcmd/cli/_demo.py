"""``mcmd info`` and ``mcmd demo``."""

import os
from pathlib import Path
from typing import Annotated

import typer

from sklearn_mcmd._extras import import_extra
from sklearn_mcmd.cli._denoise import denoise
from sklearn_mcmd.cli._files import files_of, read, refuse_existing
from sklearn_mcmd.cli._messages import clear_exits, print_table, stopwatch
from sklearn_mcmd.cli._normals import normals
from sklearn_mcmd.cli._options import Columns, NJobs, NoClobber, Quiet
from sklearn_mcmd.cli._progress_bar import progress
from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._rehearsal import naming
from sklearn_mcmd.runtime._interrupts import ignore_interrupts


def info(
    source: Annotated[
        Path, typer.Argument(metavar="IN", help="Point file, or a folder or .vpc index of files.")
    ],
    columns: Columns = None,
) -> None:
    """Show what a file holds: points, bounds, spacing, duplicates, attributes.

    Of a folder or an index, each file has one line, and a line tells of all together.
    """
    with clear_exits():
        from sklearn_mcmd.cli._file_summary import summarize, summarize_each

        paths = files_of(source)
        if paths == [source]:
            print_table(str(source), **summarize(source, read(source, columns=columns)))
            return
        rows, errors = summarize_each(paths, lambda path: read(path, columns=columns))
        print_table(str(source), **rows)
        if errors:
            raise PointFileError("; ".join(errors))


def demo(
    folder: Annotated[
        Path, typer.Argument(metavar="[DIR]", help="Folder of the files; it is made if missing.")
    ] = Path("mcmd-demo"),
    force: Annotated[
        bool,
        typer.Option(
            "--force", help="Replace files with these names even if no earlier demo wrote them."
        ),
    ] = False,
    n_jobs: NJobs = -1,
    no_clobber: NoClobber = False,
    quiet: Quiet = False,
) -> None:
    """Clean a simulated street scan whose truth is known, and show how well that went.

    Twice: by coordinates alone, and with --sensor, the position of the scanner. Writes street.laz
    (with outliers, and the truth as attributes), clean.laz, clean_sensor.laz, normals.laz and
    demo.png, and prints the accuracy. Files of an earlier demo in the same folder are replaced.
    """
    with clear_exits():
        from sklearn_mcmd.cli import _demo_run

        seconds = stopwatch()
        import_extra("matplotlib", "plot", "the picture")
        names = "street.laz", "clean.laz", "clean_sensor.laz", "normals.laz", "demo.png"
        outputs = street, clean, clean_sensor, with_normals, picture = [folder / n for n in names]
        refuse_existing(no_clobber, *outputs)
        there = [path.name for path in outputs if os.path.exists(path)]
        if there and not force and not _demo_run.made_by_demo(street):
            raise FileExistsError(
                f"{folder} already holds {', '.join(there)}, of no earlier demo; name another "
                "folder, or --force"
            )
        sensor = _demo_run.write_street(street)
        work = {"n_jobs": n_jobs, "quiet": quiet}
        denoise(street, clean, sensor="none", **work)
        denoise(street, clean_sensor, sensor=sensor, **work)
        normals(clean_sensor, with_normals, orientation="sensor", sensor=sensor, **work)
        with progress("accuracy", quiet):
            angles = _demo_run.normal_errors(street, n_jobs)
        cleaned = {"by coordinates alone": clean}
        cleaned[f"with --sensor {','.join(f'{x:g}' for x in sensor)}"] = clean_sensor
        with naming(picture):
            _demo_run.draw(street, cleaned, with_normals, picture)
        ignore_interrupts()
        if not quiet:
            for how, path in cleaned.items():
                rates = _demo_run.outlier_rates(street, path)
                print_table(
                    f"Outliers {how}, against the truth",
                    **{name: f"{100 * rate:.1f} %" for name, rate in rates.items()},
                )
            print_table(
                f"Normals of {street}, outliers and all: angle to the truth",
                **{
                    method: f"median {median:.2f}, 95 % below {high:.1f} degrees"
                    for method, (median, high) in angles.items()
                },
            )
            typer.echo(f"Picture: {picture}; {seconds():.1f} seconds in all.")
