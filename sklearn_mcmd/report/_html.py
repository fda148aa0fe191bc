"""Parts of a page from plain text; all text is escaped here."""

import html

__all__ = ["bar_table", "chips", "figure", "paragraph", "pre", "table"]

LONG = 28  # characters


def text(value):
    return html.escape(str(value))


def long(value):
    """Of words that may be broken into lines."""
    return 'class="long"' if len(str(value)) > LONG else ""


def paragraph(words, kind=""):
    return f'<p class="{kind}">{text(words)}</p>' if kind else f"<p>{text(words)}</p>"


def pre(words):
    return f'<pre tabindex="0">{text(words)}</pre>'


def table(header, rows, *, numbers=(), colors=None, kind=""):
    """A table; columns of `numbers` are right-aligned. `colors` gives each row a dot."""
    align = ['class="n"' if i in numbers else "" for i in range(len(header))]
    head = "".join(f"<th scope=col {a}>{text(h)}</th>" for h, a in zip(header, align, strict=True))
    body = []
    for number, row in enumerate(rows):
        cells = [
            f"<td {a or long(value)}>{text(value)}</td>"
            for value, a in zip(row, align, strict=True)
        ]
        if colors is not None:
            dot = f'<i class="dot" style="background:{text(colors[number])}"></i>'
            cells[0] = cells[0].replace(">", f">{dot}", 1)
        body.append(f"<tr>{''.join(cells)}</tr>")
    return (
        f'<div class="scroll" tabindex="0"><table class="{kind}">'
        f"<thead><tr>{head}</tr></thead><tbody>{''.join(body)}</tbody></table></div>"
    )


def bar_table(header, rows):
    """Rows of (name, number in words, share from 0 to 1): the shares as bars."""
    body = "".join(
        f'<tr><th scope=row>{text(name)}</th><td class="bar"><i style="width:{100 * part:.2f}%">'
        f'</i></td><td class="n">{text(words)}</td></tr>'
        for name, words, part in rows
    )
    first, last = map(text, header)
    head = f'<tr><th scope=col>{first}</th><th></th><th scope=col class="n">{last}</th></tr>'
    return f'<table class="bars"><thead>{head}</thead><tbody>{body}</tbody></table>'


def chips(entries):
    """A legend: colors and texts."""
    items = "".join(
        f'<li><i class="dot" style="background:{text(color)}"></i>{text(name)}</li>'
        for color, name in entries
    )
    return f'<ul class="chips">{items}</ul>'


def figure(inner, caption, kind=""):
    """A figure; `inner` is markup."""
    return f'<figure class="{kind}">{inner}<figcaption>{text(caption)}</figcaption></figure>'
