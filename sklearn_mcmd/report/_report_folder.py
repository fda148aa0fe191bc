"""The folder of a report: whether it can be written, and the pages in it."""

import os
import tempfile
import warnings
from pathlib import Path

from sklearn_mcmd._extras import import_extra
from sklearn_mcmd.io._files import replacing, system_error
from sklearn_mcmd.report._rendering import make_page, source_name

MOST_SHOWN = 1_000_000  # points of the page to look around in, which then has about 10 MB
PAGE, VIEW = "index.html", "view.html"


def check_folder(folder):
    """Raise before the work if a report cannot be drawn or written; nothing is made yet."""
    for library in ("matplotlib", "jinja2"):
        import_extra(library, "plot", "--report")
    folder = Path(folder)
    for path in (folder, folder / PAGE, folder / VIEW):
        if path.exists() and path.is_dir() != (path == folder):
            kind = "no folder" if path == folder else "a folder"
            raise ValueError(f"{path}: is {kind}; give --report another folder")
        if path.is_file() and not os.access(path, os.W_OK):
            raise ValueError(f"{path}: the file is write-protected")
    above = folder.absolute()
    while not above.exists():
        above = above.parent
    try:
        if not above.is_dir():
            raise ValueError(f"{folder}: {above} is no folder")
        with tempfile.TemporaryDirectory(prefix=".mcmd-", dir=above):
            pass
    except OSError as err:
        raise system_error(folder, "written", err) from err


def write_report(folder, run, contents):
    """Write the page, and the one to look around in beside it; pages that stand there go.

    The folder is made if it is missing. Returns the path of the page.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as err:
        raise system_error(folder, "written", err) from err
    if contents.shown is not None:
        _write_view(folder / VIEW, run, contents)
    page = make_page(run, contents, has_view=contents.shown is not None)
    with replacing(folder / PAGE) as temporary:
        temporary.write_text(page, encoding="utf-8", errors="replace")
    return folder / PAGE


def _write_view(path, run, contents):
    from sklearn_mcmd.view._page import cloud_page

    title = f"{run.verb}: {source_name(run)}"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the page itself says what it leaves out
        page = cloud_page(
            [contents.shown], names=[source_name(run)], title=title, max_points=MOST_SHOWN
        )
    page.save(path)
