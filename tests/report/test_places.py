"""Cells and heights count what is in them."""

import re

import numpy as np

from sklearn_mcmd.report._places import place_sections

XYZ = np.random.default_rng(0).uniform(0, 20, (5000, 3)) + np.array([1000, 2000, -5])
ALL = np.ones(len(XYZ), bool)


def tables_of(found):
    """The cells of each row: of the table of places, and of that of heights."""
    parts = place_sections(XYZ, found, ALL, "outliers").split("By height")
    return [
        [re.findall(r"<t[dh][^>]*>([^<]+)<", row) for row in part.split("<tr>")[2:]]
        for part in parts
    ]


def test_cells_count_the_points_in_them_and_the_fullest_come_first():
    found = (XYZ[:, 0] > 1016) & (XYZ[:, 1] > 2016)
    counts = []
    for x, y, n, of_cell, of_all in tables_of(found)[0]:
        inside = np.ones(len(XYZ), bool)
        for words, values in ((x, XYZ[:, 0]), (y, XYZ[:, 1])):
            low, high = map(float, words.split(" to "))
            inside &= (values >= low) & (values < high)
        counts.append(int(n))
        assert counts[-1] == (inside & found).sum() > 0
        assert of_cell == f"{100 * counts[-1] / inside.sum():.1f} %"
        assert of_all == f"{100 * counts[-1] / found.sum():.1f} %"
    assert len(counts) == 8
    assert (np.diff(counts) <= 0).all()


def test_heights_count_every_point_once_from_the_top():
    found = XYZ[:, 2] > 3
    rows = tables_of(found)[1]
    assert 5 <= len(rows) <= 13
    assert rows[0][0] == "14 to 16"
    assert sum(int(row[1].split()[0].replace(",", "")) for row in rows) == found.sum()


def test_one_height_and_nothing_found_are_no_error():
    xyz, near = np.zeros((10, 3)), np.ones(10, bool)
    assert "10 (100.0 %)" in place_sections(xyz, near, near, "outliers")
    assert "There are no outliers" in place_sections(xyz, ~near, near, "outliers")
