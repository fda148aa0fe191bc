"""The page of a report: one file without scripts, which loads nothing from any network."""

import platform
from datetime import datetime
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, version

from sklearn_mcmd._extras import import_extra

LIBRARIES = ("numpy", "scipy", "scikit-learn", "numba", "laspy", "matplotlib")  # of the record


@cache
def _templates():
    """Templates that escape all text, so that no name in a file becomes markup."""
    jinja = import_extra("jinja2", "plot", "--report")
    return jinja.Environment(
        autoescape=True,
        loader=jinja.PackageLoader("sklearn_mcmd.report"),
        trim_blocks=True,
        undefined=jinja.StrictUndefined,
    )


def part(kind, /, *words, **options):
    """Markup of a part of a page, such as a table: a macro of `parts.html`."""
    return getattr(_templates().get_template("parts.html").module, kind)(*words, **options)


paragraph, table = partial(part, "paragraph"), partial(part, "table")


def join(*parts):
    """Markup of parts behind each other."""
    return import_extra("markupsafe", "plot", "--report").Markup("").join(parts)


def make_page(run, contents, has_view):
    """The HTML of a report; it may have view.html beside it."""
    parameters = [
        (name, f"{value} (default)" if is_default else value)
        for name, value, is_default in run.parameters
    ]
    return (
        _templates()
        .get_template("page.html")
        .render(
            run=run,
            name=source_name(run),
            contents=contents,
            has_view=has_view,
            parameters=parameters,
            record=_record(run),
        )
    )


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
