"""Markup from plain text: nothing in it can become markup."""

import pytest

from sklearn_mcmd.report._html import bar_table, chips, figure, paragraph, pre, table

EVIL = "<script>alert('&')</script>\""


@pytest.mark.parametrize(
    "markup",
    [
        paragraph(EVIL),
        pre(EVIL),
        table((EVIL, "b"), [(EVIL, EVIL)], numbers=(1,), colors=[EVIL]),
        bar_table((EVIL, EVIL), [(EVIL, EVIL, 0.5)]),
        chips([(EVIL, EVIL)]),
        figure("", EVIL),
    ],
)
def test_text_is_escaped(markup):
    assert "<script" not in markup
    assert "&lt;script&gt;" in markup


def test_numbers_are_aligned_and_rows_have_their_colors():
    markup = table(("a", "b"), [("x", 1)], numbers=(1,), colors=["#ff0000"])
    assert '<td class="n">1</td>' in markup
    assert "background:#ff0000" in markup
