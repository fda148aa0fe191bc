"""Displays draw the verdict that they are given, and keep rare classes visible."""

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
from sklearn_mcmd.plotting._cloud_display import CloudDisplay
from sklearn_mcmd.plotting._views import VIEWS, camera, look, thinned
from sklearn_mcmd.view import CloudPage

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

    def score_samples(self, X):
        return self.scores_


def drawn_colors(display):
    return display.ax_.collections[0].get_facecolors()[:, :3]


def count(display, color):
    return int(np.isclose(drawn_colors(display), to_rgb(color), atol=1e-6).all(axis=1).sum())


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
    display = OutlierDisplay.from_predictions(xyz, y_pred, y_true=y_true)
    assert [count(display, c) for c in ("#d55e00", "#0072b2", "#e69f00")] == [10, 20, 5]
    texts = [text.get_text() for text in display.ax_.get_legend().get_texts()]
    assert texts == ["found: 10", "missed: 20", "wrongly flagged: 5"]


def test_scores_color_up_to_a_clear_error(xyz):
    fitted = Fitted(xyz)
    display = OutlierDisplay.from_estimator(fitted, xyz, show="scores")
    assert len(np.unique(drawn_colors(display), axis=0)) > 20
    with pytest.raises(ValueError, match="needs scores"):
        OutlierDisplay.from_predictions(xyz, fitted.predict(xyz), show="scores")


def test_each_region_has_its_color_and_none_is_dark(xyz):
    labels = Fitted(xyz).labels_
    display = SegmentationDisplay.from_estimator(Fitted(xyz), xyz)
    for label in np.unique(labels):
        color = plotting.region_colors([label])[0]
        assert count(display, color) == np.count_nonzero(labels == label)
    assert display.ax_.get_title().startswith("2 regions, ")


def test_normals_have_a_ball_that_tells_their_colors(xyz):
    display = NormalsDisplay.from_estimator(Fitted(xyz), xyz, view="front")
    assert len(display.ax_.child_axes) == 1
    expected = plotting.normal_colors(Fitted(xyz).normals_, view="front")
    np.testing.assert_allclose(np.sort(drawn_colors(display), axis=0), np.sort(expected, axis=0))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_residuals_of_a_plane_are_seen_along_its_normal(axis):
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 10, (300, 3))
    xyz[:, axis] = rng.normal(0, 0.01, 300)
    xyz[:12, axis] += 1.0
    detector = BaardaPlaneDetector(sigma0=0.01, surface="orthogonal").fit(xyz)
    display = PlaneResidualDisplay.from_estimator(detector, xyz)
    assert display.ax_.get_title() == "Residuals of 300 points, 12 outliers"
    across = display.ax_.collections[0].get_offsets()
    assert np.ptp(across, axis=0).min() > 9.8  # the whole face, not its edge
    up = 1 if axis == 2 else 2
    np.testing.assert_allclose(np.sort(across[:, 1]), np.sort(xyz[:, up]), atol=0.05)


def test_rare_classes_stay_visible_when_a_cloud_is_thinned():
    labels = np.r_[np.zeros(100_000, int), np.ones(80, int), np.full(3000, 2)]
    rows = thinned(labels, 5000)
    sizes = np.bincount(labels[rows])
    assert sizes.sum() <= 5000
    assert sizes.sum() >= 4990
    assert sizes[1] == 80
    assert sizes[2] > 1000
    assert (np.diff(rows) > 0).all()
    np.testing.assert_array_equal(thinned(labels, 10**6), np.arange(len(labels)))
    for most in (1, 2, 50):
        assert len(thinned(labels, most)) <= most


def test_a_display_draws_no_more_points_than_asked_for(xyz):
    display = SegmentationDisplay.from_predictions(xyz, np.arange(400) % 3, max_points=60)
    assert 50 <= len(drawn_colors(display)) <= 60
    assert display.ax_.get_title() == "3 regions, 100.00 % of 400 points"


@pytest.mark.parametrize("view", [*VIEWS, (10.0, 20.0)])
def test_every_view_draws_with_a_scale_bar_and_on_given_axes(view, xyz):
    import matplotlib.pyplot as plt

    _, ax = plt.subplots()
    display = EdgeDisplay(xyz, xyz[:, 0] > 0).plot(view=view, ax=ax)
    assert display.ax_ is ax
    (bar,) = ax.lines
    length = np.ptp(bar.get_xdata())
    assert ax.texts[0].get_text().split()[0] == f"{length:g}"
    assert ("in the middle" in ax.texts[0].get_text()) == (view == "perspective")
    width = np.ptp(ax.get_xlim())
    assert 0.08 * width <= length <= 0.2 * width
    ax.figure.canvas.draw()


def test_perspective_enlarges_what_is_near():
    right, _, toward = camera("perspective")
    pair = np.array([-right, right])
    cloud = np.vstack([pair + 3 * toward, pair, pair - 3 * toward])
    near, middle, far = look(cloud, "perspective").places.reshape(3, 2, 2)
    lengths = [np.linalg.norm(ends[1] - ends[0]) for ends in (near, middle, far)]
    assert lengths[0] > 2.2
    assert lengths[1] == pytest.approx(2.0)
    assert lengths[2] < 1.8


def test_named_views_look_along_the_axes():
    point = np.array([[1.0, 2.0, 3.0]])
    for view, place in (("top", [1, 2]), ("front", [1, 3]), ("side", [2, 3])):
        np.testing.assert_allclose(look(point, view).places, [place], atol=1e-12)


def test_wrong_views_and_lengths_are_refused(xyz):
    with pytest.raises(ValueError, match="view='above' is unknown; known are top, front"):
        plot_cloud(xyz, view="above")
    with pytest.raises(ValueError, match=r"labels must have shape \(400,\)"):
        SegmentationDisplay(xyz, [0, 1])
    with pytest.raises(ValueError, match="normals has 2 rows"):
        NormalsDisplay(xyz, np.eye(3)[:2])


def test_each_display_has_a_view_of_its_own(xyz):
    usual, named = (EdgeDisplay(xyz, xyz[:, 0] > 0).plot(view=v) for v in (None, "perspective"))
    drawn = [display.ax_.collections[0].get_offsets() for display in (usual, named)]
    np.testing.assert_array_equal(*drawn)
    with pytest.raises(ValueError, match="view must be"):
        plot_cloud(xyz, view=None)


def test_what_displays_share_is_no_display(xyz):
    with pytest.raises(TypeError, match="abstract"):
        CloudDisplay()


def test_a_few_points_can_be_drawn():
    for n in (1, 2):
        EdgeDisplay(np.zeros((n, 3)), np.zeros(n, bool)).plot().figure_.canvas.draw()


@pytest.mark.parametrize(
    "shown",
    [
        NormalsDisplay,
        SegmentationDisplay,
        EdgeDisplay,
        PlaneResidualDisplay,
        OutlierDisplay,
        CloudPage,
    ],
)
def test_each_display_has_an_example(shown):
    assert ">>> " in shown.__doc__


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"show": "score"}, "show='score' is unknown"),
        ({"max_points": 0}, "max_points must be a whole number of at least 1, got 0"),
        ({"max_points": -1}, "max_points must be"),
        ({"max_points": 2.5}, "max_points must be"),
        ({"view": (1, 2, 3)}, "view must be a name or azimuth and elevation"),
        ({"view": (1, np.nan)}, "view must be"),
    ],
)
def test_wrong_options_are_refused_by_name(xyz, wrong, message):
    with pytest.raises(ValueError, match=message):
        OutlierDisplay.from_predictions(xyz, np.ones(400), **wrong)


@pytest.mark.parametrize(
    "draw",
    [
        OutlierDisplay.from_predictions,
        EdgeDisplay.from_predictions,
        lambda xyz, flags: PlaneResidualDisplay.from_predictions(xyz, xyz[:, 2], flags),
    ],
)
def test_flags_in_place_of_labels_are_refused(draw, xyz):
    with pytest.raises(ValueError, match=r"y_pred must be labels, .*np.where\(y_pred, -1, 1\)"):
        draw(xyz, xyz[:, 0] > 0)
    with pytest.raises(ValueError, match="y_true must be labels"):
        OutlierDisplay.from_predictions(xyz, np.ones(400), y_true=xyz[:, 0] > 0)


def test_missing_coordinates_and_labels_are_refused_by_name(xyz):
    with pytest.raises(ValueError, match="labels must be whole numbers without NaN"):
        SegmentationDisplay.from_predictions(xyz, np.full(400, np.nan))
    with pytest.raises(ValueError, match="labels must be whole numbers"):
        SegmentationDisplay.from_predictions(xyz, np.full(400, 0.5))
    broken = np.where(xyz > 0.9, np.nan, xyz)
    with pytest.raises(ValueError, match="xyz must be finite"):
        OutlierDisplay.from_predictions(broken, np.ones(400))
    with pytest.raises(ValueError, match="xyz must be finite"):
        plot_cloud(broken)
    NormalsDisplay.from_predictions(xyz, np.full((400, 3), np.nan))  # gray


@pytest.mark.parametrize("name", ["outliers", "scores", "normals", "segments", "edges"])
def test_displays_without_matplotlib_name_what_to_install(name, xyz, monkeypatch):
    labels = np.where(xyz[:, 0] > 0.5, -1, 1)
    for module in [m for m in sys.modules if m.partition(".")[0] == "matplotlib"]:
        monkeypatch.setitem(sys.modules, module, None)
    make = {
        "outliers": lambda: OutlierDisplay.from_predictions(xyz, labels),
        "scores": lambda: plot_cloud(xyz, color=xyz[:, 2]),
        "normals": lambda: NormalsDisplay.from_predictions(xyz, Fitted(xyz).normals_),
        "segments": lambda: SegmentationDisplay.from_predictions(xyz, labels),
        "edges": lambda: EdgeDisplay.from_predictions(xyz, labels),
    }
    with pytest.raises(ImportError, match=r"Plotting needs matplotlib.*: pip install "):
        make[name]()
