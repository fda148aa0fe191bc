"""Pictures show every point where it belongs, near over far, in the colors asked for."""

import numpy as np
import pytest

from sklearn_mcmd.plotting import NormalsDisplay, normal_colors, plot_cloud, region_colors
from sklearn_mcmd.plotting._still import plot_before_after

matplotlib = pytest.importorskip("matplotlib")
matplotlib.use("agg")

FRONT = (-90.0, 0.0)  # the camera looks along +y


@pytest.fixture(autouse=True)
def _close_figures():
    yield
    import matplotlib.pyplot as plt

    plt.close("all")


@pytest.fixture
def cloud():
    return np.random.default_rng(0).uniform(-1, 1, (200, 3))


def test_a_front_view_shows_x_to_the_right_and_z_up_and_near_points_last(cloud):
    points = plot_cloud(cloud, view=FRONT).collections[0].get_offsets()
    far_to_near = cloud[np.argsort(-cloud[:, 1])]
    np.testing.assert_allclose(points, far_to_near[:, [0, 2]], atol=1e-12)


def test_exactly_the_outliers_are_red(cloud):
    outliers = np.arange(len(cloud)) % 7 == 0
    colors = plot_cloud(cloud, outliers=outliers, view=FRONT).collections[0].get_facecolors()
    red = (colors[:, 0] > 0.8) & (colors[:, 1:3] < 0.2).all(axis=1)
    np.testing.assert_array_equal(red, outliers[np.argsort(-cloud[:, 1])])


@pytest.mark.parametrize("color", ["tab:blue", (0.1, 0.2, 0.3), "values", "rgb"])
def test_colors_may_be_one_or_one_a_point(color, cloud):
    color = {"values": cloud[:, 0], "rgb": np.abs(cloud)}.get(color, color)
    for outliers in (None, cloud[:, 0] > 2):
        plot_cloud(cloud, color=color, outliers=outliers).figure.canvas.draw()


def test_before_and_after_share_one_scale_and_count_truly(cloud):
    outliers = np.abs(cloud[:, 0]) > 0.9
    kept = cloud[:, 0] < 0.9
    fig = plot_before_after(cloud, outliers, cloud[kept], outliers[kept], cloud[kept])
    left, middle, right = fig.axes
    assert left.get_xlim() == middle.get_xlim() == right.get_xlim()
    assert f"{outliers.sum()} outliers" in left.get_title()
    assert f"{(~kept).sum()} removed, {outliers[kept].sum()} outliers missed" in middle.get_title()


def test_the_ball_beside_the_normals_has_the_color_of_each_of_its_normals(cloud):
    normals = cloud / np.linalg.norm(cloud, axis=1, keepdims=True)
    axes = NormalsDisplay.from_predictions(cloud, normals, view=FRONT).ax_
    (ball,) = axes.child_axes[0].images
    picture = ball.get_array()
    middle = len(picture) // 2
    # Seen along +y: x to the right, z up, and the near side looks along -y.
    for row, column, normal in (
        (middle, middle, [0, -1, 0]),
        (-1, middle, [0, 0, 1]),
        (middle, -1, [1, 0, 0]),
    ):
        expected = [*normal_colors([normal], view=FRONT)[0], 1.0]
        np.testing.assert_allclose(picture[row, column], expected, atol=1e-9)
    assert picture[0, 0, 3] == 0  # nothing outside of the ball


def test_each_of_many_regions_has_a_color_of_its_own_and_none_is_gray():
    colors = region_colors(np.arange(300))
    assert len(np.unique(np.rint(255 * colors), axis=0)) == 300
    assert (colors >= 0).all()
    assert (colors <= 1).all()
    np.testing.assert_array_equal(region_colors([-1]), [[0.3, 0.3, 0.3]])


def test_a_whole_number_is_a_size_of_markers_too():
    rng = np.random.default_rng(0)
    ax = plot_cloud(rng.uniform(size=(50, 3)), outliers=np.arange(50) < 5, size=3)
    drawn = np.concatenate([c.get_sizes() for c in ax.collections])
    np.testing.assert_allclose(np.unique(drawn), [9.0, 12.96])


def test_colors_of_normals_depend_on_the_axis_and_not_on_the_sign_and_none_is_gray(cloud):
    np.testing.assert_array_equal(normal_colors(cloud), normal_colors(-cloud))
    x, y, z = normal_colors(np.eye(3))
    assert min(np.abs(x - y).max(), np.abs(y - z).max(), np.abs(x - z).max()) > 0.1
    np.testing.assert_array_equal(normal_colors([[np.nan] * 3]), [[0.6, 0.6, 0.6]])
