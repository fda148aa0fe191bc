"""The page of a report, without scripts and links to any network, and the folder it is in."""

import base64
import io
import platform
import warnings
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version

from sklearn_mcmd._extras import import_extra
from sklearn_mcmd.io._files import check_writable, naming, replacing
from sklearn_mcmd.io._rehearsal import trial_folder

MOST_SHOWN = 1_000_000  # points of the page to look around in, which then has about 10 MB
PAGE, VIEW = "index.html", "view.html"
MADE_BY = b'name="generator" content="sklearn-mcmd"'  # in the head of both
SIZE, DPI = (7.0, 5.6), 160  # inches of a map, at most, and its pixels an inch
QUALITY = 85  # of its WebP, a fifth of the bytes of a PNG
LIBRARIES = ("numpy", "scipy", "scikit-learn", "numba", "laspy", "matplotlib")  # of the record


def make_page(run, contents):
    """The HTML of a report.

    The template escapes all text, so that no name in a file becomes markup.
    """
    jinja = import_extra("jinja2", "plot", "--report")
    templates = jinja.Environment(
        autoescape=True,
        loader=jinja.PackageLoader("sklearn_mcmd.report"),
        trim_blocks=True,
        undefined=jinja.StrictUndefined,
    )
    return templates.get_template("page.html").render(
        run=run,
        name=source_name(run),
        contents=contents,
        maps=[(drawn.title, _encoded(drawn.plot)) for drawn in contents.maps],
        shown=contents.shown,
        record=_record(run),
    )


def _encoded(plot):
    """The address of the picture of a map."""
    figure = import_extra("matplotlib.figure", "plot", "--report").Figure(
        SIZE, dpi=DPI, facecolor="white", layout="compressed"
    )
    ax = figure.add_subplot()
    plot(ax=ax)
    ax.set_title("")  # the page has it
    buffer, quality = io.BytesIO(), {"quality": QUALITY}
    figure.savefig(buffer, format="webp", bbox_inches="tight", pil_kwargs=quality)
    return f"data:image/webp;base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"


def source_name(run):
    """The name of the input; a folder such as "." has no name of its own."""
    return run.source.name or str(run.source)


def _record(run):
    from sklearn_mcmd import __version__

    rows = [
        ("date", datetime.now().astimezone().isoformat(sep=" ", timespec="seconds")),
        ("time of the work", f"{run.seconds:,.1f} s"),
        ("sklearn-mcmd", __version__),
        ("Python", f"{platform.python_version()}, {platform.system()} {platform.machine()}"),
    ]
    for name in LIBRARIES:
        try:
            rows.append((name, version(name)))
        except PackageNotFoundError:
            continue
    return rows


def check_folder(folder):
    """Raise before the work if a report cannot be drawn or written; nothing is made yet."""
    for library in ("matplotlib", "jinja2"):
        import_extra(library, "plot", "--report")
    above = folder.absolute()
    while not above.exists():
        above = above.parent
    if not above.is_dir():
        raise ValueError(f"{above}: is no folder; give --report another folder")
    for name in (PAGE, VIEW):
        page = check_writable(folder / name, above)
        if page.exists() and MADE_BY not in page.read_bytes()[:1000]:
            raise ValueError(f"{page}: no report has made it; give --report another folder")
    with naming(folder), trial_folder(above):
        pass


def write_report(folder, run, contents):
    """Write the page, and the one to look around in beside it; pages that stand there go.

    The folder is made if it is missing.
    """
    from sklearn_mcmd.view._page import view

    with naming(folder):
        folder.mkdir(parents=True, exist_ok=True)
    name = source_name(run)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the page itself says what it leaves out
        title, cloud = f"{run.verb}: {name}", contents.shown.cloud
        view(cloud, names=[name], title=title, max_points=MOST_SHOWN).save(folder / VIEW)
    page = make_page(run, contents)
    with replacing(folder / PAGE) as temporary:
        temporary.write_text(page, encoding="utf-8", errors="replace")
