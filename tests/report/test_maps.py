"""Maps: what is drawn is where it is, and the bar is as long as it says."""

import base64
import io
import re

import numpy as np
import pytest

from sklearn_mcmd.report._maps import found_maps, fullest_cells

Image = pytest.importorskip("PIL.Image")
pytest.importorskip("matplotlib")


def pictures(markup):
    for data in re.findall(r"data:image/png;base64,([A-Za-z0-9+/=]+)", markup):
        yield np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGBA"))


def made(offset=0.0, n_far=0):
    """Maps of a box, whose upper right corner was found, and their markup."""
    xyz = np.random.default_rng(0).uniform(0, 1, (3000, 3)) * [10, 5, 1]
    found, near = (xyz[:, 0] > 8) & (xyz[:, 1] > 4), np.arange(len(xyz)) >= n_far
    xyz[~near] += 1e6
    markup = found_maps(xyz + offset, found, near, "outlier")
    return *pictures(markup), markup


def orange(pixels):
    red, green, blue, alpha = np.moveaxis(pixels.astype(int), -1, 0)
    return (red > 180) & (green < 140) & (blue < 60) & (alpha > 200)


def test_what_was_found_is_drawn_where_it_is_and_the_rest_is_clear():
    top, front, side, markup = made()
    rows, columns = np.nonzero(orange(top))
    assert columns.min() > 0.7 * top.shape[1]  # to the right
    assert rows.max() < 0.35 * top.shape[0]  # and far up
    assert (top[..., 3] == 0).any()
    assert orange(front).any()
    assert orange(side).any()
    bars = re.findall(r'class="scale" style="width:([\d.]+)%"><span>([\d.]+)<', markup)
    assert [length for _, length in bars] == ["2", "2", "1"]
    assert float(bars[0][0]) == pytest.approx(100 * 2 / 10.3, abs=0.2)  # 3 % of margins


def test_a_map_is_filled_far_from_the_origin_and_far_points_are_counted():
    top, *_, markup = made(np.array([1_423_215.0, 4_189_097.0, 67.0]), n_far=7)
    columns = np.flatnonzero((top[..., 3] > 0).any(axis=0))
    assert np.ptp(columns) > 0.95 * top.shape[1]
    assert "7 points lie far from the others, and not in the pictures" in markup


@pytest.mark.parametrize("xyz", [np.zeros((1, 3)), np.eye(3)[:2] * 1e9, np.ones((5, 3)) * 1e-9])
def test_clouds_without_extent_are_drawn(xyz):
    n = len(xyz)
    for found in (np.zeros(n, bool), np.ones(n, bool)):
        assert len(list(pictures(found_maps(xyz, found, np.ones(n, bool), "outlier")))) == 3


XYZ = np.random.default_rng(0).uniform(0, 20, (5000, 3)) + np.array([1000, 2000, -5])
ALL = np.ones(len(XYZ), bool)


def test_cells_count_the_points_in_them_and_the_fullest_come_first():
    found = (XYZ[:, 0] > 1016) & (XYZ[:, 1] > 2016)
    counts = []
    for row in fullest_cells(XYZ, found, ALL, "outliers").split("<tr>")[2:]:
        x, y, n, of_cell, of_all = re.findall(r"<td[^>]*>([^<]+)<", row)
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


def test_one_place_and_nothing_found_are_no_error():
    xyz, near = np.zeros((10, 3)), np.ones(10, bool)
    assert "100.0 %" in fullest_cells(xyz, near, near, "outliers")
    assert "There are no outliers" in fullest_cells(xyz, ~near, near, "outliers")
