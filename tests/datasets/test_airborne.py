"""Swaths of different density that do not quite fit."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from scenes import scanned
from sklearn_mcmd.datasets import make_airborne_scan


def density(scan, x, y):
    """Echoes on the ground of a window, a square metre."""
    inside = (scan.data[:, :2] > [x[0], y[0]]) & (scan.data[:, :2] < [x[1], y[1]])
    ground = scan.classification == scan.class_names.index("ground")
    return (inside.all(axis=1) & ground).sum() / ((x[1] - x[0]) * (y[1] - y[0]))


RATIO, MISFIT = 6.0, 0.05  # neither is the default


@pytest.fixture(scope="module")
def scan():
    return make_airborne_scan(100_000, density_ratio=RATIO, misfit=MISFIT, random_state=0)


def test_densities_of_swaths_and_of_their_overlap(scan):
    dense = density(scan, (0, 80), (0.2, 2.3))
    # Beams from 250 m beside and 800 m up land farther apart on the slope of .2, which falls
    # away from them.
    sparse = density(scan, (53, 79), (53, 59.5)) / (1 - 0.2 * (250 - 56) / 800)
    both = density(scan, (53, 78), (26.6, 28.5))  # no wire throws its shadow there
    assert dense / sparse == pytest.approx(RATIO, rel=0.08)
    assert both / sparse == pytest.approx(RATIO + 1, rel=0.08)


def test_the_second_swath_is_too_high_by_the_misfit(scan):
    regular = scan.target == 1
    ray = (scan.true_points - scan.sensor_origins)[regular]
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    error = (scan.data - scan.true_points)[regular]
    for swath, misfit in ((0, 0.0), (1, MISFIT)):
        mine = scan.stretch[regular] == swath
        rest = error[mine] - [0, 0, misfit]
        along = np.einsum("ij,ij->i", rest, ray[mine])
        assert np.allclose(rest, along[:, None] * ray[mine], atol=1e-9)
        assert along.std() == pytest.approx(0.014, rel=0.04)
        assert abs(along.mean()) < 4 * 0.014 / np.sqrt(mine.sum())


def test_the_overlap_has_points_of_both_swaths_on_one_meadow():
    scan, _ = scanned("make_airborne_scan")
    y = scan.true_points[:, 1]
    assert 35 < y[scan.stretch == 0].max() < 38
    assert 24 < y[scan.stretch == 1].min() < 27


def test_forest_lets_some_beams_through_to_the_ground_and_echoes_in_depth():
    scan, _ = scanned("make_airborne_scan", 60_000)
    forest = (scan.data[:, 0] < 48) & (scan.data[:, 1] > 38)
    names = np.array(scan.class_names)[scan.classification]
    leaves, ground = forest & (names == "vegetation"), forest & (names == "ground")
    assert 0.1 < ground.sum() / leaves.sum() < 2
    assert 0.25 < (scan.echo[leaves] > 1).mean() < 0.6
    # Amsterdam's trees: 5 % of the points are farther than .66 m from the next one.
    away = cKDTree(scan.data[leaves]).query(scan.data[leaves], k=2)[0][:, 1]
    assert 0.2 < np.median(away) < 0.45


def test_the_misfit_is_finite():
    with pytest.raises(ValueError, match="'misfit' parameter"):
        make_airborne_scan(100, misfit=np.inf)
