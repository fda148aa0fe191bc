"""The page: complete, escaped, and without anything that asks a network."""

import re
from pathlib import Path

import pytest

from sklearn_mcmd.report._contents import Contents, Note, Run, percent, share
from sklearn_mcmd.report._rendering import join, make_page, paragraph, part, table

EVIL = "<img src=x onerror=alert(1)>&\"'"


def page(has_view=True, **changes):
    run = Run(
        verb="denoise",
        command=f"mcmd denoise '{EVIL}' out.laz",
        parameters=[("--cutoff", "3 (default)"), ("--mode", EVIL)],
        source=Path(f"/data/{EVIL}.laz"),
        target=Path("out.laz"),
        seconds=1.5,
    )
    parts = join(
        EVIL,
        paragraph(EVIL, EVIL),
        part("heading", EVIL),
        table((EVIL, "b"), [(EVIL, 1)], numbers=(1,), colors=[EVIL], kind=EVIL),
        part("chips", [(EVIL, EVIL)]),
        part("maps", [EVIL, part("map", "data:,", EVIL, 0.4, 0.2, 1)]),
        part("histogram", "", EVIL, EVIL),
    )
    contents = Contents(
        headline=f"5 of 10 points {EVIL}",
        cards=[("10", EVIL)],
        notes=[Note("Few points.", f"Only 10 {EVIL}", "Take more.")],
        checks=EVIL,
        sections=[("Part & parcel", parts), (EVIL, EVIL)],
        cloud_rows=[("attributes", EVIL)],
        output=EVIL,
    )
    return make_page(run, contents._replace(**changes), has_view)


def test_no_text_becomes_markup():
    text = page()
    assert set(re.findall("<img[^>]*", text)) == {'<img src="data:," alt="' + QUOTED + '"'}
    assert EVIL not in text
    assert f'class="{QUOTED}">{QUOTED}</p>' in text
    assert '<td class="n">1</td>' in text
    assert "Part &amp; parcel" in text


QUOTED = "&lt;img src=x onerror=alert(1)&gt;&amp;&#34;&#39;"


def test_nothing_is_asked_of_a_network():
    text = page()
    assert "default-src 'none'" in text
    assert "<script" not in text
    assert set(re.findall(r'(?:src|href)="([^"]+)"', text)) == {"data:,", "view.html"}
    assert "url(" not in text
    assert "@import" not in text


@pytest.mark.parametrize(
    ("text", "n"),
    [
        ("3 (default)", 1),
        ("One warning", 1),
        ("Take more.", 1),
        ("view.html", 1),
        ("Nothing to warn of", 0),
    ],
)
def test_defaults_warnings_and_the_other_page_are_shown_where_there_are_such(text, n):
    assert page().count(text) == n
    bare = page(has_view=False, notes=[])
    assert "Nothing to warn of. Looked for: " in bare
    assert "view.html" not in bare


@pytest.mark.parametrize(
    ("n", "n_all", "words"),
    [(4368, 60000, "7.3 %"), (0, 10, "0.0 %"), (1, 100_000, "0.001 %"), (0, 0, "0.0 %")],
)
def test_shares_in_percent(n, n_all, words):
    assert percent(n, n_all) == words
    assert share(n, n_all) == f"{n:,} of {n_all:,} points ({words})"
