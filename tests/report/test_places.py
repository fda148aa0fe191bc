"""Cells and heights count what is in them."""

import numpy as np

from sklearn_mcmd.report._places import Places, height_rows, place_sections

XYZ = np.random.default_rng(0).uniform(0, 20, (5000, 3)) + np.array([1000, 2000, -5])
ALL = np.ones(len(XYZ), bool)


def test_cells_hold_every_point_once():
    found = XYZ[:, 2] > 0
    places = Places.of(XYZ, found, ALL)
    assert places.n_all.sum() == len(XYZ)
    assert places.n_found.sum() == found.sum()
    for i in (0, 7):
        inside = ((XYZ[:, :2] >= places.low[i]) & (XYZ[:, :2] < places.low[i] + places.side)).all(1)
        assert places.n_all[i] == inside.sum()
        assert places.n_found[i] == (inside & found).sum()


def test_the_fullest_cells_come_first_and_empty_ones_not_at_all():
    places = Places.of(XYZ, (XYZ[:, 0] > 1018) & (XYZ[:, 1] > 2018), ALL)
    fullest = places.fullest()
    assert (np.diff(places.n_found[fullest]) <= 0).all()
    assert (places.n_found[fullest] > 0).all()
    assert places.where(fullest[0]) == ["1018 to 1019", "2019 to 2020"]


def test_heights_count_every_point_once_from_the_top():
    found = XYZ[:, 2] > 3
    rows = height_rows(XYZ[:, 2], found)
    assert 5 <= len(rows) <= 13
    assert rows[0][0] == "14 to 16"
    assert sum(int(words.split()[0].replace(",", "")) for _, words, _ in rows) == found.sum()
    assert max(part for *_, part in rows) == 1


def test_one_height_and_nothing_found_are_no_error():
    xyz, near = np.zeros((10, 3)), np.ones(10, bool)
    assert "10 (100.0 %)" in place_sections(xyz, near, near, "outliers")
    assert "There are no outliers" in place_sections(xyz, ~near, near, "outliers")
