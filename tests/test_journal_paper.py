"""The draft of a paper in `paper/`: as long as the journal asks, with each reference it cites."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
if not (ROOT / "paper").is_dir():
    pytest.skip("a checkout is needed", allow_module_level=True)
TEXT = (ROOT / "paper" / "paper.md").read_text("utf-8")


def test_it_has_a_thousand_words_and_each_reference_that_it_cites():
    assert 750 <= len(TEXT.split()) <= 1250
    references = set(
        re.findall(r"^@\w+\{(\w+),", (ROOT / "paper/paper.bib").read_text("utf-8"), re.M)
    )
    assert set(re.findall(r"@(\w+)", TEXT)) == references
