"""The page: complete, escaped, and without anything that asks a network."""

import re
from pathlib import Path

import pytest

from sklearn_mcmd.report._contents import (
    Contents,
    Note,
    Parameter,
    Run,
    Section,
    percent,
    share,
)
from sklearn_mcmd.report._page import make_page

EVIL = "<img src=x onerror=alert(1)>&\"'"


def page(has_view=True, **changes):
    run = Run(
        "denoise",
        f"mcmd denoise '{EVIL}' out.laz",
        (Parameter("--cutoff", "3", True), Parameter("--mode", EVIL, False)),
        Path(f"/data/{EVIL}.laz"),
        Path("out.laz"),
        1.5,
    )
    contents = Contents(
        headline=f"5 of 10 points {EVIL}",
        cards=[("10", EVIL)],
        notes=[Note("Few points.", f"Only 10 {EVIL}", "Take more.")],
        checks=EVIL,
        sections=[Section("Part & parcel", "<p>markup stays</p>")],
        cloud_rows=[("attributes", EVIL)],
        output=EVIL,
    )
    return make_page(run, contents._replace(**changes), has_view)


def test_no_text_becomes_markup():
    text = page()
    assert "<img" not in text
    assert "<p>markup stays</p>" in text
    assert "Part &amp; parcel" in text


def test_nothing_is_asked_of_a_network():
    text = page()
    assert "default-src 'none'" in text
    assert "<script" not in text
    assert set(re.findall(r'(?:src|href)="([^"]+)"', text)) == {"data:,", "view.html"}
    assert "url(" not in text
    assert "@import" not in text


def test_defaults_are_marked_and_what_was_given_is_not():
    text = page()
    assert "3 (default)" in text
    assert text.count("(default)") == 1


def test_warnings_stand_in_words_or_what_was_looked_for():
    assert "One warning" in page()
    assert "Take more." in page()
    assert "Nothing to warn of. Looked for: " in page(notes=[])


def test_without_the_other_page_there_is_no_link_to_it():
    assert "view.html" not in page(has_view=False)


@pytest.mark.parametrize(
    ("n", "n_all", "words"),
    [(4368, 60000, "7.3 %"), (0, 10, "0.0 %"), (1, 100_000, "0.001 %"), (0, 0, "0.0 %")],
)
def test_shares_in_percent(n, n_all, words):
    assert percent(n, n_all) == words


def test_shares_in_plain_words():
    assert share(4368, 60000) == "4,368 of 60,000 points (7.3 %)"
