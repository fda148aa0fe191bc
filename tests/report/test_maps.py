"""Maps and tables: what is drawn is where it is; the fullest cells, the largest regions."""

import numpy as np
import pytest

from sklearn_mcmd.io import PointCloud
from sklearn_mcmd.report._maps import fullest_cells, marked_maps
from sklearn_mcmd.report._pages import segment_contents
from sklearn_mcmd.report._shown import Shown

pytest.importorskip("matplotlib")
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure


def drawn(maps):
    """The axes of maps, and their pixels."""
    for shown in maps:
        figure = Figure(dpi=40)
        shown.plot(ax=figure.add_subplot())
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        yield figure.axes[0], np.asarray(canvas.buffer_rgba())


def made():
    """Maps of a box in national coordinates, whose upper right corner was marked, and seven points
    far from it."""
    xyz = np.random.default_rng(0).uniform(0, 1, (3000, 3)) * [10, 5, 1]
    marked, near = (xyz[:, 0] > 8) & (xyz[:, 1] > 4), np.arange(len(xyz)) >= 7
    xyz[~near] += 1e6
    xyz += [1_423_215.0, 4_189_097.0, 67.0]
    return marked_maps(xyz, marked, near, "outlier")


def orange(pixels):
    red, green, blue, _ = np.moveaxis(pixels.astype(int), -1, 0)
    return (red > 180) & (green < 140) & (blue < 60)


def test_what_was_found_is_drawn_where_it_is_and_over_the_others():
    (top, pixels), (_, front), (_, side) = drawn(made())
    for marks in map(orange, (front, side)):
        assert marks.any()
    rows, columns = np.nonzero(orange(pixels))
    all_rows, all_columns = np.nonzero((pixels[..., :3] < 230).any(axis=-1))
    assert columns.min() > np.quantile(all_columns, 0.7)  # to the right
    assert rows.max() < np.quantile(all_rows, 0.35)  # and far up
    assert top.artists[0].txt_label.get_text() == "2"  # the bar, of a box of ten


@pytest.mark.parametrize("xyz", [np.zeros((1, 3)), np.eye(3)[:2] * 1e9, np.ones((5, 3)) * 1e-9])
def test_clouds_without_extent_are_drawn(xyz):
    n = len(xyz)
    for marked in (np.zeros(n, bool), np.ones(n, bool)):
        assert len(list(drawn(marked_maps(xyz, marked, np.ones(n, bool), "outlier")))) == 3


XYZ = np.random.default_rng(0).uniform(0, 20, (5000, 3)) + np.array([1000, 2000, -5])
ALL = np.ones(len(XYZ), bool)


def test_cells_count_the_points_in_them_and_the_fullest_come_first():
    marked = (XYZ[:, 0] > 1016) & (XYZ[:, 1] > 2016)
    counts = []
    (table,) = fullest_cells(XYZ, marked, ALL, "outliers")
    for x, y, n, of_cell, of_all in table.rows:
        inside = np.ones(len(XYZ), bool)
        for words, values in ((x, XYZ[:, 0]), (y, XYZ[:, 1])):
            low, high = map(float, words.split(" to "))
            inside &= (values >= low) & (values < high)
        counts.append(int(n))
        assert counts[-1] == (inside & marked).sum() > 0
        assert of_cell == f"{100 * counts[-1] / inside.sum():.1f} %"
        assert of_all == f"{100 * counts[-1] / marked.sum():.1f} %"
    assert len(counts) == 8
    assert (np.diff(counts) <= 0).all()


def test_the_largest_regions_have_the_planes_of_their_points():
    rng = np.random.default_rng(0)
    floor, slope = rng.uniform(0, 10, (2, 500, 3)) + rng.normal(0, 0.01, (2, 500, 3))
    floor[:, 2] = rng.normal(5, 0.02, 500)
    slope[:, 2] = slope[:, 0] + rng.normal(0, 0.02 * np.sqrt(2), 500)
    region = np.repeat([0, 1, 2, -1], [500, 500, 3, 7])
    xyz = np.vstack([floor, slope, rng.uniform(size=(10, 3))])
    shown = Shown(PointCloud(xyz, {"region": region}), 4000, np.ones(1010, bool), [])
    contents = segment_contents(shown, [2000, 1900, 12], 3, 3912)
    (table,) = contents.tables
    rows = [dict(zip(table.header, row, strict=True)) for row in table.rows]
    assert [row["points"] for row in rows] == ["2,000", "1,900", "12"]
    assert rows[0]["share"] == "50.0 %"
    for row, tilt, normal in zip(
        rows, (0, 45), ([0, 0, 1], [-(0.5**0.5), 0, 0.5**0.5]), strict=False
    ):
        assert float(row["tilt"][:-1]) == pytest.approx(tilt, abs=0.2)
        assert float(row["rms"]) == pytest.approx(0.02, rel=0.1)
        np.testing.assert_allclose([float(v) for v in row["normal"].split()], normal, atol=0.002)
    assert rows[0]["middle"] == " ".join(f"{value:.9g}" for value in floor.mean(axis=0))
    assert rows[2]["normal"] == "nan nan nan"  # of a sample that has three points of it
    assert len(contents.maps) == 3
