"""Which points mcmd denoise judges: by classes and marks."""

import numpy as np
import pytest

from commands import done, error_line, run
from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.io import PointCloud, read_points, write_points


@pytest.fixture
def site(tmp_path):
    """Ground, a roof, and single points above; a file of it."""
    rng = np.random.default_rng(0)
    ground = rng.uniform(0, 20, (1_500, 3)) * [1, 1, 0] + rng.normal(0, 0.01, (1_500, 3))
    roof = rng.uniform(5, 12, (500, 3)) * [1, 1, 0] + [0, 0, 4]
    single = rng.uniform(0, 20, (20, 3)) * [1, 1, 0] + np.linspace(1, 30, 20)[:, None] * [0, 0, 1]
    counts = (1_500, 500, 20)
    cloud = PointCloud(
        np.round(np.vstack([ground, roof, single]), 3),
        {
            "classification": np.repeat([2, 6, 1], counts),
            "withheld": np.arange(sum(counts)) % 50 == 49,
        },
    )
    write_points(tmp_path / "site.las", cloud)
    return tmp_path / "site.las"


def marked(site, *options):
    """The cloud as mcmd marks it, beside its input."""
    target = site.with_name("marked.las")
    result = done("denoise", site, target, "--mode", "mark", *options)
    return read_points(site), read_points(target), result


def outliers_of(cloud, used):
    """The outliers among the points that are used."""
    is_outlier = np.zeros(len(cloud), bool)
    is_outlier[used] = MCMDOutlierDetector(random_state=0).fit_predict(cloud.xyz[used]) == -1
    return is_outlier


@pytest.mark.parametrize(
    ("options", "left_out"),
    [
        (("--ignore-class", "6,9"), [6]),
        (("--only-class", "2,6"), [1]),
        (("--only-class", "1,2", "--ignore-class", "1"), [1, 6]),
    ],
)
def test_points_left_out_are_not_used_and_keep_their_class(options, left_out, site):
    before, after, result = marked(site, *options)
    classes = before.attributes["classification"]
    used = (before.attributes["withheld"] == 0) & ~np.isin(classes, left_out)
    is_outlier = outliers_of(before, used)
    noise = np.isin(after.attributes["classification"], (7, 18))
    np.testing.assert_array_equal(noise, is_outlier)
    np.testing.assert_array_equal(after.attributes["classification"][~noise], classes[~noise])
    np.testing.assert_array_equal(np.isnan(after.attributes["outlier_score"]), ~used)
    assert f"judged   {used.sum():,} " in result.stdout
    assert is_outlier.any() == (1 not in left_out)


def test_classes_are_asked_of_files_that_have_them(room_file, tmp_path):
    write_points(tmp_path / "a.csv", np.eye(3))
    line = error_line(run("denoise", tmp_path / "a.csv", tmp_path / "b.csv", "--only-class", 2))
    assert "a.csv: has no classes" in line
    line = error_line(run("denoise", room_file, tmp_path / "b.csv", "--only-class", 2))
    assert "no points are judged" in line
