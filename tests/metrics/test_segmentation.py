"""Segmentation scores against the paper's table and a literal reading of the rules."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from sklearn.exceptions import UndefinedMetricWarning
from sklearn.metrics import adjusted_rand_score

from sklearn_mcmd.metrics import segmentation_scores

# Rows of Table 6: PS, OS, US and the printed recall, precision and F, in percent.
TABLE_6 = [
    (5, 7, 6, 45.45, 41.67, 43.48),
    (19, 0, 1, 95.00, 100.00, 97.44),
    (6, 0, 8, 42.86, 100.00, 60.00),
    (21, 0, 0, 100.00, 100.00, 100.00),
    (12, 27, 5, 70.59, 30.77, 42.86),
    (21, 13, 1, 95.45, 61.76, 75.00),
    (29, 4, 0, 100.00, 87.88, 93.55),
]


def outcomes_by_sets(y_true, y_pred, share):
    """The docstring's rules, surface by surface, with sets of points."""
    surfaces = {s: {i for i, t in enumerate(y_true) if t == s} for s in set(y_true) - {-1}}
    labelled = set().union(*surfaces.values())
    segments = {
        s: {i for i, p in enumerate(y_pred) if p == s} & labelled
        for s in sorted(set(y_pred) - {-1})
    }
    segments = {s: points for s, points in segments.items() if points}

    def fit(points, segment):
        return len(points & segment) / len(points | segment)

    outcomes, ious = {}, {}
    for name, points in surfaces.items():
        ious[name] = max((fit(points, segment) for segment in segments.values()), default=0.0)
        covered = sum(len(points & segment) for segment in segments.values())
        if covered / len(points) <= 1 - share:
            outcomes[name] = "missed"
            continue
        main = max(segments.values(), key=lambda s: (len(points & s), fit(points, s)))
        swallowed = any(
            len(another & main) >= share * len(another)
            for key, another in surfaces.items()
            if key != name
        )
        if swallowed or len(points & main) < share * len(main):
            outcomes[name] = "under"
        elif len(points & main) < share * len(points):
            outcomes[name] = "over"
        else:
            outcomes[name] = "proper"
    return outcomes, ious


def quiet_scores(*args, **kwargs):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UndefinedMetricWarning)
        return segmentation_scores(*args, **kwargs)


@settings(max_examples=300)
@given(
    st.lists(st.tuples(st.integers(-1, 4), st.integers(-1, 5)), min_size=1, max_size=40),
    st.sampled_from([0.5625, 0.75, 1.0]),
)
def test_outcomes_are_those_of_the_rules_taken_literally(pairs, share):
    y_true, y_pred = (list(column) for column in zip(*pairs, strict=True))
    if set(y_true) == {-1}:
        return
    scores = quiet_scores(y_true, y_pred, min_overlap=share)
    outcomes, ious = outcomes_by_sets(y_true, y_pred, share)
    outcome_of = dict(zip(scores.surfaces.tolist(), scores.surface_outcomes.tolist(), strict=True))
    assert outcome_of == outcomes
    assert_allclose(scores.surface_iou, [ious[s] for s in scores.surfaces.tolist()], rtol=1e-12)
    assert_allclose(scores.mean_iou, np.mean(list(ious.values())), rtol=1e-12)


@pytest.mark.parametrize(("proper", "over", "under", "recall", "precision", "f"), TABLE_6)
def test_the_ratios_of_table_6_follow_from_its_counts(proper, over, under, recall, precision, f):
    # Surfaces of ten points: whole ones, halves, and one segment of all the under-segmented;
    # under-segmentation of a single surface is by points of a large one elsewhere.
    y_true = np.repeat(np.arange(proper + over + under), 10)
    y_pred = np.repeat(np.arange(proper + over + under), 10)
    halves = (y_true >= proper) & (y_true < proper + over)
    y_pred[halves] += 1000 * (np.arange(len(y_pred)) % 2)[halves]
    y_pred[y_true >= proper + over] = 5000
    if under == 1:  # some points of a large, proper surface fall into its segment
        y_true = np.r_[y_true, np.zeros(1000, int)]
        y_pred = np.r_[y_pred, np.zeros(990, int), np.full(10, 5000)]
    scores = segmentation_scores(y_true, y_pred)
    assert (scores.proper, scores.over, scores.under) == (proper, over, under)
    printed = [recall, precision, f]
    ours = [100 * scores[name] for name in ("recall", "precision", "f_score")]
    assert_allclose(ours, printed, atol=0.0051)


def test_points_of_no_surface_are_left_out():
    rng = np.random.default_rng(0)
    y_true, y_pred = rng.integers(0, 5, 200), rng.integers(-1, 5, 200)
    alone = quiet_scores(y_true, y_pred)
    with_outliers = quiet_scores(np.r_[y_true, np.full(50, -1)], np.r_[y_pred, np.arange(50) % 7])
    assert str(alone) == str(with_outliers)
    assert alone.adjusted_rand == adjusted_rand_score(y_true, y_pred)


def test_undefined_ratios_are_nan_with_a_warning_each():
    with pytest.warns(UndefinedMetricWarning) as caught:
        scores = segmentation_scores([0, 0], [-1, -1])
    assert len(caught) == 3
    assert np.isnan([scores.recall, scores.precision, scores.f_score]).all()


@pytest.mark.parametrize(
    ("y_true", "y_pred", "message"),
    [
        ([0.5, 1.0], [0, 1], "y_true has dtype float64"),
        ([0, 1], ["a", "b"], "y_pred has dtype"),
        ([0, 1], [0, 1, 2], "inconsistent numbers"),
        ([-1, -1], [0, 1], "names no surface"),
    ],
)
def test_bad_labels_are_refused_by_name(y_true, y_pred, message):
    with pytest.raises(ValueError, match=message):
        segmentation_scores(y_true, y_pred)


@pytest.mark.parametrize("share", [0.5, 1.1, np.nan])
def test_an_overlap_that_is_no_majority_is_refused(share):
    with pytest.raises(ValueError, match="min_overlap"):
        segmentation_scores([0], [0], min_overlap=share)
