"""Cells and heights count what is in them."""

import numpy as np

from sklearn_mcmd.report._places import Places, height_rows, place_sections


def cloud():
    rng = np.random.default_rng(0)
    return rng.uniform(0, 20, (5000, 3)) + np.array([1000, 2000, -5])


def test_cells_hold_every_point_once():
    xyz = cloud()
    found = xyz[:, 2] > 0
    places = Places.of(xyz, found, np.ones(len(xyz), bool))
    assert places.n_all.sum() == len(xyz)
    assert places.n_found.sum() == found.sum()
    for i in (0, 7):
        inside = ((xyz[:, :2] >= places.low[i]) & (xyz[:, :2] < places.low[i] + places.side)).all(1)
        assert places.n_all[i] == inside.sum()
        assert places.n_found[i] == (inside & found).sum()


def test_the_fullest_cells_come_first_and_empty_ones_not_at_all():
    xyz = cloud()
    found = (xyz[:, 0] > 1018) & (xyz[:, 1] > 2018)
    places = Places.of(xyz, found, np.ones(len(xyz), bool))
    fullest = places.fullest()
    assert (np.diff(places.n_found[fullest]) <= 0).all()
    assert (places.n_found[fullest] > 0).all()
    assert places.where(fullest[0]) == ["1018 to 1019", "2019 to 2020"]


def test_heights_count_every_point_once_from_the_top():
    z = cloud()[:, 2]
    found = z > 3
    rows = height_rows(z, found)
    assert 5 <= len(rows) <= 13
    assert rows[0][0] == "14 to 16"
    counts = [int(words.split()[0].replace(",", "")) for _, words, _ in rows]
    assert sum(counts) == found.sum()
    assert max(part for *_, part in rows) == 1


def test_one_height_and_nothing_found_are_no_error():
    xyz = np.zeros((10, 3))
    near = np.ones(10, bool)
    assert "10 (100.0 %)" in place_sections(xyz, near, near, "outliers")
    assert "There are no outliers" in place_sections(xyz, ~near, near, "outliers")
