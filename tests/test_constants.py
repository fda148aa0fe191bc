"""Each number of the package says what it means, and each threshold what it buys.

docs/constants_table.py finds them in the source; docs/constants.csv has a row for each threshold.
"""

import importlib.util
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[1] / "docs"
spec = importlib.util.spec_from_file_location("constants_table", DOCS / "constants_table.py")
table = importlib.util.module_from_spec(spec)
spec.loader.exec_module(table)


def test_each_threshold_has_a_row_that_says_what_it_buys():
    missing = {one.name for one in table.thresholds()} - set(table.prices())
    assert not missing, f"docs/constants.csv has no row of {sorted(missing)}"


def test_each_row_is_of_a_threshold_and_says_something():
    rows, known = table.prices(), {one.name for one in table.thresholds()}
    assert set(rows) <= known, f"docs/constants.csv: {sorted(set(rows) - known)} are no thresholds"
    said = ("less", "more", "off", "note")
    assert [name for name, row in rows.items() if not any(row[one] for one in said)] == []


@pytest.mark.parametrize("which", ["thresholds", "others"])
def test_a_comment_says_what_each_number_means(which):
    silent = [f"{one.path.name}:{one.line}" for one in getattr(table, which)() if not one.meaning]
    assert not silent, f"no comment beside or above the numbers of {silent}"


def test_no_threshold_is_copied_at_import():
    assert table.copies() == []


def test_numbers_are_found_in_source(tmp_path):
    room = tmp_path / "sklearn_mcmd" / "room"
    room.mkdir(parents=True)
    room.joinpath("_rule.py").write_text(
        "# How far.\n# In meters.\nFAR = -1 / 3\nWORDS = 'a', 1\nOTHER = f(2)\n"
        "class RuleLimits(NamedTuple):\n    near: float = 2.0  # half of far\n    free: int\n"
        "COPY = RuleLimits().near\ndef f(near=RuleLimits().near): ...\n"
    )
    (far,), (near,) = table.others(tmp_path), table.thresholds(tmp_path)
    assert far[:3] == ("room.rule.FAR", "-1 / 3", "How far. In meters.")
    assert near[:3] == ("RuleLimits.near", "2.0", "half of far")
    assert table.copies(tmp_path) == [f"sklearn_mcmd/room/_rule.py:{line}" for line in (9, 10)]
