"""Algorithm 1 in NumPy, against the literal reference."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from adversarial import KINDS, neighborhoods
from reference import consistent_set
from sklearn_mcmd.planes._consistent_set import (
    draw_trials,
    localize,
    maximum_consistent_sets,
    n_support_points,
    n_trials_needed,
)


@pytest.mark.parametrize(
    ("rate", "n"), [(0, 1), (0.05, 5), (0.1, 8), (0.2, 13), (0.4, 38), (0.5, 69), (0.75, 585)]
)
def test_the_number_of_trials_is_that_of_the_paper(rate, n):
    assert n_trials_needed(rate, 0.9999, 3) == n


def test_each_trial_reads_every_position_once_and_trials_differ():
    trials = draw_trials(69, 50, random_state=0)
    assert_array_equal(np.sort(trials, axis=1), np.tile(np.arange(50), (69, 1)))
    assert len(np.unique(trials[:, :3], axis=0)) > 60


def test_the_consistent_set_is_the_ceiling_of_its_share_of_the_neighborhood():
    # 0.8 * 50 is a little more than 40 in binary; 40 is meant.
    assert n_support_points(0.8, 50, 3) == 40
    assert_array_equal(n_support_points(0.5, np.array([3, 5, 9, 50, 51]), 3), [3, 4, 5, 25, 26])


@pytest.mark.parametrize("kind", [*KINDS, 2, 4])
def test_the_batched_form_equals_the_literal_reference(kind):
    if kind in KINDS:
        points = neighborhoods(kind, 12, 30, seed=1)
    else:  # a number of dimensions
        points = np.random.default_rng(0).normal(size=(12, 30, kind))
        points[..., -1] *= 0.05
    trials = draw_trials(25, 30, random_state=2)
    support, least, _ = maximum_consistent_sets(points, trials, 15)
    for i, neighborhood in enumerate(points):
        _, radius = localize(neighborhood[None])
        members, value = consistent_set(neighborhood, trials, 15)
        assert_array_equal(np.flatnonzero(support[i]), members)
        assert_allclose(least[i], value, rtol=1e-6, atol=1e-14 * radius[0] ** 2)


def test_members_beyond_the_size_do_not_matter():
    points = neighborhoods("noisy plane", 20, 40, seed=4)
    sizes = np.full(20, 25)
    trials = draw_trials(30, 40, random_state=0)
    first, _, _ = maximum_consistent_sets(points, trials, 13, sizes)
    points[:, 25:] = 1e9
    second, _, _ = maximum_consistent_sets(points, trials, 13, sizes)
    assert_array_equal(first, second)
    local, scale = localize(points, sizes)
    alone, its_scale = localize(points[:, :25])
    assert_array_equal(local[:, :25], alone)
    assert_array_equal(scale, its_scale)


def test_a_degenerate_minimal_subset_is_completed():
    """All but one point on a line: only subsets that reach it span a plane."""
    t = np.linspace(0, 1, 20)
    points = np.stack([t, 2 * t, 0 * t], axis=1)[None]
    points[0, 7] = [0.5, 0.5, 3.0]
    trials = draw_trials(10, 20, random_state=0)
    support, least, _ = maximum_consistent_sets(points, trials, 10)
    assert support.sum() == 10
    assert_allclose(least, 0, atol=1e-15)


@pytest.mark.parametrize("points", [np.zeros((1, 9, 3)), np.arange(9.0)[None, :, None] * [1, 2, 3]])
def test_points_that_span_no_plane_give_the_first_members(points):
    trials = draw_trials(10, 9, random_state=0)
    support, _, degenerate = maximum_consistent_sets(points, trials, 5)
    assert degenerate.all()
    assert_array_equal(support[0], np.arange(9) < 5)


def test_the_set_does_not_depend_on_how_trials_are_chunked(monkeypatch):
    points = neighborhoods("noisy plane", 7, 30, seed=5)
    trials = draw_trials(69, 30, random_state=0)
    whole = maximum_consistent_sets(points, trials, 15)
    monkeypatch.setattr("sklearn_mcmd.planes._consistent_set.CHUNK_ENTRIES", 1)
    pieces = maximum_consistent_sets(points, trials, 15)
    assert_array_equal(whole[0], pieces[0])
