"""The page: complete, escaped, and without anything that asks a network."""

import re
from pathlib import Path

import numpy as np
import pytest

from sklearn_mcmd.io import PointCloud
from sklearn_mcmd.report._contents import Contents, Map, Note, Run, Table, percent, share
from sklearn_mcmd.report._rendering import make_page
from sklearn_mcmd.report._shown import Shown

pytest.importorskip("matplotlib")

EVIL = "<img src=x onerror=alert(1)>&\"'"


def page(words="", **changes):
    run = Run(
        verb="denoise",
        command=f"mcmd denoise '{EVIL}' out.laz",
        parameters=[("--cutoff", "3 (default)"), ("--mode", EVIL)],
        source=Path(f"/data/{EVIL}.laz"),
        target=Path("out.laz"),
        seconds=1.5,
    )
    cloud = PointCloud(np.zeros((2, 3)))
    shown = Shown(cloud, 2, np.ones(2, bool), [("attributes", EVIL)], words, [], EVIL, [(EVIL, 1)])
    contents = Contents(
        shown,
        headline=f"5 of 10 points {EVIL}",
        results=[("points & parts", 10), (EVIL, EVIL)],
        maps=[Map(EVIL, lambda ax: ax.plot([0, 1]))],
        tables=[Table(EVIL, [(EVIL, 1)], (EVIL, "b"), numbers=(1,), words=EVIL, colors=[EVIL])],
        notes=[Note("Few points.", f"Only 10 {EVIL}", "Take more.")],
        checks=EVIL,
        output=EVIL,
        rows=[(EVIL, 1)],
    )
    return make_page(run, contents._replace(**changes))


def test_no_text_becomes_markup():
    text = page(EVIL)
    (image,) = re.findall("<img[^>]*", text)
    assert re.fullmatch(
        rf'<img src="data:image/webp;base64,[\w+/=]+" alt="{re.escape(QUOTED)}"', image
    )
    assert EVIL not in text
    assert text.count(QUOTED) == 21  # each place once, of a map two
    assert '<td class="n">1</td>' in text
    assert "points &amp; parts" in text


QUOTED = "&lt;img src=x onerror=alert(1)&gt;&amp;&#34;&#39;"


def test_nothing_is_asked_of_a_network():
    text = page()
    assert "default-src 'none'" in text
    assert "<script" not in text
    links = set(re.findall(r'(?:src|href)="([^",]+)', text))
    assert links == {"data:", "view.html", "data:image/webp;base64"}
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
    assert "Nothing to warn of. Looked for: " in page(notes=[])


@pytest.mark.parametrize(
    ("n", "n_all", "words"),
    [(4368, 60000, "7.3 %"), (0, 10, "0.0 %"), (1, 100_000, "0.001 %"), (0, 0, "0.0 %")],
)
def test_shares_in_percent(n, n_all, words):
    assert percent(n, n_all) == words
    assert share(n, n_all) == f"{n:,} of {n_all:,} points ({words})"
