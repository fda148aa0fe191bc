"""The page of a report: one file without scripts, which asks nothing of any network."""

import html
import platform
from datetime import datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files

from sklearn_mcmd.report._html import paragraph, table

__all__ = ["make_page", "source_name"]

LIBRARIES = ("numpy", "scipy", "scikit-learn", "numba", "laspy", "matplotlib")
POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; "
    "form-action 'none'"
)


def make_page(run, contents, has_view):
    """The HTML of a report; it may have view.html beside it."""
    title = f"{run.verb}: {source_name(run)}"
    parts = [_head(run, contents, has_view), _notes(contents)]
    parts += [_section(section.title, section.html) for section in contents.sections]
    parts += [
        _section("Input and output", _files(run, contents)),
        _section("Parameters", _parameters(run)),
        _section("Record", _record(run)),
    ]
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        '<meta name="color-scheme" content="light dark">\n'
        f'<title>{html.escape(title)}</title>\n<link rel="icon" href="data:,">\n'
        f"<style>\n{_style()}</style>\n</head>\n<body>\n<main>\n"
        + "\n".join(parts)
        + "\n</main>\n</body>\n</html>\n"
    )


def source_name(run):
    """The name of the input; a folder such as "." has no name of its own."""
    return run.source.name or str(run.source)


@cache
def _style():
    return (files("sklearn_mcmd.report") / "static" / "report.css").read_text(encoding="utf-8")


def _head(run, contents, has_view):
    cards = "".join(
        f"<div><dt>{html.escape(name)}</dt><dd>{html.escape(number)}</dd></div>"
        for number, name in contents.cards
    )
    link = '<a class="button" href="view.html">Look around in the cloud</a>' if has_view else ""
    return (
        f'<header><p class="verb">mcmd {html.escape(run.verb)}</p>'
        f"<h1>{html.escape(source_name(run))}</h1>"
        f'<p class="headline">{html.escape(contents.headline)}</p>'
        f'<dl class="cards">{cards}</dl>{link}</header>'
    )


def _notes(contents):
    if not contents.notes:
        words = f"Nothing to warn of. Looked for: {contents.checks}."
        return f"<section><h2>Warnings</h2>{paragraph(words, 'fine')}</section>"
    notes = "".join(
        f"<li><strong>{html.escape(note.title)}</strong> <span>{html.escape(note.text)}</span>"
        + (f"<em>{html.escape(note.remedy)}</em></li>" if note.remedy else "</li>")
        for note in contents.notes
    )
    n = len(contents.notes)
    title = "One warning" if n == 1 else f"{n} warnings"
    return f'<section><h2>{title}</h2><ul class="notes">{notes}</ul></section>'


def _section(title, inner):
    return f"<section><h2>{html.escape(title)}</h2>{inner}</section>"


def _files(run, contents):
    rows = [("input", str(run.source)), *contents.cloud_rows]
    rows += [("output", str(run.target)), ("holds", contents.output)]
    return _pairs(rows)


def _parameters(run):
    rows = [
        (name, f"{value} (default)" if is_default else value)
        for name, value, is_default in run.parameters
    ]
    command = f'<pre class="command" tabindex="0">{html.escape(run.command)}</pre>'
    return command + _pairs(rows)


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
    return _pairs(rows)


def _pairs(rows):
    return table(("name", "value"), rows, kind="pairs")
