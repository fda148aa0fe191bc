"""Pictures show every point where it belongs, in the color of the verdict that they are given."""

import sys

import numpy as np
import pytest

from sklearn_mcmd import BaardaPlaneDetector, plotting
from sklearn_mcmd.plotting import (
    EdgeDisplay,
    NormalsDisplay,
    OutlierDisplay,
    PlaneResidualDisplay,
    SegmentationDisplay,
    plot_cloud,
)
from sklearn_mcmd.plotting._views import thinned

matplotlib = pytest.importorskip("matplotlib")
matplotlib.use("agg")
from matplotlib.colors import to_rgb  # noqa: E402


@pytest.fixture(autouse=True)
def _close_figures(monkeypatch):
    yield
    monkeypatch.undo()  # of a test that hides Matplotlib
    import matplotlib.pyplot as plt

    plt.close("all")


@pytest.fixture
def xyz():
    return np.random.default_rng(0).uniform(-1, 1, (400, 3))


class Fitted:
    """What displays read of fitted estimators."""

    def __init__(self, xyz):
        self.scores_ = -np.linalg.norm(xyz, axis=1)
        self.offset_ = -1.2
        self.labels_ = (xyz[:, 0] > 0).astype(int) - (xyz[:, 1] > 0.9)
        self.normals_ = xyz / np.linalg.norm(xyz, axis=1)[:, None]

    def predict(self, X):
        return np.where(self.scores_ < self.offset_, -1, 1)


def count(display, color):
    drawn = display.ax_.collections[0].get_facecolors()[:, :3]
    return int(np.isclose(drawn, to_rgb(color), atol=1e-6).all(axis=1).sum())


def test_outliers_and_edges_are_drawn_in_their_color_and_counted(xyz):
    fitted = Fitted(xyz)
    n = np.count_nonzero(fitted.scores_ < fitted.offset_)
    for display in (
        OutlierDisplay.from_estimator(fitted, xyz),
        OutlierDisplay.from_predictions(xyz, fitted.predict(xyz)),
        EdgeDisplay.from_estimator(fitted, np.hstack([xyz, fitted.normals_])),
        EdgeDisplay.from_predictions(xyz, fitted.predict(xyz)),
    ):
        assert count(display, "#d55e00") == n
        assert display.ax_.get_title().startswith(f"{n} of 400 points are ")
        assert display.figure_ is display.ax_.figure


def test_with_the_truth_errors_have_colors_of_their_own(xyz):
    y_true, y_pred = np.ones(400), np.ones(400)
    y_true[:30], y_pred[20:35] = -1, -1
    y_true[40] = y_pred[41] = 0  # neither
    display = OutlierDisplay.from_predictions(X=xyz, y_true=y_true, y_pred=y_pred, view="top")
    assert [count(display, c) for c in ("#d55e00", "#0072b2", "#e69f00")] == [10, 20, 5]
    texts = [text.get_text() for text in display.ax_.get_legend().get_texts()]
    assert texts == ["found: 10", "missed: 20", "wrongly flagged: 5"]


def test_each_region_has_its_color_and_none_is_dark(xyz):
    labels = Fitted(xyz).labels_
    display = SegmentationDisplay.from_estimator(Fitted(xyz), xyz)
    for label in np.unique(labels):
        color = plotting.region_colors([label])[0]
        assert count(display, color) == np.count_nonzero(labels == label)
    assert display.ax_.get_title().startswith("2 regions, ")


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_residuals_of_a_plane_are_seen_along_its_normal(axis):
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 10, (300, 3))
    xyz[:, axis] = rng.normal(0, 0.01, 300)
    xyz[:12, axis] += 1.0
    detector = BaardaPlaneDetector(sigma0=0.01, surface="orthogonal").fit(xyz)
    display = PlaneResidualDisplay.from_estimator(detector, xyz)
    assert display.ax_.get_title() == "Residuals of 300 points, 12 outliers"
    shades = display.ax_.collections[0].get_facecolors()
    assert len(np.unique(shades, axis=0)) > 100  # outliers do not take the contrast
    across = display.ax_.collections[0].get_offsets()
    assert np.ptp(across, axis=0).min() > 9.8  # the whole face, not its edge
    up = 1 if axis == 2 else 2
    np.testing.assert_allclose(np.sort(across[:, 1]), np.sort(xyz[:, up]), atol=0.05)


def test_rare_classes_stay_visible_when_a_cloud_is_thinned():
    labels = np.r_[np.zeros(100_000, int), np.ones(80, int), np.full(3000, 2)]
    rows = thinned(labels, 5000)
    sizes = np.bincount(labels[rows])
    assert sizes.sum() == 5000
    assert sizes[1] == 80
    assert sizes[2] > 800
    assert (np.diff(rows) > 0).all()
    np.testing.assert_array_equal(thinned(labels, 10**6), np.arange(len(labels)))
    for most in (1, 2, 50):
        assert len(thinned(labels, most)) <= most


@pytest.mark.parametrize("view", ["top", "perspective", (10.0, 20.0)])
def test_every_view_draws_with_a_scale_bar_and_on_given_axes(view, xyz):
    import matplotlib.pyplot as plt

    _, ax = plt.subplots()
    display = EdgeDisplay.from_predictions(xyz, np.sign(xyz[:, 0]), view=view, ax=ax)
    assert display.ax_ is ax
    (bar,) = ax.artists
    (drawn,), words = bar.size_bar.get_children(), bar.txt_label.get_text()
    length = drawn.get_width()
    assert words == f"{length:g}" + " in the middle" * (view == "perspective")
    width = np.ptp(ax.get_xlim())
    assert 0.08 * width <= length <= 0.2 * width
    ax.figure.canvas.draw()


@pytest.mark.parametrize(
    ("view", "columns", "near"), [("top", [0, 1], 2), ("front", [0, 2], 4), ("side", [1, 2], 0)]
)
def test_named_views_look_along_the_axes_and_near_points_come_last(view, columns, near, xyz):
    points = plot_cloud(xyz, view=view).collections[0].get_offsets()
    far_to_near = xyz[np.argsort(np.hstack([xyz, -xyz])[:, near])]
    np.testing.assert_allclose(points, far_to_near[:, columns], atol=1e-12)


def test_each_of_many_regions_has_a_color_of_its_own_and_none_is_gray():
    colors = plotting.region_colors(np.arange(300))
    assert len(np.unique(np.rint(255 * colors), axis=0)) == 300
    assert (colors >= 0).all()
    assert (colors <= 1).all()
    np.testing.assert_array_equal(plotting.region_colors([-1]), [[0.3, 0.3, 0.3]])


def test_colors_of_normals_depend_on_the_axis_and_not_on_the_sign_and_none_is_gray(xyz):
    np.testing.assert_array_equal(plotting.normal_colors(xyz), plotting.normal_colors(-xyz))
    x, y, z = plotting.normal_colors(np.eye(3))
    assert min(np.abs(x - y).max(), np.abs(y - z).max(), np.abs(x - z).max()) > 0.1
    np.testing.assert_array_equal(plotting.normal_colors([[np.nan] * 3]), [[0.6, 0.6, 0.6]])


ONES, BROKEN, FLAGS = np.ones(400), np.full((400, 3), np.nan), np.ones(400, bool)


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (lambda x: OutlierDisplay.from_predictions(x, ONES, max_points=0), "max_points must be a"),
        (lambda x: OutlierDisplay.from_predictions(x, ONES, view=(1, np.nan)), "view must be"),
        (lambda x: OutlierDisplay.from_predictions(x, ONES, y_true=FLAGS), "y_true must be labels"),
        (lambda x: OutlierDisplay.from_predictions(x, FLAGS), r"take np.where\(y_pred, -1, 1\)"),
        (lambda x: SegmentationDisplay(x, [0, 1]), r"labels must have shape \(400,\)"),
        (lambda x: SegmentationDisplay(x, BROKEN[:, 0]), "whole numbers without NaN"),
        (lambda x: SegmentationDisplay(x, 0.5 * ONES), "labels must be whole numbers"),
        (lambda x: NormalsDisplay(x, np.eye(3)[:2]), "normals has 2 rows"),
        (lambda x: plot_cloud(BROKEN), "xyz must be finite"),
        (lambda x: plot_cloud(x, view="above"), "view='above' is unknown; known are top, front"),
        (lambda x: plot_cloud(x[:, :2]), r"xyz must have shape \(n, 3\)"),
        (lambda x: plot_cloud(x, outliers=ONES), "outliers must be a boolean mask"),
    ],
)
def test_what_cannot_be_drawn_is_refused_by_name(draw, message, xyz):
    with pytest.raises(ValueError, match=message):
        draw(xyz)


@pytest.mark.parametrize(
    "draw",
    [
        lambda x: OutlierDisplay.from_predictions(x, ONES),
        lambda x: plot_cloud(x, color=x[:, 2]),
    ],
)
def test_displays_without_matplotlib_name_what_to_install(draw, xyz, monkeypatch):
    for module in [m for m in sys.modules if m.partition(".")[0] == "matplotlib"]:
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match=r"Plotting needs matplotlib.*: pip install "):
        draw(xyz)
