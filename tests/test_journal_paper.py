"""The draft of a paper in `paper/`: as long as the journal asks, and with stored numbers alone."""

import csv
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
if not (ROOT / "paper").is_dir():
    pytest.skip("a checkout is needed", allow_module_level=True)
TEXT = (ROOT / "paper" / "paper.md").read_text("utf-8")


def stored(name, column="method"):
    """Rows of a stored table, by their first column."""
    with open(ROOT / "docs" / "benchmarks" / f"{name}.csv", newline="", encoding="utf-8") as file:
        return {row[column]: row for row in csv.DictReader(file)}


def test_it_has_a_thousand_words_and_each_reference_that_it_cites():
    assert 750 <= len(TEXT.split()) <= 1250
    references = set(
        re.findall(r"^@\w+\{(\w+),", (ROOT / "paper/paper.bib").read_text("utf-8"), re.M)
    )
    assert set(re.findall(r"@(\w+)", TEXT)) == references


@pytest.mark.parametrize(
    ("words", "method"),
    [
        (r"`RegionGrowing\(\)`", "sklearn_mcmd"),
        ("CGAL's RANSAC, told a distance", "CGAL RANSAC"),
        ("Open3D's RANSAC, told a distance", "Open3D RANSAC"),
        ("published: network and boosted trees", "printed: network, trees"),
        ("published: region growing", "printed: growing"),
    ],
)
def test_its_roofs_are_those_of_the_stored_run(words, method):
    shown = [float(cell) for cell in re.search(rf"\| {words} \|(.*)\|", TEXT)[1].split("|")]
    row = stored("public_roofs_ntnu")[method]
    names = ["ARI", "mean IoU", "precision", "recall"]
    assert shown[:4] == [float(row[name]) for name in names]
    assert shown[4] == pytest.approx(float(row["faces off by"]), abs=0.005)
