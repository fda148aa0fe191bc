"""Iteration over the cloud: what is flagged, what is kept, and whose plane it is."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from scenes import corner, cylinder, sphere, torus
from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.outliers._company import group_sizes
from sklearn_mcmd.outliers._iteration import IteratedPlanes

OWN = {"max_iter": 1, "noise_scale": "own", "borrow": False}
LOCAL = {"noise_scale": "local", "borrow": True, "max_iter": 4}
POOLED = {"noise_scale": "pooled", "borrow": True, "max_iter": 6}
FORMS = pytest.mark.parametrize("form", [LOCAL, POOLED, {**POOLED, "noise_scale": 0.005}])


def detector(form, **parameters):
    return MCMDOutlierDetector(random_state=0, **form, **parameters)


@pytest.fixture(scope="module")
def street():
    return make_street(6000, noise=0.005, outlier_share=0.1, random_state=0)


def test_the_papers_form_is_one_documented_line(street):
    X = street.data[:2000]
    paper = MCMDOutlierDetector(
        refine=None, max_iter=1, noise_scale="own", borrow=False, random_state=0
    ).fit(X)
    assert paper.offset_ == -2.5
    assert paper.n_iter_ == 1
    assert_array_equal(paper.plane_index_, np.arange(2000))
    assert not hasattr(paper, "noise_scale_")


@FORMS
def test_fit_predict_equals_predict_and_scores_agree(street, form):
    fitted = detector(form)
    labels = fitted.fit_predict(street.data)
    scores = fitted.score_samples(street.data)
    assert_array_equal(labels, fitted.predict(street.data))
    assert_array_equal(labels, np.where(scores >= fitted.offset_, 1, -1))
    assert_array_equal(fitted.scores_, scores)
    assert_array_equal(fitted.decision_function(street.data), scores - fitted.offset_)
    assert fitted.offset_ == -3


@FORMS
def test_results_do_not_depend_on_threads_or_chunks(street, form, monkeypatch):
    expected = detector(form).fit(street.data)
    monkeypatch.setattr("sklearn_mcmd.outliers._iteration.CHUNK", {True: 997, False: 97})
    monkeypatch.setattr("sklearn_mcmd.planes._local_planes.CHUNK", {True: 997, False: 97})
    pieces = detector(form, n_jobs=2).fit(street.data)
    assert_array_equal(pieces.score_samples(street.data), expected.score_samples(street.data))
    assert_array_equal(pieces.plane_index_, expected.plane_index_)


@FORMS
def test_results_do_not_depend_on_the_order_of_rows(street, form):
    X = street.data
    order = np.random.default_rng(0).permutation(len(X))
    expected = detector(form).fit(X)
    shuffled = detector(form).fit(X[order])
    # Sums in another order may tip a point on the cutoff: few points, not the result.
    close = np.isclose(
        shuffled.score_samples(X[order]), expected.score_samples(X)[order], rtol=1e-6, atol=1e-6
    )
    assert close.mean() > 0.999
    assert shuffled.n_iter_ == expected.n_iter_


@FORMS
def test_scores_do_not_depend_on_units(street, form):
    X = street.data[:3000]
    scaled = dict(form)
    if not isinstance(form["noise_scale"], str):
        scaled["noise_scale"] *= 1024
    expected = detector(form).fit(X).score_samples(X)
    scores = detector(scaled).fit(1024 * X).score_samples(1024 * X)
    # A power of two: no coordinate is rounded.
    assert_allclose(scores, expected, rtol=1e-6, atol=1e-6)


@FORMS
def test_new_points_are_scored_as_training_points_are(street, form):
    fitted = detector(form).fit(street.data)
    expected = fitted.score_samples(street.data)[:7]
    rows = [fitted.score_samples(row[None])[0] for row in street.data[:7]]
    assert_allclose(rows, expected, rtol=1e-12)


@pytest.mark.parametrize("seed", [0, 1])
def test_the_default_finds_more_outliers_and_loses_fewer_points_than_the_papers_form(seed):
    street = make_street(20_000, outlier_share=0.1, random_state=seed)
    X, y = street.data, street.target
    paper = MCMDOutlierDetector(refine=None, random_state=0, **OWN).fit_predict(X)
    labels = MCMDOutlierDetector(random_state=0).fit_predict(X)
    found = [(form[y == -1] == -1).mean() for form in (paper, labels)]
    kept = [(form[y == 1] == 1).mean() for form in (paper, labels)]
    assert found[1] > found[0] + 0.1
    assert kept[1] > 0.995 > kept[0]


def test_the_pooled_scale_is_the_sensors_noise():
    X, _, _ = corner(3000, noise=0.004)
    assert_allclose(detector(POOLED).fit(X).noise_scale_, 0.004, rtol=0.1)
    assert detector({**POOLED, "noise_scale": 0.005}).fit(X).noise_scale_ == 0.005


@pytest.mark.parametrize("noise", [0.0, 0.005])
@pytest.mark.parametrize("make", [sphere, cylinder, torus])
def test_the_local_scale_keeps_smooth_curved_surfaces(make, noise):
    X, _ = make(5000, noise)
    assert (detector(LOCAL).fit_predict(X) == -1).mean() <= 0.01


@pytest.mark.parametrize(
    ("name", "most"),
    [("cad_angle_block", 0.01), ("cad_featuretype", 0.01), ("pcl_building_region_growing", 0.03)],
)
def test_the_local_scale_keeps_clean_clouds_in_one_pass(shared_data, name, most):
    with np.load(shared_data / name / "cloud.npz") as arrays:
        X = arrays["xyz"][:30_000]
    form = {**LOCAL, "max_iter": 1}
    assert (detector(form, n_jobs=2).fit_predict(X) == -1).mean() <= most


def test_a_borrowed_plane_is_that_of_the_own_face():
    X, normals, _ = corner(3000)
    fitted = detector({**LOCAL, "max_iter": 1}).fit(X)
    borrowed = np.flatnonzero(fitted.plane_index_ != np.arange(len(X)))
    assert len(borrowed) > 20
    of_face = (normals[fitted.plane_index_[borrowed]] == normals[borrowed]).all(axis=1)
    assert of_face.mean() > 0.9


def test_borrowing_keeps_points_next_to_an_edge():
    X, _, _ = corner(3000)
    edge = X[:, [0, 2]].max(axis=1) < 0.03
    form = {"noise_scale": "pooled", "max_iter": 1}
    alone = detector({**form, "borrow": False}).fit_predict(X)
    borrowing = detector({**form, "borrow": True}).fit_predict(X)
    assert (borrowing[edge] == 1).mean() > 0.98 > (alone[edge] == 1).mean()


def test_a_point_that_stands_apart_is_flagged_in_the_plane_too():
    X, _, _ = corner(3000)
    X = X[X[:, 2] < 0.01]
    far = np.array([[0.5, 1.8, 0.0]])
    assert detector({**LOCAL, "borrow": False}).fit(X).predict(far) == -1


def test_a_small_ball_of_ghost_points_is_flagged():
    X, _, _ = corner(6000)
    rng = np.random.default_rng(1)
    ghost = [0.5, 0.5, 0.5] + 0.02 * rng.normal(size=(30, 3))
    labels = detector(POOLED).fit_predict(np.vstack([X, ghost]))
    assert (labels[-30:] == -1).mean() > 0.9


@FORMS
def test_iteration_ends_before_the_most_passes_on_a_clean_cloud(form):
    X, _, _ = corner(3000, noise=0.005)
    assert detector({**form, "max_iter": 50}).fit(X).n_iter_ < 10


@FORMS
def test_iteration_ends_with_many_outliers(form):
    X = make_street(4000, outlier_share=0.4, random_state=2).data
    assert detector({**form, "max_iter": 60}).fit(X).n_iter_ < 60


def test_searching_only_what_may_have_changed_finds_what_searching_all_does(street, monkeypatch):
    X = np.vstack([street.data, street.data[::7]])  # with copies
    refit, n_passes = IteratedPlanes._refit, []

    def checked(self, points):
        refit(self, points)
        found, _ = self.model.index.query(points)
        assert_array_equal(self.neighbors, self.member_rows[found])
        n_passes.append(self.n_iter)

    monkeypatch.setattr(IteratedPlanes, "_refit", checked)
    detector({"max_iter": 6}).fit(X)
    assert len(n_passes) > 3


@pytest.mark.parametrize("noise_scale", ["local", "pooled", "own"])
def test_scores_of_fitted_points_are_those_of_new_ones_where_distances_tie(noise_scale):
    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(np.arange(50), np.arange(50)), -1).reshape(-1, 2)
    X = np.column_stack([grid, rng.normal(0, 0.2, 2500).round(1)])
    X = np.vstack([X, rng.uniform(0, 50, (250, 3)).round()])
    form = {"noise_scale": noise_scale, "max_iter": 5, "n_neighbors": 30}
    fitted = detector(form).fit(X)
    assert fitted.n_iter_ > 2
    assert_array_equal(fitted.scores_, fitted.score_samples(X))


def test_compiled_verdicts_are_those_of_numpy(street, monkeypatch):
    compiled = detector(LOCAL).fit(street.data)
    monkeypatch.setattr(
        "sklearn_mcmd.planes._local_planes.LocalPlaneModel.ready", lambda self: False
    )
    plain = detector(LOCAL).fit(street.data)
    labels = [d.scores_ < d.offset_ for d in (compiled, plain)]
    # Sums in another order may tip a point on a limit, and its neighbors with it.
    assert (labels[0] == labels[1]).mean() > 0.999
    same = np.isclose(compiled.scores_, plain.scores_, rtol=1e-6, atol=1e-9)
    assert same.mean() > 0.99


def test_outliers_in_mid_air_do_not_excuse_each_other():
    # In this scene a group of them is retained, and is sparse: by its spacing, 17 % of the uniform
    # outliers around would keep company.
    street = make_street(20_000, outlier_share=0.2, random_state=1)
    fitted = MCMDOutlierDetector(random_state=0).fit(street.data)
    outlier = fitted.scores_ < fitted.offset_
    assert outlier[street.outlier_kind == 2].mean() > 0.93
    assert outlier[street.target == 1].mean() < 0.005


def test_groups_are_those_of_mutual_near_neighbors():
    rng = np.random.default_rng(0)
    centers = rng.uniform(0, 20, (30, 3))
    X = np.vstack(
        [c + 0.1 * rng.normal(size=(m, 3)) for c, m in zip(centers, range(5, 35), strict=True)]
    )
    _, neighbors = cKDTree(X).query(X, 20)
    rows = np.arange(len(X))
    sizes = [group_sizes(X, rows, neighbors, compiled) for compiled in (True, False)]
    assert_array_equal(*sizes)
    # Brute force: the graph of mutual links among the twelve nearest, walked.
    linked = (neighbors[:, None, 1:13] == rows[None, :, None]).any(axis=2)
    linked &= linked.T
    expected = connected_components(csr_array(linked))[1]
    assert_array_equal(sizes[0], np.bincount(expected)[expected])


@FORMS
def test_scores_are_finite_where_points_coincide(form):
    rng = np.random.default_rng(0)
    X = np.vstack([np.zeros((300, 3)), rng.uniform(size=(300, 3)), np.full((9, 3), 5.0)])
    scores = detector(form).fit(X).score_samples(np.vstack([X, [[0.1, 0, 0]]]))
    assert np.isfinite(scores).all()


def test_one_plane_for_all_is_measured_by_a_given_noise():
    rng = np.random.default_rng(0)
    X = rng.uniform(size=(200, 3)) * [1, 1, 0] + rng.normal(0, 0.01, (200, 3))
    given = MCMDOutlierDetector(None, noise_scale=0.02, random_state=0).fit(X)
    own = MCMDOutlierDetector(None, random_state=0).fit(X)
    assert_allclose(given.score_samples(X) / own.score_samples(X), 0.5, rtol=0.15)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"max_iter": 0}, "'max_iter' parameter"),
        ({"noise_scale": 0.0}, "'noise_scale' parameter"),
        ({"noise_scale": "global"}, "'noise_scale' parameter"),
        ({"borrow": "yes"}, "'borrow' parameter"),
    ],
)
def test_bad_parameters_are_named(parameters, message):
    with pytest.raises(ValueError, match=message):
        MCMDOutlierDetector(**parameters).fit(np.eye(3).repeat(3, 0))
